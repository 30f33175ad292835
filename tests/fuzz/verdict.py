"""What came of one input: read, refused in one clear line, or found wrong."""

from __future__ import annotations

import traceback
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.reader import Opened, Reader, Wrong

__all__ = ["LONGEST_MESSAGE", "Finding", "finding_of", "judged"]

LONGEST_MESSAGE = 2000
"""Characters: what is longer is no line any more."""


@dataclass(frozen=True)
class Finding:
    """Attributes:
    kind: "crash", "hang", "memory" or "wrong".
    where: what it is and the line of code; findings with the same are one.
    trace: for people.
    """

    kind: str
    where: str
    trace: str


def judged(reader: Reader, opened: Opened, file: Path) -> Finding | bool:
    """Let a reader read its files; True where it took them, False where it refused them as it should."""
    try:
        opened.read(file)
    except reader.errors as error:
        if _in_chain(error, MemoryError):
            return finding_of("memory", error)
        problem = _unclear(reader.line(error))
        return False if problem is None else finding_of("wrong", Wrong(problem).with_traceback(error.__traceback__))
    except Wrong as error:
        return finding_of("wrong", error)
    except MemoryError as error:
        return finding_of("memory", error)
    except Exception as error:
        return finding_of("crash", error)
    return True


def finding_of(kind: str, error: BaseException) -> Finding:
    """What went wrong, and where: the innermost line of this project's own code."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "unveil_core" in f.filename or "blender_addon" in f.filename]
    last = own[-1] if own else frames[-1] if frames else None
    place = "nowhere" if last is None else f"{'/'.join(Path(last.filename).parts[-3:])}:{last.lineno}"
    named = f"{type(error).__name__} {str(error)[:60]!a}" if isinstance(error, Wrong) else type(error).__name__
    shown = "".join(traceback.format_exception(type(error), error, error.__traceback__)[-12:])
    return Finding(kind, f"{named} at {place}", shown[-4000:])


def _in_chain(error: BaseException | None, kind: type[BaseException]) -> bool:
    while error is not None:
        # Arrow asks the system for what a file claims, and writes what there is: nothing was taken where it says no.
        if isinstance(error, kind) and type(error).__name__ != "ArrowMemoryError":
            return True
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return False


def _unclear(message: str) -> str | None:
    """What is wrong with a message: it must be one line that a terminal can show."""
    if len(message) > LONGEST_MESSAGE:
        return "a message is too long"
    if not message.isprintable():
        return "a message holds what cannot be printed"
    return None

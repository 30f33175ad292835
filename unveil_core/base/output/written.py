"""What this program wrote in a folder, by name: nothing else there is written over, replaced or removed.

A record, one small JSON file in the folder, is the program's mark: it names its generator, and lists the files that were
written, relative to the folder. Whoever is about to write asks first; what is not listed is somebody's, and the command is
refused with a line that names it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from unveil_core import __version__
from unveil_core.base.checks.names import is_inside
from unveil_core.base.errors import SettingsError, UnveilError
from unveil_core.base.files import read_own_json
from unveil_core.base.output.stamps import Stamp

__all__ = [
    "DRIVE",
    "EXPORTED",
    "GENERATOR",
    "RECORD",
    "check_replaceable",
    "files_in",
    "is_ours",
    "record_of",
    "stamps_in",
    "strangers",
    "written_in",
]

RECORD = ".unveil.json"
"""The record of a folder whose content has no file of its own to say it in."""
DRIVE = "drive"
"""Key of the record of a folder that was made to be a drive: nobody's results go into it."""
EXPORTED = "export.json"
"""The record of an exported folder, which tells what was exported, too."""
GENERATOR = f"unveil {__version__}"
LITTER = {".ds_store", "thumbs.db", "desktop.ini"}
"""Files that systems leave in each folder that somebody looks at; nobody's work."""
LARGEST_RECORD = 1 << 28
"""Bytes; a larger file is none."""


def is_ours(content: object) -> bool:
    """Whether what a JSON file holds says that this program, in any version, wrote it."""
    generator = content.get("generator") if isinstance(content, dict) else None
    return isinstance(generator, str) and generator.split(" ")[0] == "unveil"


def record_of(path: Path) -> dict[str, Any] | None:
    """The record in a file; None where there is none, it is damaged, or is not this program's. Links are none."""
    with suppress(OSError, ValueError):
        content = read_own_json(path, LARGEST_RECORD)
        return content if is_ours(content) else None
    return None


def stamps_in(folder: Path, record: str = RECORD) -> dict[str, Stamp | None] | None:
    """The files that were written in a folder, relative to it and with "/", each with its stamp, None where it has none; None where
    the folder has no record of this program."""
    content = record_of(folder / record)
    if content is None:
        return None
    listed = content.get("files")
    if isinstance(listed, dict):
        return {n: s if isinstance(s, list) else None for n, s in listed.items() if is_inside(n)}
    return {n: None for n in listed if is_inside(n)} if isinstance(listed, list) else {}


def written_in(folder: Path, record: str = RECORD) -> frozenset[str] | None:
    """The names of :func:`stamps_in` alone, that of the record among them."""
    found = stamps_in(folder, record)
    return None if found is None else frozenset({record, *found})


def check_replaceable(
    folder: Path,
    own: Collection[str] | None,
    *,
    mend: str,
    kind: Callable[..., UnveilError] = SettingsError,
) -> None:
    """Check that a folder can be put in the place of another one: nothing is there, or nothing but what this program wrote.

    Args:
        own: what it wrote there, as :func:`written_in` has it.
        mend: of the message; kind: of the error.
    Raises:
        SettingsError: something else is there, or in it; it is named.
    """
    if not _is_there(folder):
        return
    if not _is_folder(folder):
        raise kind("Not a folder, and so not replaced", path=folder, mend=mend)
    found = next(strangers(folder, own or ()), None)
    if found is not None:
        raise kind("Not written by Unveil, and so not replaced", path=found, mend=mend)


def strangers(folder: Path, own: Collection[str]) -> Iterator[Path]:
    """What lies in a folder and is not among what was written there: files, links, and folders in which nothing was.

    Args:
        own: names of files, relative to the folder, with "/".
    """
    known = frozenset(own)
    folders = {above for name in known for above in _folders_of(name)}
    waiting = [folder]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in sorted(entries, key=lambda e: e.name):
                name = Path(entry.path).relative_to(folder).as_posix()
                if entry.is_dir(follow_symlinks=False):
                    if name in folders:
                        waiting.append(Path(entry.path))
                    else:
                        yield Path(entry.path)
                elif entry.is_symlink() or (name not in known and entry.name.lower() not in LITTER):
                    yield Path(entry.path)


def files_in(folder: Path) -> list[str]:
    """Names of all files in a folder and those below it, relative to it, with "/"."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if not _is_folder(p))


def _folders_of(name: str) -> list[str]:
    """The folders on the way to a file: "a" and "a/b" of "a/b/c"."""
    parts = name.split("/")[:-1]
    return ["/".join(parts[: k + 1]) for k in range(len(parts))]


def _is_there(path: Path) -> bool:
    """Whether anything has that name, a link to nothing too."""
    return os.path.lexists(path)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()

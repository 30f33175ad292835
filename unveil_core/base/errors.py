"""Errors that a user can fix: each is one clear line, and the command exits with 2 on them."""

from __future__ import annotations

from pathlib import Path

LONGEST_PART = 600
"""Characters of the path, the problem and the mend: what files of strangers hold is quoted in part."""

__all__ = [
    "Cancelled",
    "DiskFullError",
    "DriveError",
    "GpuMemoryError",
    "GpuTooSmallError",
    "InUseError",
    "Interrupted",
    "OutOfMemoryError",
    "SelectionError",
    "SettingsError",
    "UnveilError",
    "WorkspaceError",
]


class UnveilError(Exception):
    """A problem with what the user gave, in one line.

    Args:
        problem: what is wrong, a short phrase without a final stop.
        path: the file or folder concerned, named first in the message.
        mend: what to do about it, a short phrase.
    """

    def __init__(self, problem: str, *, path: Path | str | None = None, mend: str | None = None) -> None:
        self.problem, self.path, self.mend = problem, path, mend
        line = f"{_shown(str(path), tail=True)}: {_shown(problem)}" if path is not None else _shown(problem)
        if mend:
            line = f"{line} ({_shown(mend)})"
        super().__init__(line)


def _shown(text: str, *, tail: bool = False) -> str:
    """A part of a message as a terminal can show it: one line, not too long, and no orders to the terminal in it.

    Args:
        tail: the end tells more than the beginning.
    """
    whole = " ".join(text.split())
    if not whole.isprintable():
        whole = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in whole)
    if len(whole) > LONGEST_PART:
        return f"…{whole[-LONGEST_PART:]}" if tail else f"{whole[:LONGEST_PART]}…"
    return whole


class DriveError(UnveilError):
    """A drive on disk that cannot be read: images, poses, points, labels."""


class SelectionError(UnveilError):
    """A choice of what to remove that selects nothing or names what does not exist."""


class SettingsError(UnveilError):
    """A setting that is out of range or unknown."""


class WorkspaceError(UnveilError):
    """A workspace folder that cannot be used as it is."""


class InUseError(WorkspaceError):
    """A workspace in which another process works."""


class DiskFullError(Exception):
    """No room left to write to: nothing is wrong with the input, so this is a failure (exit code 1) that says what to do."""

    def __init__(self, path: Path | str) -> None:
        self.path = path
        super().__init__(f"{path}: the disk is full (free some space and run it again: it goes on)")


class OutOfMemoryError(Exception):
    """The system gave no more memory: a failure (exit code 1) that says what would fit.

    Args:
        path: the workspace; stage: that wanted it.
        held_mb: the most that the process held, MB.
        mend: options with which less is held; None = none is known.
    """

    def __init__(self, path: Path | str, stage: str, held_mb: float, mend: str | None = None) -> None:
        self.path = path
        way_out = f"or run it with {mend}" if mend else "or use a machine with more"
        super().__init__(
            f"{path}: no memory left for {stage}, at {held_mb:.0f} MB "
            f"(end other programs {way_out}: it goes on where it stopped)"
        )


class GpuTooSmallError(SettingsError):
    """The GPU has too little memory for what it is to do, or too little is free: what was computed so far is kept."""


class GpuMemoryError(OutOfMemoryError):
    """The GPU had no more memory: a failure (exit code 1) that says what would fit.

    Args:
        path: the workspace; stage: that wanted it.
    """

    def __init__(self, path: Path | str, stage: str) -> None:
        self.path = path
        Exception.__init__(
            self,
            f"{path}: no memory left on the GPU for {stage} (end other programs that use it, or use --device cpu: it goes on "
            "where it stopped; or begin again with a smaller --work-side or fewer --splats)",
        )


class Interrupted(KeyboardInterrupt):
    """A signal that ends the program: Ctrl-C or SIGTERM.

    Of an own class, for Python compares by identity: a plain KeyboardInterrupt that passes through code compiled from text, as of a
    data class that is being made, ends the process by SIGINT in the end, although it was caught (``run_eval_code_obj``).
    """


class Cancelled(Exception):
    """The user asked to stop; raised from a progress callback, ends with exit code 130."""

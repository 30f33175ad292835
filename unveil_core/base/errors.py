"""Errors that a user can fix: each is one clear line, and the command exits with 2 on them."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.wording import shown

__all__ = [
    "Cancelled",
    "ConfirmError",
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
        line = f"{shown(path, tail=True)}: {shown(problem)}" if path is not None else shown(problem)
        if mend:
            line = f"{line} ({shown(mend)})"
        super().__init__(line)


class ConfirmError(UnveilError):
    """What is so surely a mistake that nothing is begun before the user confirms it: at a terminal, or by ``--yes``."""


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
        super().__init__(f"{shown(path, tail=True)}: the disk is full (free some space and run it again: it goes on)")


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
            f"{shown(path, tail=True)}: no memory left for {stage}, at {held_mb:.0f} MB "
            f"(end other programs {way_out}: it goes on "
            "where it stopped)"
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
            f"{shown(path, tail=True)}: no memory left on the GPU for {stage} (end other programs that use it, "
            "or use --device cpu: it goes on where it stopped; "
            "or begin again with a smaller --work-side or fewer --splats)",
        )


class Interrupted(KeyboardInterrupt):
    """A signal that ends the program: Ctrl-C or SIGTERM.

    Of an own class, for Python compares by identity: a plain KeyboardInterrupt that passes through code compiled from text, as of a
    data class that is being made, ends the process by SIGINT in the end, although it was caught (``run_eval_code_obj``).
    """


class Cancelled(Exception):
    """The user asked to stop; raised from a progress callback, ends with exit code 130."""

"""What a drive tells of the solve that made it, and whether its files are of one."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import DriveError
from unveil_core.base.output.own_folder import EXCHANGE, NEW
from unveil_core.base.output.written import files_in, record_of

__all__ = ["SOLVED", "check_whole", "is_solved", "told_of_solve"]

SOLVED = "solve.json"
"""Lies beside a drive whose cameras and points ``unveil solve`` found in photographs."""


def check_whole(path: Path) -> None:
    """Check that no command was ended while it put new files in the places of old ones.

    Args:
        path: of the drive, or of another folder of the program's, or a file in it.
    Raises:
        DriveError: one was.
    """
    folder = _folder_of(path)
    if (folder / EXCHANGE).is_file():
        raise DriveError(
            "Not whole: a command was ended while it put its files here", path=folder, mend="call it again: it goes on"
        )


def is_solved(path: Path) -> bool:
    """Whether ``unveil solve`` made a drive, given as its folder or a file in it."""
    return (_folder_of(path) / SOLVED).is_file()


def told_of_solve(path: Path) -> tuple[str, ...]:
    """What a user should know of it, one line each."""
    folder = _folder_of(path)
    held = record_of(folder / SOLVED)
    if held is None:
        return ()
    names = held.get("footage")
    footage = ", ".join(map(str, names)) if isinstance(names, list) else "footage"
    lines = [f"solved from {footage}: {held.get('placed', '?')} of {held.get('frames', '?')} frames placed"]
    if (folder / NEW).is_dir() and files_in(folder / NEW):
        lines.append(
            "a later solve of this drive did not end, and what it made so far is not used: call unveil solve again"
        )
    return tuple(lines)


def _folder_of(path: Path) -> Path:
    return path if path.is_dir() else path.parent

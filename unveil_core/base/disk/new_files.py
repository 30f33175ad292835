"""New files and folders under names that nobody could guess, with the rights that the user's umask leaves.

``tempfile`` makes them for the owner alone; made public afterwards, they would be so whatever the umask says.
"""

from __future__ import annotations

import os
import secrets
import stat
from pathlib import Path

__all__ = ["mode_like", "new_file", "new_folder"]

NEW = (
    os.O_RDWR
    | os.O_CREAT
    | os.O_EXCL  # neither over a file nor through a link
    | getattr(os, "O_CLOEXEC", 0)
    | getattr(os, "O_BINARY", 0)
)
ATTEMPTS = 100
"""At names: each has 48 random bits."""


def new_file(folder: Path, start: str, end: str, mode: int = 0o666) -> tuple[int, Path]:
    """Handle and path of a new, empty file.

    Args:
        start, end: of its name, with random letters between them.
        mode: its rights, of which the umask takes some away.
    Raises:
        OSError: it cannot be made.
    """
    for _ in range(ATTEMPTS):
        path = folder / f"{start}{secrets.token_hex(6)}{end}"
        try:
            return os.open(path, NEW, mode), path
        except FileExistsError:
            continue
    raise FileExistsError(f"{folder}: no name is free")


def new_folder(folder: Path, start: str, end: str) -> Path:
    """A new, empty folder; see :func:`new_file`."""
    for _ in range(ATTEMPTS):
        path = folder / f"{start}{secrets.token_hex(6)}{end}"
        try:
            path.mkdir()
            return path
        except FileExistsError:
            continue
    raise FileExistsError(f"{folder}: no name is free")


def mode_like(source: Path | str | None) -> int:
    """Rights of what is made from a file, for :func:`new_file`: who may not read that may not read this either.

    Args:
        source: None, or what cannot be looked at: any.
    """
    if source is None:
        return 0o666
    try:
        found = stat.S_IMODE(os.stat(source).st_mode)
    except (OSError, ValueError):
        return 0o666
    return found & 0o666 | 0o600  # the owner replaces it when it is made anew

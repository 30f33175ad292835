"""Which files the batch command saved for a workspace: these it may save over, others are somebody's.

For each place the workspace keeps size and time of the file that was put there. A file that was changed since is its owner's.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path

from ..formats.files import own_folder, write_whole
from ..formats.open_safely import json_in

__all__ = ["is_somebodys", "note_saved"]

FILE = "saved.json"


def is_somebodys(workspace: Path, path: Path) -> bool:
    """Whether something lies at a path that the command did not save there for this workspace, or that was changed since."""
    if not os.path.lexists(path):
        return False
    return path.is_symlink() or not path.is_file() or _known(workspace).get(_key(path)) != _stamp(path)


def note_saved(workspace: Path, path: Path) -> None:
    """Remember a file that was just saved; where the workspace cannot be written, it is not remembered."""
    with suppress(OSError):
        known = {**_known(workspace), _key(path): _stamp(path)}
        write_whole(own_folder(workspace, "blender") / FILE, json.dumps(known).encode())


def _known(workspace: Path) -> dict[str, object]:
    with suppress(OSError, ValueError):
        known = json_in(workspace / "blender" / FILE)
        return known if isinstance(known, dict) else {}
    return {}


def _key(path: Path) -> str:
    """Of a place: paths of a user's folders are nobody else's business."""
    return hashlib.blake2b(os.fsencode(path.parent.resolve() / path.name), digest_size=16).hexdigest()


def _stamp(path: Path) -> list[int]:
    found = path.stat()
    return [found.st_size, found.st_mtime_ns]

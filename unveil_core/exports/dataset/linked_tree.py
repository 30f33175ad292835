"""A copy of a folder that takes no room: files by hard links, else by symbolic links, else as copies; some of them replaced."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

__all__ = ["link_file", "linked_tree"]


def link_file(source: Path, target: Path) -> None:
    """Let ``target``, which is not there yet, be the same file: a hard link, else a symbolic one, else a copy.

    Raises:
        OSError: it cannot be made.
    """
    whole = os.path.realpath(source)
    for make in (os.link, os.symlink):
        try:
            make(whole, target)
            return
        except OSError:
            if os.path.lexists(target):
                raise
    shutil.copyfile(whole, target)


def linked_tree(source: Path, target: Path, put: Mapping[str, Callable[[Path], None]]) -> int:
    """Make ``target`` a copy of a folder by links. What was a link to a folder is one again, unless something in it is put anew.

    Args:
        source: the folder; target: made if need be.
        put: by name, relative to the folder and with "/", what writes a file in the place of the one that is there.
    Returns:
        the number of files that are links or copies.
    Raises:
        OSError: something cannot be read or made.
    """
    above = {"/".join(name.split("/")[:k]) for name in put for k in range(1, name.count("/") + 1)}
    linked = 0
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        (target / inside).mkdir(parents=True, exist_ok=True)
        with os.scandir(source / inside) as entries:
            for entry in sorted(entries, key=lambda e: e.name):
                name = f"{inside}/{entry.name}" if inside else entry.name
                if name in put:
                    put[name](target / name)
                elif entry.is_dir(follow_symlinks=name in above):
                    waiting.append(name)
                elif entry.is_dir():
                    os.symlink(os.path.realpath(entry.path), target / name, target_is_directory=True)
                elif entry.is_file():
                    link_file(Path(entry.path), target / name)
                    linked += 1
    return linked

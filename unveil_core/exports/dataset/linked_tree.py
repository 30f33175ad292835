"""A copy of a folder that takes no room: files by hard links, else by symbolic links, else as copies; some of them replaced."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

__all__ = ["is_within", "link_file", "linked_tree"]


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


def is_within(path: Path | str, folder: Path) -> bool:
    """Whether a path lies in a folder, links followed."""
    return os.path.realpath(path).startswith(os.path.join(os.path.realpath(folder), ""))


def linked_tree(source: Path, target: Path, put: Mapping[str, Callable[[Path], None]]) -> list[str]:
    """Make ``target`` a copy of a folder by links. What was a link to a folder is one again, unless something in it is put anew.

    Links that lead out of the folder are left out: what they name is nobody's to pass on. Of a folder behind such a link there is
    what is put anew alone.

    Args:
        source: the folder; target: made if need be.
        put: by name, relative to the folder and with "/", what writes a file in the place of the one that is there.
    Returns:
        the names of what was left out.
    Raises:
        OSError: something cannot be read or made.
    """
    above = {"/".join(name.split("/")[:k]) for name in put for k in range(1, name.count("/") + 1)}
    left_out = []
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
                elif not entry.is_dir() and not entry.is_file():
                    continue
                elif not is_within(entry.path, source):
                    left_out.append(name)
                elif entry.is_dir():
                    there = target / os.path.relpath(os.path.realpath(entry.path), os.path.realpath(source))
                    os.symlink(os.path.relpath(there, target / inside), target / name, target_is_directory=True)
                else:
                    link_file(Path(entry.path), target / name)
    return left_out

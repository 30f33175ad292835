"""What is made of files that others may not read, they may not read either."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from functools import reduce
from operator import and_
from pathlib import Path

from unveil_core.base.disk.new_files import mode_like

__all__ = ["keep_rights", "rights_of", "rights_of_files"]

ANY = 0o666


def rights_of(folders: Iterable[Path]) -> int:
    """The rights that all files in some folders and below them have in common; all rights where there are none."""
    walked = (walked for folder in folders for walked in os.walk(folder))
    return rights_of_files(os.path.join(place, name) for place, _, names in walked for name in names)


def rights_of_files(files: Iterable[Path | str]) -> int:
    """The same of files."""
    return reduce(and_, map(mode_like, files), ANY)


def keep_rights(made: Iterable[Path], rights: int) -> None:
    """Take from files, and from all files in folders, what is not among ``rights``; the owner keeps his.

    A file with a second name is left as it is: it may be the user's own.
    """
    if os.name == "nt" or rights & ANY == ANY:
        return
    for path in made:
        for file in path.rglob("*") if path.is_dir() else (path,):
            found = os.lstat(file)
            mode = stat.S_IMODE(found.st_mode)
            if stat.S_ISREG(found.st_mode) and found.st_nlink == 1 and mode & ~rights & 0o077:
                os.chmod(file, mode & (rights | 0o700))

"""A folder beside the place of a result, which is made there and then renamed; gone afterwards, whatever happens."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from unveil_core.base.checks.names import is_file_name
from unveil_core.base.disk.open_safely import open_in_place, read_bytes
from unveil_core.base.file_locks import lock_file
from unveil_core.base.files import move, write_bytes_atomic

__all__ = ["exchanged", "scratch_folder"]

HELD = "held"
"""A file in it that is locked as long as somebody works there; the system drops the lock with the process."""
PLACE, BEFORE = "place", "before"
"""While a folder takes the place of another: that one, and what the place is called."""


@contextmanager
def scratch_folder(parent: Path, name: str) -> Iterator[Path]:
    """An empty folder ``.NAME.….partial`` in ``parent``, which is made if need be, and removed again if nothing came of it.

    Those that a kill left there are removed, and what was to be replaced is put back.
    """
    new = [p for p in (parent, *parent.parents) if not p.exists()]
    parent.mkdir(parents=True, exist_ok=True)
    _tidy(parent, name)
    # Under another name until it is locked: nobody takes it for one that a kill left.
    made = Path(tempfile.mkdtemp(prefix=f".{name}.", suffix=".begun", dir=parent))
    handle = open_in_place(made / HELD, os.O_RDWR | os.O_CREAT)
    folder = made.with_suffix(".partial")
    try:
        with suppress(OSError):  # a file system without locks
            lock_file(handle)
        move(made, folder)
        yield folder
    finally:
        os.close(handle)
        for place in (made, folder):
            shutil.rmtree(place, ignore_errors=True)
        for above in new:
            with suppress(OSError):  # something is in it
                above.rmdir()


def exchanged(made: Path, place: Path) -> None:
    """Put a folder that was made in a scratch folder in its place; what lies there goes into the scratch folder.

    Raises:
        OSError: it cannot be done; all is as it was then.
    """
    scratch = made.parent
    write_bytes_atomic(scratch / PLACE, place.name.encode(errors="surrogateescape"))
    if place.exists():
        move(place, scratch / BEFORE)
    try:
        move(made, place)
    except OSError:
        with suppress(OSError):
            move(scratch / BEFORE, place)
        raise


def _tidy(parent: Path, name: str) -> None:
    """Remove what kills left, in which nobody works."""
    pattern = re.compile(rf"\.{re.escape(name)}\.[a-z0-9_]{{8}}\.(begun|partial)")
    with os.scandir(parent) as entries:
        left = [Path(e.path) for e in entries if pattern.fullmatch(e.name) and e.is_dir(follow_symlinks=False)]
    for folder in left:
        try:
            handle = open_in_place(folder / HELD, os.O_RDWR)
        except OSError:
            continue  # just begun, or nobody's
        try:
            lock_file(handle)
        except OSError:
            continue
        else:
            _put_back(folder)
            shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(handle)


def _put_back(folder: Path) -> None:
    """Where the kill came between two renames: the old result, to its place."""
    with suppress(OSError):
        called = os.fsdecode(read_bytes(folder / PLACE, 1000, links=False))
        place = folder.parent / called
        if is_file_name(called) and not os.path.lexists(place) and (folder / BEFORE).is_dir():
            move(folder / BEFORE, place)

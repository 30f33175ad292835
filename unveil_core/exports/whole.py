"""An exported file or folder appears whole, or not at all: it is made under a temporary name beside its place and renamed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from unveil_core import __version__
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import move, write_json_atomic

__all__ = ["TOLD", "check_free", "tell", "whole_file", "whole_folder"]

TOLD = "export.json"
"""The file in each exported folder that tells what it is. A folder that has it was exported, and may be replaced."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary file name with the suffix of ``path`` to write to; renamed to ``path`` at the end, removed on an error.

    A file beside it whose name continues its own, as ``made.ply.json``, goes along, first.
    """
    with _scratch(path.parent) as folder:
        made = folder / f"made{path.suffix}"
        yield made
        beside = [p for p in folder.iterdir() if p.name.startswith(made.name) and p != made]
        for file in (*beside, made):
            with file.open("rb+") as stream:
                os.fsync(stream.fileno())
            move(file, path.with_name(path.name + file.name.removeprefix(made.name)))


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A temporary folder to fill; renamed to ``path`` at the end, in the place of an older export; removed on an error.

    Raises:
        SettingsError: see :func:`check_free`.
    """
    check_free(path)
    with _scratch(path.parent) as folder:
        made, before = folder / "made", folder / "before"
        made.mkdir()
        yield made
        if path.exists():
            move(path, before)
        try:
            move(made, path)
        except OSError:
            with suppress(OSError):
                move(before, path)
            raise


@contextmanager
def _scratch(parent: Path) -> Iterator[Path]:
    """A temporary folder in ``parent``, which is made if need be, and removed again if nothing came of it."""
    new = [p for p in (parent, *parent.parents) if not p.exists()]
    parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=".export.", suffix=".partial", dir=parent))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        for made in new:
            with suppress(OSError):  # something is in it
                made.rmdir()


def tell(folder: Path, name: str, content: Mapping[str, Any]) -> None:
    """Write :data:`TOLD` into a folder of format ``name``, with what a program cannot see in its files."""
    write_json_atomic(folder / TOLD, {"format": name, "generator": f"unveil {__version__}", **content})


def check_free(path: Path) -> None:
    """Refuse a folder that holds something else than an export.

    Raises:
        SettingsError: with the folder and the mend.
    """
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise SettingsError("is there already, and no folder", path=path, mend="name another place with -o")
    if path.is_dir() and not (path / TOLD).is_file() and any(path.iterdir()):
        raise SettingsError("is a folder of something else", path=path, mend="empty it, or name another place with -o")

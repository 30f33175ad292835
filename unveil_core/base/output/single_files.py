"""Single files that the program makes, wherever they lie: what it made may be made again, others are somebody's.

A file alone has no place in which it could be marked, so there are receipts: of exports in their workspace, of pages and
measurements in the user's cache. For each place there is the stamp of the file that was put there. A file that was changed since is
the user's own.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import move, write_json_atomic
from unveil_core.base.output.scratch import scratch_folder
from unveil_core.base.output.stamps import Stamp, is_unchanged, stamp_of
from unveil_core.base.output.written import GENERATOR, record_of
from unveil_core.base.surroundings.user_cache import user_cache_folder

__all__ = ["Receipts", "of_user", "receipts_at", "whole_file"]

OF_USER = "receipts.json"
MOST_OF_USER = 2000
"""Receipts of a user that are kept, the latest."""


@dataclass(frozen=True)
class Receipts:
    """Attributes:
    path: of the file of receipts.
    known: stamps, by the digest of a place: paths of a user's folders are nobody else's business.
    replace: whether the user said that other files may be written over.
    """

    path: Path
    known: dict[str, Stamp] = field(default_factory=dict)
    replace: bool = False

    def check(self, place: Path) -> None:
        """Check that a file may be put in a place.

        Raises:
            SettingsError: a folder lies there, or a file that Unveil did not make, or that was changed since.
        """
        if not os.path.lexists(place):
            return
        if place.is_dir() and not place.is_symlink():
            raise SettingsError("A folder, and a file is to be written here", path=place, mend="name a file in it")
        if not self.replace and not is_unchanged(place, self.known.get(_key(place))):
            raise SettingsError(
                "Not replaced: Unveil did not write it, or it was changed since",
                path=place,
                mend="name another place with -o, or add --replace to write over it",
            )

    def note(self, made: Path, place: Path) -> None:
        """Remember a file that is about to be moved to its place. Where the receipts cannot be written, it is not remembered."""
        key = _key(place)
        self.known.pop(key, None)
        self.known[key] = stamp_of(made)
        with suppress(OSError):
            write_json_atomic(self.path, {"generator": GENERATOR, "files": self.known})


def receipts_at(path: Path, *, replace: bool = False) -> Receipts:
    """The receipts in a file; none where it is damaged or not there."""
    listed = (record_of(path) or {}).get("files")
    entries = list(listed.items())[-MOST_OF_USER:] if isinstance(listed, dict) else ()
    return Receipts(path, {k: v for k, v in entries if isinstance(v, list)}, replace)


def of_user(*, replace: bool = False) -> Receipts:
    """The receipts of files that belong to no workspace."""
    return receipts_at(user_cache_folder() / OF_USER, replace=replace)


@contextmanager
def whole_file(path: Path, receipts: Receipts) -> Iterator[Path]:
    """A temporary file name with the suffix of ``path`` to write to; renamed to ``path`` at the end, removed on an error.

    A file beside it whose name continues its own, as ``made.ply.json``, goes along, first.

    Raises:
        SettingsError: another file lies at its place, or at that of one that goes along; nothing is changed then.
    """
    with scratch_folder(path.parent, "export") as folder:
        made = folder / f"made{path.suffix}"
        yield made
        beside = [p for p in folder.iterdir() if p.name.startswith(made.name) and p != made]
        places = {file: path.with_name(path.name + file.name.removeprefix(made.name)) for file in (*beside, made)}
        for place in places.values():
            receipts.check(place)
        for file, place in places.items():
            with file.open("rb+") as stream:
                os.fsync(stream.fileno())
            receipts.note(file, place)
            move(file, place)


def _key(place: Path) -> str:
    whole = os.fsencode(place.parent.resolve() / place.name)
    return hashlib.blake2b(whole, digest_size=16).hexdigest()

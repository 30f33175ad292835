"""Which files a workspace's exports made, wherever they lie: these may be exported again, others are somebody's.

The formats of single files have no place in which all of them could be marked, so the workspace keeps the receipts: for each
place size and time of the file that was put there. A file that was changed since is the user's own.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.written import GENERATOR, record_of

__all__ = ["Receipts", "read_receipts"]

FILE = ".exports.json"


@dataclass(frozen=True)
class Receipts:
    """Attributes:
    path: of the workspace's file of receipts.
    known: size and time, by the digest of a place: paths of a user's folders are nobody else's business.
    replace: whether the user said that other files may be written over.
    """

    path: Path
    known: dict[str, list[int]] = field(default_factory=dict)
    replace: bool = False

    def check(self, place: Path) -> None:
        """Check that a file may be put in a place.

        Raises:
            SettingsError: a folder lies there, or a file that no export of this workspace made.
        """
        if not os.path.lexists(place):
            return
        if place.is_dir() and not place.is_symlink():
            raise SettingsError("A folder, and a file is to be written here", path=place, mend="name a file in it")
        if not self.replace and (place.is_symlink() or self.known.get(_key(place)) != _stamp(place)):
            raise SettingsError(
                "Not replaced: no export of this workspace made it, or it changed since",
                path=place,
                mend="name another place with -o, or add --replace to write over it",
            )

    def note(self, made: Path, place: Path) -> None:
        """Remember a file that is about to be moved to its place. Where the workspace cannot be written, it is not remembered."""
        self.known[_key(place)] = _stamp(made)
        with suppress(OSError):
            write_json_atomic(self.path, {"generator": GENERATOR, "files": self.known})


def read_receipts(root: Path, *, replace: bool = False) -> Receipts:
    """The receipts of the workspace ``root``; none where its file is damaged or not there."""
    path = root / FILE
    listed = (record_of(path) or {}).get("files")
    entries = listed.items() if isinstance(listed, dict) else ()
    known = {k: v for k, v in entries if isinstance(v, list) and [type(n) for n in v] == [int, int]}
    return Receipts(path, known, replace)


def _key(place: Path) -> str:
    whole = os.fsencode(place.parent.resolve() / place.name)
    return hashlib.blake2b(whole, digest_size=16).hexdigest()


def _stamp(file: Path) -> list[int]:
    stat = file.stat()
    return [stat.st_size, stat.st_mtime_ns]

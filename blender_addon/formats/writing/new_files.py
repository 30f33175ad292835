# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are written into a folder together: they get their names at the end, or nothing there is touched. No bpy here.

A record in the folder, laid out as the command has it, lists what was written with a digest of each. Only what is listed and was
not changed since is replaced or removed: anything else is somebody's, and a link leads to what is.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from ..files import discard, is_link, move, write_whole
from ..open_safely import LARGEST_SCENE, LARGEST_TEXT, json_in, open_file

__all__ = ["GENERATOR", "NewFiles", "Somebodys", "new_files", "record_of"]

RECORD = ".unveil.json"
GENERATOR = "Unveil in Blender"
"""Who wrote the folder. Where the command itself did, it may write there again; a shot is somebody's drive to it."""
LISTS = ("files", "coming")
"""Of a record: digests by name of what was written, and of what is about to get its name."""
LITTER = {".ds_store", "thumbs.db", "desktop.ini"}
"""Files that systems leave in each folder that somebody looks at; nobody's work."""
PARTIAL = re.compile(r"\.unveil-\w+\.partial")
"""Names of folders in which files are written before they get their names."""


class Somebodys(ValueError):
    """What is in the way is somebody's; one line that names it and gives the mend."""


@contextmanager
def new_files(
    folder: Path, names: Sequence[str], *, mend: str, replace: bool = False, whole: bool = True
) -> Iterator[NewFiles]:
    """Write files into a folder, which is made if need be; they get their names once the block has ended without an error.

    Args:
        names: patterns of all files that such a writer writes, relative to the folder, with "/".
        mend: of messages.
        replace: also what was changed since, or is somebody's, where it has a name of a file that is written.
        whole: nothing else lies in the folder, and what is not written again is removed; else files are added to what is there.
    Raises:
        Somebodys: it is in the way. OSError: a link is; or a file cannot be read or written.
    """
    files = NewFiles(folder, names, mend=mend, replace=replace, whole=whole)
    try:
        yield files
        files.take_place()
    finally:
        files.clear()


class NewFiles:
    """Files on their way into a folder; see :func:`new_files`.

    Attributes:
        folder: where they go.
        before: digests by name of what was written there and is as it was then.
        of: what the files are made of, for the writer to know again; of those before, until it is set.
    """

    def __init__(self, folder: Path, names: Sequence[str], *, mend: str, replace: bool, whole: bool) -> None:
        self.folder, self._names, self._mend, self._replace = folder, names, mend, replace
        self._record = record_of(folder)
        self.of = str(self._record.get("of", ""))
        listed = [self._record[key] for key in LISTS if key in self._record]
        self._stamps: dict[str, tuple[int, ...]] = {}
        self.before: dict[str, str] = {}
        for name in self._found(whole):
            self._stamps[name] = _stamp(folder / name)
            noted = [known[name] for known in listed if name in known]
            if noted and (digest := _digest(folder / name)) in noted:
                self.before[name] = digest
            elif whole:
                self._refuse(name)
        self._kept = {} if whole else {**self._record.get("files", {}), **self.before}
        self._partial: Path | None = None

    def path(self, name: str) -> Path:
        """Where a file is written for now: a folder that nobody else reads.

        Raises:
            OSError: it cannot be made.
        """
        if self._partial is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            left = str(self._record.pop("partial", ""))  # by one that was ended
            if PARTIAL.fullmatch(left) and not is_link(self.folder / left):
                shutil.rmtree(self.folder / left, ignore_errors=True)
            self._partial = Path(tempfile.mkdtemp(".partial", ".unveil-", self.folder))
            self._note()
        path = self._partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def keep(self, *names: str) -> None:
        """Let files of :attr:`before` stay."""
        self._kept.update((name, self.before[name]) for name in names)

    def take_place(self) -> None:
        """Give the files their names, and remove those of before that are neither written again nor kept.

        Raises:
            Somebodys: something came in the way meanwhile. OSError: a file cannot be renamed.
        """
        if self._partial is None:
            return
        if not self._is_noted():
            raise Somebodys(f"{self.folder}: Another Blender writes here (try again when it has ended)")
        written = [path for path in sorted(self._partial.rglob("*")) if path.is_file()]
        new = {path.relative_to(self._partial).as_posix(): _digest(path) for path in written}
        for name in new:
            target = self.folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            for place in {target, target.parent} - {self.folder}:
                _check_link(place)
            if os.path.lexists(target) and (name not in self.before or _stamp(target) != self._stamps[name]):
                self._refuse(name)
        # Noted before it is done: of one that is ended halfway the next one takes nothing for somebody's.
        self._record["coming"] = new
        self._note()
        for name in new:
            move(self._partial / name, self.folder / name)
        for name in set(self.before) - set(new) - set(self._kept):
            if _stamp(self.folder / name) == self._stamps[name]:
                discard(self.folder / name)
                with suppress(OSError):  # something else is in it
                    (self.folder / name).parent.rmdir()
        self._record = {**({"of": self.of} if self.of else {}), "files": {**self._kept, **new}}

    def clear(self) -> None:
        """Remove what did not get its name; where nothing was written at all, the folder that was made for it, too."""
        if self._partial is None:
            return
        mine = self._is_noted()
        shutil.rmtree(self._partial, ignore_errors=True)
        self._partial = None
        if mine and self._record:
            self._note()
        elif mine:
            discard(self.folder / RECORD)
            with suppress(OSError):  # something else is in it
                self.folder.rmdir()

    def _is_noted(self) -> bool:
        """Whether nobody else began to write here since."""
        return self._partial is not None and record_of(self.folder).get("partial") == self._partial.name

    def _note(self) -> None:
        partial = {"partial": self._partial.name} if self._partial else {}
        content = {"generator": GENERATOR, **self._record, **partial}
        write_whole(self.folder / RECORD, (json.dumps(content, indent=1) + "\n").encode())

    def _found(self, whole: bool) -> Iterator[str]:
        """Names of the files that are there, of those that may be written.

        Raises:
            Somebodys: something else is there. OSError: a link is.
        """
        folders = {"", *(name.rpartition("/")[0] for name in self._names)}
        for inside in sorted(folders):
            if not os.path.lexists(self.folder / inside):
                continue
            for path in sorted((self.folder / inside).iterdir()):
                _check_link(path)
                name = path.relative_to(self.folder).as_posix()
                if any(fnmatchcase(name, pattern) for pattern in self._names) and path.is_file():
                    yield name
                elif path.name.lower() in LITTER or name in (RECORD, self._record.get("partial")):
                    continue
                elif whole and not (name in folders and path.is_dir()):
                    self._refuse(name)

    def _refuse(self, name: str) -> None:
        """Unless it may be replaced: something that is there is not as it was written."""
        if not self._replace or (self.folder / name).is_dir() and any(fnmatchcase(name, n) for n in self._names):
            changed = name in self._record.get("files", {})
            what = "Changed since Unveil wrote it" if changed else "Not written by Unveil"
            raise Somebodys(f"{self.folder / name}: {what}, and so not replaced ({self._mend})")


def record_of(folder: Path) -> dict[str, Any]:
    """What the record in a folder tells; empty where there is none, or none of this add-on."""
    with suppress(OSError, ValueError):
        content = json_in(folder / RECORD, LARGEST_TEXT)
        if isinstance(content, dict) and content.pop("generator", "") == GENERATOR:
            return {key: value for key, value in content.items() if key not in LISTS or isinstance(value, dict)}
    return {}


def _check_link(path: Path) -> None:
    if is_link(path):
        raise OSError(errno.ELOOP, "is a link, and files would be written through it (remove the link)", str(path))


def _stamp(path: Path) -> tuple[int, ...]:
    found = path.lstat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def _digest(path: Path) -> str:
    with open_file(path, LARGEST_SCENE) as stream:
        return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()

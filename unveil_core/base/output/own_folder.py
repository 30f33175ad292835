"""A folder of results that one command after another writes, as a solved drive, mattes, renders: the one way to write it.

.lock                     held by who writes
.unveil.json              what was written, each file with its stamp
.unveil.new/              new files, under the names that they are going to have; others may not look into it
.unveil.exchange.json     while new files take their places

One command at a time works there. Nothing in it leads elsewhere. New files are made beside, and take their places at the end, under
a journal: whatever ends the command, the next one finds all old files or all new ones. Only what is on the list and is as it was
written is replaced or removed; with ``replace``, what has the name of a new file, too.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from unveil_core.base.checks.names import is_inside
from unveil_core.base.disk.links import LOCK, refuse_links
from unveil_core.base.disk.lock import WRITABLE, Lock, may_lock
from unveil_core.base.disk.rights import keep_rights
from unveil_core.base.errors import DiskFullError, SettingsError, WorkspaceError
from unveil_core.base.files import full_disk, move, read_own_json, write_json_atomic
from unveil_core.base.output.stamps import Stamp, is_as_it_was, is_unchanged, stamp_of
from unveil_core.base.output.written import GENERATOR, LARGEST_RECORD, RECORD, files_in, is_ours, record_of, stamps_in

__all__ = ["EXCHANGE", "NEW", "OwnFolder"]

NEW, EXCHANGE = ".unveil.new", ".unveil.exchange.json"
"""Names that nobody else's files have: what is in the folder of new files is thrown away."""
MEND = "move it away, or name another folder with -o"


class OwnFolder:
    """Such a folder, as a context in which it is held.

    Attributes:
        root: the folder; new: where new files are made.
        written: what was written before, with stamps.
    """

    def __init__(
        self, root: Path, *, replace: bool = False, mend: str = MEND, says: Mapping[str, Any] | None = None
    ) -> None:
        """A folder that need not be there yet.

        Args:
            replace: whether files that are not on the list, or that were changed since, may be written over.
            mend: of the line that tells of one.
            says: what else stands in the list, as ``drive`` in that of a folder that is a drive.
        """
        self.root, self.new, self.replace, self.mend = Path(root), Path(root) / NEW, replace, mend
        self.says = dict(says or {})
        self.written: dict[str, Stamp | None] = {}
        self._lock = Lock(self.root / LOCK)
        self._lock_is_new = False
        self._made: list[Path] = []

    def __enter__(self) -> OwnFolder:
        """Hold it, and finish what a command before left half exchanged.

        Raises:
            SettingsError: it is a file. InUseError: another command works there. WorkspaceError: something in it is a link, a pipe
                or a device, or it cannot be written.
        """
        if self.root.exists() and not self.root.is_dir():
            raise SettingsError("Not a folder", path=self.root, mend="name a folder with -o")
        self._made = [p for p in (self.root, *self.root.parents) if not p.exists()]
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            refuse_links(self.root)
            self._check_names()
            self._lock_is_new = not (self.root / LOCK).exists()
            self._lock.__enter__()
        except OSError as error:
            raise self._cannot(error) from error
        try:
            for half in self.root.glob(f".{RECORD}.*.partial"), self.root.glob(f".{EXCHANGE}.*.partial"):
                for file in half:
                    file.unlink()
            self._finish()
            self.written = stamps_in(self.root) or {}
            if not self.new.exists():
                self.new.mkdir(mode=0o700)
        except BaseException as error:
            self.__exit__(None, None, None)
            if isinstance(error, OSError):
                raise self._cannot(error) from error
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of it; a folder that was made for nothing is removed again."""
        with suppress(OSError):
            self.new.rmdir()  # where nothing is left in it
        if self._lock_is_new and not any((self.root / n).exists() for n in (RECORD, NEW)):
            with suppress(OSError):
                (self.root / LOCK).unlink()
        self._lock.__exit__(kind, error, trace)
        for folder in self._made:
            with suppress(OSError):
                folder.rmdir()

    def begin_anew(self) -> None:
        """Throw away what a command that ended before its time left among the new files."""
        shutil.rmtree(self.new, ignore_errors=True)
        self.new.mkdir(mode=0o700, exist_ok=True)

    def changed(self) -> list[str]:
        """Names of the files on the list that somebody changed since."""
        return [name for name, stamp in self.written.items() if not is_as_it_was(self.root / name, stamp)]

    def check(self, names: Iterable[str]) -> None:
        """Check that files may be put in their places, before the work begins.

        Raises:
            SettingsError: something lies there that this program did not write, or that was changed since; it is named.
        """
        for name in names:
            place = self.root / name
            above = next((p for p in place.relative_to(self.root).parents if (self.root / p).is_file()), None)
            if above is not None:
                raise SettingsError("A file, and a folder is to be here", path=self.root / above, mend=self.mend)
            if place.is_dir():
                raise SettingsError("A folder, and a file is to be written here", path=place, mend=self.mend)
            if self.replace or not place.exists():
                continue
            if name not in self.written:
                raise SettingsError("Not written by Unveil, and so not replaced", path=place, mend=self.mend)
            if not is_as_it_was(place, self.written[name]):
                raise SettingsError("Changed since Unveil wrote it, and so not replaced", path=place, mend=self.mend)

    def exchange(self, *, drop: Collection[str] = (), rights: int = 0o666) -> None:
        """Put all new files in their places.

        Args:
            drop: files on the list that are to go, unless somebody changed them.
            rights: that new files have at most: who may not read what they show may not read them.
        Raises:
            SettingsError: see :meth:`check`; nothing is changed then.
        """
        names = [n for n in files_in(self.new) if not n.endswith(".partial")]
        self.check(names)
        self._lock.check()
        keep_rights([self.new], rights)
        entry = {
            "generator": GENERATOR,
            "files": {name: stamp_of(self.new / name) for name in names},
            "dropped": sorted(n for n in drop if n in self.written and n not in names),
        }
        write_json_atomic(self.root / EXCHANGE, entry)
        self._finish()
        self.written = stamps_in(self.root) or {}

    def _check_names(self) -> None:
        """Check that what is called as the folder's own files are is this program's."""
        record = self.root / RECORD
        if record.exists() and record_of(record) is None:
            raise SettingsError("Not written by Unveil, and so not replaced", path=record, mend=self.mend)
        if not may_lock(self.root / LOCK):
            raise SettingsError("Another program's file", path=self.root / LOCK, mend=self.mend)

    def _finish(self) -> None:
        """Do what the journal says, if there is one; what is done already is left out."""
        journal = self.root / EXCHANGE
        if not journal.is_file():
            return
        files, dropped = self._entry(journal)
        for name in files:
            if (self.new / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                move(self.new / name, self.root / name)
        before = stamps_in(self.root) or {}
        for name in dropped:
            if name in before and is_unchanged(self.root / name, before[name]):
                (self.root / name).unlink()
                self._remove_empty((self.root / name).parent)
        left = {n: s for n, s in before.items() if n not in dropped and (self.root / n).is_file()}
        write_json_atomic(self.root / RECORD, {"generator": GENERATOR, **self.says, "files": left | files})
        journal.unlink()
        self.begin_anew()

    def _entry(self, journal: Path) -> tuple[dict[str, Any], list[str]]:
        """Files and dropped ones of a journal: it may be a stranger's."""
        try:
            held = read_own_json(journal, LARGEST_RECORD)
            files, dropped = dict(held["files"]), list(held["dropped"])
            if not is_ours(held) or not all(map(is_inside, [*files, *dropped])):
                raise ValueError("not of this program")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise WorkspaceError("Not a journal of this program", path=journal, mend="delete it") from error
        return files, dropped

    def _remove_empty(self, folder: Path) -> None:
        while folder != self.root:
            try:
                folder.rmdir()
            except OSError:
                return
            folder = folder.parent

    def _cannot(self, error: OSError) -> Exception:
        if full := full_disk(error, self.root):
            return DiskFullError(full)
        return WorkspaceError(f"cannot be written: {error.strerror}", path=self.root, mend=WRITABLE)

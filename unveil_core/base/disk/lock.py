"""Who works in a folder of results has it for himself."""

from __future__ import annotations

import os
import platform
import re
import time
from contextlib import suppress
from pathlib import Path

from unveil_core.base.disk.open_safely import RefusedFileError, open_in_place, read_bytes
from unveil_core.base.errors import DiskFullError, InUseError, WorkspaceError
from unveil_core.base.file_locks import TAKEN, lock_file
from unveil_core.base.files import full_disk

__all__ = ["IN_USE", "NO_LOCKS_VARIABLE", "WRITABLE", "Lock", "may_lock"]

IN_USE = "In use by another process"
"""How the line of a command begins, after the workspace, that another process kept out."""
WRITABLE = "make it writable, or name another folder"
NO_LOCKS_VARIABLE = "UNVEIL_NO_LOCKS"
"""Of the environment; set to 1, a workspace whose file system has no locks is used all the same."""
SIGNED_AT = 1
"""Where in its file the holder is named: on Windows the byte that is locked, the first, cannot be read."""
LONGEST_SIGNATURE = 1000
"""Bytes in a lock file: a process and a host."""
MOST_FILES = 20
"""That are locked in turn where each is removed before it is known to be the one that the path names."""


class Lock:
    """One process at a time, or several that share. The operating system drops the lock with the process, however it ends.

    It is held on a file, and where the system can on its folder as well: a cleaner or a program that synchronizes
    may remove the file meanwhile, but not the folder. The file that is locked is the one that the path names: it is opened again
    where it was removed in between, and :meth:`check` puts it there again.

    Entering raises an InUseError where another process has it, and a WorkspaceError where the file system has no locks (some
    network file systems), the folder cannot be written, or the file is a link, a pipe or a device.
    """

    def __init__(self, path: Path, *, shared: bool = False) -> None:
        self.path, self.shared = path, shared
        self._handle: int | None = None
        self._folder: int | None = None

    def __enter__(self) -> Lock:
        try:
            self._folder = self._locked_folder()
            self._handle = self._locked_file()
        except BaseException:
            self._close()
            raise
        self._sign(self._handle)
        return self

    def __exit__(self, *exception: object) -> None:
        self._close()

    def check(self) -> None:
        """Check that what is held is still what another process would ask for; a file that was removed is made again.

        Raises:
            WorkspaceError: another process works here, or the folder is another one.
        """
        if self._handle is None:
            return
        if self._folder is not None and not _is_at(self._folder, self.path.parent):
            raise WorkspaceError("Another folder took its place", path=self.path.parent, mend="run it again")
        if _is_at(self._handle, self.path):
            return
        handle = self._locked_file()
        os.close(self._handle)
        self._handle = handle
        self._sign(handle)

    def _close(self) -> None:
        for handle in (self._handle, self._folder):
            if handle is not None:
                os.close(handle)
        self._handle = self._folder = None

    def _locked_folder(self) -> int | None:
        """The folder itself, locked; None where the system does not open folders or has no locks on them."""
        if os.name == "nt":
            return None
        try:
            handle = os.open(self.path.parent, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_DIRECTORY", 0))
        except OSError:
            return None  # what is wrong the file will tell
        try:
            self._wait_for(handle)
        except OSError as error:
            os.close(handle)
            if error.errno in TAKEN:
                raise self._in_use() from error
            return None
        return handle

    def _locked_file(self) -> int:
        for _ in range(MOST_FILES):
            handle = self._opened()
            try:
                self._wait_for(handle)
            except OSError as error:
                os.close(handle)
                if error.errno in TAKEN:
                    raise self._in_use() from error
                if os.environ.get(NO_LOCKS_VARIABLE) == "1":
                    return self._opened()
                raise WorkspaceError(
                    f"On a file system without locks, which cannot keep two runs apart: {error.strerror}",
                    path=self.path.parent,
                    mend=f"use a local disk; where no other run can come, set {NO_LOCKS_VARIABLE}=1",
                ) from error
            if _is_at(handle, self.path):
                return handle
            os.close(handle)  # it was removed before it was locked, and whoever comes locks another one
        raise InUseError(
            "Removed again and again", path=self.path, mend="stop the program that removes it, and run it again"
        )

    def _opened(self) -> int:
        """Handle of the file, made where it is not there."""
        try:
            return open_in_place(self.path, os.O_RDWR | os.O_CREAT)  # it is cut and written
        except FileNotFoundError as error:
            raise WorkspaceError("Not there any more", path=self.path.parent, mend="run it again") from error
        except RefusedFileError as error:
            raise WorkspaceError(str(error.strerror), path=self.path, mend="remove it: it holds no results") from error
        except OSError as error:
            if full := full_disk(error, self.path.parent):
                raise DiskFullError(full) from error
            problem = f"cannot be written: {error.strerror}"
            raise WorkspaceError(problem, path=self.path.parent, mend=WRITABLE) from error

    def _wait_for(self, handle: int) -> None:
        for patience in (0.05, 0.1, 0.2, 0.0):  # somebody may only look whether it is free, which takes no time
            try:
                lock_file(handle, self.shared)
                return
            except OSError as error:
                if error.errno not in TAKEN or not patience:
                    raise
                time.sleep(patience)

    def _in_use(self) -> InUseError:
        problem = f"{IN_USE}{self._holder()}"
        return InUseError(problem, path=self.path.parent, mend="wait or stop it")

    def _sign(self, handle: int) -> None:
        """Write who holds the lock into its file; of several who share it nobody."""
        with suppress(OSError):  # on a full disk it holds all the same
            os.ftruncate(handle, 0)
            if not self.shared:
                os.lseek(handle, SIGNED_AT, os.SEEK_SET)
                os.write(handle, f"{os.getpid()} on {platform.node()}".encode())

    def _holder(self) -> str:
        """Who wrote that, for the message; nothing where it cannot be told."""
        try:
            handle = open_in_place(self.path, os.O_RDONLY)
        except OSError:
            return ""
        try:
            os.lseek(handle, SIGNED_AT, os.SEEK_SET)
            signed = os.read(handle, 200).decode(errors="replace")
        except OSError:
            return ""
        finally:
            os.close(handle)
        return f", {signed}" if re.fullmatch(r"\d+ on [\w.-]+", signed) else ""


def _is_at(handle: int, path: Path) -> bool:
    """Whether a path names what is open."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except OSError:
        return False


def may_lock(path: Path) -> bool:
    """Whether a lock file that lies in a folder without workspace.json was left by this program: it is signed or still empty."""
    try:
        if not os.path.lexists(path):
            return True
        signed = read_bytes(path, LONGEST_SIGNATURE, links=False)
    except OSError:
        return False
    return not signed or re.fullmatch(rb"\0\d+ on [^\0\r\n]*", signed) is not None

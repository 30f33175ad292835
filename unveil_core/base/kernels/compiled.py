"""numba's compiler, with a cache on disk that several processes may fill at once.

numba numbers the compiled forms of a kernel (one for each combination of argument types) by what its index holds. Two processes
that compile two forms at the same time take the same number for both: the index then names one form, and the file holds the
other. Who loads it calls code for other types. Two runs on a fresh machine are enough for that. Here each form has a file of its
own name, and the index is written after it: at worst a form is missing from the index, and is compiled once more.

A kernel that another process is compiling is waited for instead of compiled a second time: workers that start together on a new
machine would otherwise all spend their first minutes on the same work.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock

from unveil_core.base.file_locks import TAKEN, lock_file

__all__ = ["njit"]

LONGEST_WAIT_S = 120.0
"""For another process that compiles the same kernel: the largest takes about 20 s, several times as long on a loaded machine. One
that was stopped in the middle (a suspended job) must not hold up the others for ever."""
LOOK_AGAIN_S = 0.02


class _NamedByForm(IndexDataCacheFile):
    """The files of one kernel: an index, one file for each compiled form, and a lock that its compiler holds."""

    _lock: int | None = None

    def load(self, key: object) -> Any:
        """A compiled form; ``None`` if there is none: this process has the lock then, and compiles it.

        Args:
            key: as in ``save``.
        """
        stored: Any = super().load  # numba's own methods have no types
        found = stored(key)
        if found is None and self._lock is None:
            self._lock = _lock_when_free(Path(str(self._index_path) + ".lock"))
            if self._lock is not None:
                found = stored(key)
        return found

    def compiled(self) -> None:
        """Let others have the lock: the form is saved, or could not be compiled."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def save(self, key: object, data: object) -> None:
        """Keep a compiled form.

        Args:
            key: argument types, processor and digest of the kernel's code.
            data: what numba stores of it.
        """
        form = hashlib.sha256(repr((self._source_stamp, key)).encode()).digest()
        files: Any = self
        name = files._data_name(int.from_bytes(form[:8], "big"))
        files._save_data(name, data)
        forms = files._load_index()
        if not forms:
            self._remove_outdated()
        files._save_index({**forms, key: name})

    def _remove_outdated(self) -> None:
        """Remove the forms of an earlier version of the source file: their names never come again."""
        index = Path(self._index_path)
        with suppress(OSError):  # there is no index yet: nothing is outdated
            before = index.stat().st_mtime_ns
            for file in index.parent.glob(self._data_name_pattern.replace("{number:d}", "*")):
                if file.stat().st_mtime_ns < before:
                    os.unlink(file)


def _lock_when_free(file: Path) -> int | None:
    """An open file that is locked; ``None`` where the folder cannot be written to or has no locks, or after the longest wait."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        return None
    end = time.monotonic() + LONGEST_WAIT_S
    while True:
        try:
            lock_file(handle)
            return handle
        except OSError as error:
            if error.errno not in TAKEN or time.monotonic() > end:
                os.close(handle)
                return None
            time.sleep(LOOK_AGAIN_S)


def njit(*function: Callable[..., Any], **options: Any) -> Any:
    """``numba.njit`` for a kernel whose compiled forms are kept (``cache=True``). Takes the same arguments, in the same ways."""
    if not function:
        return lambda decorated: njit(decorated, **options)
    compiler: Any = numba.njit
    dispatcher = compiler(*function, **options)
    if options.get("cache"):
        files = dispatcher._cache._cache_file
        files.__class__ = _NamedByForm
        compile_form = dispatcher.compile

        def compile_alone(signature: object) -> object:
            with global_compiler_lock:  # numba's own: of several threads one compiles
                try:
                    return compile_form(signature)
                finally:
                    files.compiled()

        dispatcher.compile = compile_alone
    return dispatcher

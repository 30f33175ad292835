"""numba's compiler, with a cache on disk that several processes may fill at once.

numba numbers the compiled forms of a kernel (one for each combination of argument types) by what its index holds. Two processes
that compile two forms at the same time take the same number for both: the index then names one form, and the file holds the
other. Who loads it calls code for other types. Two runs on a fresh machine are enough for that. Here each form has a file of its
own name, and the index is written after it: at worst a form is missing from the index, and is compiled once more.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import IndexDataCacheFile

__all__ = ["njit"]


class _NamedByForm(IndexDataCacheFile):
    """The files of one kernel: an index, and one file for each compiled form."""

    def save(self, key: object, data: object) -> None:
        """Keep a compiled form.

        Args:
            key: argument types, processor and digest of the kernel's code.
            data: what numba stores of it.
        """
        form = hashlib.sha256(repr((self._source_stamp, key)).encode()).digest()
        files: Any = self  # numba's own methods have no types
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


def njit(*function: Callable[..., Any], **options: Any) -> Any:
    """``numba.njit`` for a kernel whose compiled forms are kept (``cache=True``). Takes the same arguments, in the same ways."""
    if not function:
        return lambda decorated: njit(decorated, **options)
    compiler: Any = numba.njit
    dispatcher = compiler(*function, **options)
    if options.get("cache"):
        dispatcher._cache._cache_file.__class__ = _NamedByForm
    return dispatcher

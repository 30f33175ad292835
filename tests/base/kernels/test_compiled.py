"""Compiled kernels on disk, which several processes may write at once."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numba.core.caching import IndexDataCacheFile

from unveil_core.base.kernels.compiled import _NamedByForm, njit


def written_at_once(kind: type[IndexDataCacheFile], folder: Path, step: str) -> list[object]:
    """What the forms 0 and 1 are read back as, after two writers that both saw an empty index.

    Args:
        step: before this step of the first writer the second one writes.
    """
    first, second, reader = (kind(str(folder), "kernel", "stamp") for _ in range(3))
    second._load_index = dict  # as it was when both began
    do = getattr(first, step)

    def after_the_second(*arguments: object) -> object:
        second.save("form 1", "code 1")
        return do(*arguments)

    setattr(first, step, after_the_second)
    first.save("form 0", "code 0")
    return [reader.load(f"form {i}") for i in range(2)]


@pytest.mark.parametrize("step", ["_load_index", "_save_index", "_save_data"])
def test_two_writers_never_file_one_form_as_another(step: str, tmp_path: Path) -> None:
    read = written_at_once(_NamedByForm, tmp_path, step)
    assert read[0] == "code 0" and read[1] in ("code 1", None)


def test_numba_alone_files_one_form_as_another(tmp_path: Path) -> None:
    """The reason for the class; once this fails, numba has mended it, and the class can go."""
    assert written_at_once(IndexDataCacheFile, tmp_path, "_save_data") == [None, "code 0"]


def test_forms_of_an_earlier_source_are_removed(tmp_path: Path) -> None:
    before = _NamedByForm(str(tmp_path), "kernel", "old")
    before.save("form", "old code")
    for file in tmp_path.iterdir():
        os.utime(file, ns=(10**18, 10**18 + (file.suffix == ".nbi")))
    after = _NamedByForm(str(tmp_path), "kernel", "new")
    assert after.load("form") is None
    after.save("form", "new code")
    after.save("other form", "more code")
    assert (after.load("form"), after.load("other form")) == ("new code", "more code")
    assert len(list(tmp_path.glob("*.nbc"))) == 2


def test_a_kernel_keeps_its_forms() -> None:
    @njit(cache=True)
    def double(x):
        return x + x

    assert double(2) == 4 and np.array_equal(double(np.ones(3)), np.full(3, 2.0))
    names = [Path(double.stats.cache_path, name) for name in double._cache._cache_file._load_index().values()]
    assert len(names) == 2 and all(name.is_file() for name in names)


def test_it_decorates_as_numba_does() -> None:
    @njit
    def plain(x):
        return x + 1

    assert plain(1) == 2 and njit(lambda x: x - 1)(1) == 0

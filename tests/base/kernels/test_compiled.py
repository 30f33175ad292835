"""Compiled kernels on disk, which several processes may write at once."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numba import types
from numba.core.caching import IndexDataCacheFile

from unveil_core.base.kernels import compiled
from unveil_core.base.kernels.compiled import _lock_when_free, _NamedByForm, njit

ROOT = Path(__file__).parents[3]


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


ONE_FORM = """
import sys, time
from unveil_core.base.kernels import compiled

@compiled.njit(cache=True)
def triple(x):
    return 3 * x

plain = triple._compiler.compile

def slowly(*arguments):
    print("compiles", flush=True)
    time.sleep(float(sys.argv[1]))
    return plain(*arguments)

triple._compiler.compile = slowly
print("begins", flush=True)
assert triple(5) == 15
"""


def test_a_kernel_that_another_process_compiles_is_waited_for(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(ONE_FORM)
    start = partial(
        subprocess.Popen,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "PYTHONPATH": str(ROOT)},
    )
    first = start([sys.executable, program, "6"])
    said = [first.stdout.readline() for _ in range(2)]
    second = start([sys.executable, program, "0"])
    rest = second.communicate(timeout=600)[0]
    assert said == ["begins\n", "compiles\n"] and first.wait(600) == 0
    assert rest == "begins\n" and second.returncode == 0


def test_one_that_ends_while_it_compiles_is_not_waited_for(tmp_path: Path) -> None:
    file = tmp_path / "kernel.nbi.lock"
    ended = _lock_when_free(file)
    assert ended is not None
    os.close(ended)
    again = _lock_when_free(file)
    assert again is not None
    os.close(again)


def test_after_the_longest_wait_it_is_compiled_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "LONGEST_WAIT_S", 0.1)
    held = _lock_when_free(tmp_path / "lock")
    assert held is not None and _lock_when_free(tmp_path / "lock") is None
    os.close(held)


def test_a_folder_that_takes_no_lock_does_without(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert _lock_when_free(tmp_path / "file/lock") is None


def test_threads_that_need_one_kernel_at_once_compile_it_once(tmp_path: Path) -> None:
    @njit(cache=True)
    def quadruple(x):
        return 4 * x

    with ThreadPoolExecutor(8) as pool:
        for _ in range(20):
            quadruple.overloads.clear()
            assert set(pool.map(quadruple.compile, [(types.int64,)] * 8)) == {
                quadruple.overloads[types.int64,].entry_point
            }

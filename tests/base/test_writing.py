"""Files are written whole or not at all, whoever holds them and wherever there is no room."""

from __future__ import annotations

import errno
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from unveil_core.base.files import full_disk, is_out_of_memory, move, write_atomic, write_bytes_atomic


def holding(times: int, winerror: int | None) -> Callable[[object, object], None]:
    """A rename of a system on which another program holds the file for so many attempts."""
    left, real = [times], os.replace

    def replace(source: object, target: object) -> None:
        if left[0]:
            left[0] -= 1
            error = PermissionError(errno.EACCES, "held")
            if winerror is not None:
                error.winerror = winerror  # type: ignore[attr-defined]
            raise error
        real(source, target)  # type: ignore[arg-type]

    return replace


@pytest.mark.parametrize("winerror", [5, 32])
def test_a_rename_waits_for_who_holds_the_file(winerror: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "replace", holding(3, winerror))
    (tmp_path / "a").write_text("old")
    write_bytes_atomic(tmp_path / "a", b"new")
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "new"


def test_it_does_not_wait_for_ever_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(os, "replace", holding(1000, 32))
    begun = time.monotonic()
    with pytest.raises(PermissionError):
        write_bytes_atomic(tmp_path / "a", b"new")
    assert time.monotonic() - begun > 0.9
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "old"


def test_what_may_not_be_renamed_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(os, "replace", holding(1, None))
    with pytest.raises(PermissionError):
        move(tmp_path / "a", tmp_path / "b")
    move(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_text() == "old"


@pytest.mark.parametrize("name", ["x" * 251 + ".png", "🚙" * 62 + "abc.png", "e\u0301 ö.json"])
def test_a_name_may_be_as_long_as_the_system_allows(name: str, tmp_path: Path) -> None:
    write_bytes_atomic(tmp_path / name, b"content")
    assert (tmp_path / name).read_bytes() == b"content" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(os.name == "nt" or os.uname().sysname == "Darwin", reason="names there are text")
def test_a_name_need_not_be_text(tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff\xfe.png")
    write_bytes_atomic(tmp_path / name, b"content")
    assert os.listdir(os.fsencode(tmp_path)) == [b"\xff\xfe.png"]


@pytest.fixture
def full(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB that has no room left."""
    disk = tmp_path / "full"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no right to mount a small disk")
    try:
        with (disk / "filler").open("wb", buffering=0) as stream, pytest.raises(OSError):
            while True:
                stream.write(bytes(4096))
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_the_disk_that_is_full_is_the_one_that_is_named(full: Path, tmp_path: Path) -> None:
    with pytest.raises(OSError) as raised:
        write_bytes_atomic(full / "file", bytes(9000))
    assert full_disk(raised.value, tmp_path / "workspace") == full / "file"
    assert full_disk(raised.value, full) == full
    assert [p.name for p in full.iterdir()] == ["filler"]
    with pytest.raises(OSError) as raised:  # NumPy passes neither number nor name on
        write_atomic(full / "file", lambda stream: np.zeros(9000).tofile(stream))
    assert full_disk(raised.value, full) == full
    assert full_disk(OSError(errno.EACCES, "no"), full) is None


def test_want_of_memory_is_known_from_every_library() -> None:
    most = 1 << 46
    for allocate in (
        lambda: np.zeros(most, np.uint8),
        lambda: torch.zeros(most, dtype=torch.uint8),
        lambda: bytearray(most),
        lambda: cv2.resize(np.zeros((1, 1), np.uint8), (2**31 - 1, 2**15 - 1)),
    ):
        with pytest.raises(Exception) as raised:
            allocate()
        assert is_out_of_memory(raised.value), repr(raised.value)
    for error in (ValueError("bad_alloc"), OSError(errno.ENOSPC, "no room"), RuntimeError("size mismatch")):
        assert not is_out_of_memory(error)

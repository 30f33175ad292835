"""Bare floats and archives: what is whole is read, anything else is one error, and nothing is unpickled or unpacked without end."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.binary import read_archive, read_floats


def test_floats_come_in_rows(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    values = np.arange(15, dtype="<f4")
    values.tofile(path)
    assert np.array_equal(read_floats(path, 5), values.reshape(3, 5))
    assert np.array_equal(read_floats(path, None), values)
    path.write_bytes(b"")
    assert read_floats(path, 5).shape == (0, 5)


def test_floats_that_are_cut_short_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    np.arange(14, dtype="<f4").tofile(path)
    with pytest.raises(DriveError, match="56 bytes do not make rows of 5"):
        read_floats(path, 5)
    path.write_bytes(b"abc")
    with pytest.raises(DriveError, match="Cut short"):
        read_floats(path, None)
    with pytest.raises(DriveError, match="cannot be read"):
        read_floats(tmp_path / "none.bin", 5)


def test_an_archive_gives_the_arrays_that_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=np.arange(3), b=np.ones((2, 2)), c=np.array([{}], dtype=object))
    b, a = read_archive(path, ["b", "a"])
    assert (b.shape, a.tolist()) == ((2, 2), [0, 1, 2])
    with pytest.raises(DriveError, match="Not an archive of arrays"):
        read_archive(path, ["c"])
    with pytest.raises(DriveError, match="lacks an array"):
        read_archive(path, ["d"])


@pytest.mark.parametrize("content", [b"", b"PK", b"\x93NUMPY\x01\x00", b"no archive"])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(DriveError, match="Not an archive of arrays"):
        read_archive(path, ["a"])


def test_an_archive_that_promises_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (1 << 50,)})
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("a.npy", stream.getvalue())
    with pytest.raises(DriveError, match="Not an archive of arrays"):
        read_archive(path, ["a"])


def test_an_archive_that_unpacks_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unveil_core.drives.formats.binary.MOST_BYTES", 10_000)
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=np.zeros(100_000))
    with pytest.raises(DriveError, match="unpacks to more than 10,000 bytes"):
        read_archive(path, ["a"])


@pytest.mark.parametrize(("at", "value"), [(6, 1), (6, 32), (4, 255)], ids=["encrypted", "a patch", "a later format"])
def test_an_archive_of_another_kind_is_refused(at: int, value: int, tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(3))
    content = bytearray(path.read_bytes())
    # Flags and version stand in the local header, and two bytes later in the directory.
    for signature, place in ((b"PK\x03\x04", at), (b"PK\x01\x02", at + 2)):
        content[content.index(signature) + place] = value
    path.write_bytes(bytes(content))
    with pytest.raises(DriveError, match="Not an archive of arrays"):
        read_archive(path, ["a"])

"""Pickles of a few bytes that ask for much: they end in one line, at once, in little memory."""

from __future__ import annotations

import gzip
import pickle
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.pandas_tables import read_table
from unveil_core.drives.formats.pickled import unpickler
from unveil_core.drives.formats.safe_pickle import read_archived_object, read_arrays

START = b"\x80\x04"
NEST = b"(K\x01t" + b"2\x86" * 60
"""A tuple of a tuple of itself, sixty deep: 2^60 numbers when each is looked at."""
WIDE = struct.pack("<i", 4_000_000)
ARRAY = b"cnumpy\nndarray\n"
RECONSTRUCT = b"cnumpy.core.multiarray\n_reconstruct\n(" + ARRAY + b"(K\x00tC\x01btR"
KIND = b"cnumpy\ndtype\n(X\x02\x00\x00\x00u1K\x00K\x01tR(K\x03X\x01\x00\x00\x00|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"


def text(word: str) -> bytes:
    return b"X" + struct.pack("<I", len(word)) + word.encode()


BOMBS = {
    "lists": START + b"(" + b"]" * 12_000_000 + b"l.",
    "marks": START + b"(" * 12_000_000 + b".",
    "dicts in one another": START + b"}K\x01" * 4_000_000 + b"s" * 4_000_000 + b".",
    "one of the memo": START + b"]\x94" + b"(" + b"h\x00" * 12_000_000 + b"l.",
    "sets": START + b"(" + b"\x8f" * 3_000_000 + b"l.",
    "a key of tuples": START + b"}" + NEST + b"K\x01s.",
    "keys of tuples": START + b"}(" + NEST + b"K\x01u.",
    "a key of tuples, in the old way": START + b"(" + NEST + b"K\x01d.",
    "a key of tuples in an ordered dict": START + b"ccollections\nOrderedDict\n((" + NEST + b"K\x01tltR.",
    "a frozen set of tuples": START + b"(" + NEST + b"\x91.",
    "a set of tuples": START + b"\x8f(" + NEST + b"\x90.",
    "tuples": START + NEST + b".",
    "lists of themselves": START + b"]\x94h\x00a.",
    "an object as a key": START + b"}" + KIND + b"K\x01s.",
    "a number of a megabyte": START + b"\x8b" + WIDE + b"\xff" * 4_000_000 + b".",
    "a number of ten bytes": START + b"\x8a\x0a" + b"\xff" * 10 + b".",
    "a number of many digits": START + b"I" + b"9" * 4_000 + b"\n.",
    "a long number of many digits": START + b"L" + b"9" * 4_000 + b"L\n.",
    "a shape of wide numbers": START + RECONSTRUCT + b"(K\x01(\x8b" + WIDE + b"\xff" * 4_000_000 + b"\x942tt" + KIND + b"b.",
    "a shape of many axes": START + RECONSTRUCT + b"(K\x01(" + b"K\x01" * 999 + b"t" + KIND + b"\x89C\x01\x00tb.",
    "one text as bytes many times": START + text("x" * 9_000_000) + b"\x940c_codecs\nencode\n\x940("
    + (b"h\x01h\x00" + text("latin1") + b"\x86R") * 1000 + b"l.",
    "one text as arrays many times": START + b"B" + struct.pack("<I", 9_000_000) + bytes(9_000_000) + b"\x940("
    + (RECONSTRUCT + b"(K\x01J" + struct.pack("<i", 9_000_000) + b"\x85" + KIND + b"\x89h\x00tb") * 1000 + b"l.",
}  # fmt: skip
READ = """
import sys
from pathlib import Path
from unveil_core.base.errors import DriveError
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.drives.formats.pandas_tables import read_table
before = peak_memory_mb()
for path in sys.argv[1:]:
    try:
        read_table(Path(path))
        print("read", path)
    except DriveError as error:
        print(path.rsplit("/")[-1], round(peak_memory_mb() - before), str(error)[-90:])
"""


def test_they_end_in_one_line_in_little_memory(tmp_path: Path) -> None:
    paths = []
    for name, content in BOMBS.items():
        paths.append(tmp_path / f"{name.replace(' ', '_')}.pkl.gz")
        paths[-1].write_bytes(gzip.compress(content))
    done = subprocess.run([sys.executable, "-c", READ, *map(str, paths)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    lines = done.stdout.splitlines()
    assert len(lines) == len(BOMBS)
    for line in lines:
        _, megabytes, *_ = line.split()
        # A gigabyte of arrays may be made, as of a sound file: no other counts more than the steps that it has.
        assert int(megabytes) < (1500 if "many_times" in line else 400), line


@pytest.mark.parametrize("name", [n for n in BOMBS if len(BOMBS[n]) < 1_000_000])
def test_small_ones_end(name: str, tmp_path: Path) -> None:
    path = tmp_path / "p.pkl"
    path.write_bytes(BOMBS[name])
    for read in (read_arrays, read_table):
        with pytest.raises(DriveError, match=r"Not a (readable pickle|table of pandas)"):
            read(path)


def test_zeros_that_are_packed_well_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "p.pkl.gz"
    path.write_bytes(gzip.compress(START + b"B" + struct.pack("<I", 200 << 20) + bytes(200 << 20) + b"."))
    with pytest.raises(DriveError, match=r"unpacks to more than \d+ MB"):
        read_arrays(path)
    packed = tmp_path / "a.npz"
    np.savez_compressed(packed, pointcloud=np.array({0: np.zeros((10_000_000, 3))}, dtype=object), allow_pickle=True)
    with pytest.raises(DriveError, match=r"unpacks to \d+ MB"):
        read_archived_object(packed, "pointcloud")


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_what_files_hold_is_read_in_every_protocol(tmp_path: Path, protocol: int) -> None:
    whole = {
        "a": [1, -(2**63), 2**64 - 1, 1.5, "x", None, True],
        3: {2.5: (1, 2)},
        np.int64(4): np.arange(6.0).reshape(2, 3),
    }
    path = tmp_path / "p.pkl"
    path.write_bytes(pickle.dumps(whole, protocol=protocol))
    found = read_arrays(path)
    assert found["a"] == whole["a"] and found[3] == whole[3]
    np.testing.assert_array_equal(found[4], np.arange(6.0).reshape(2, 3))


def test_a_scene_has_far_fewer_steps(tmp_path: Path) -> None:
    """Two hundred frames of five cameras, each with arrays of its own."""
    frames = [{f"camera {c}": {k: np.eye(4) * k for k in range(6)} for c in range(5)} for _ in range(200)]
    path = tmp_path / "p.pkl"
    path.write_bytes(pickle.dumps(frames, protocol=2))
    assert len(read_arrays(path)) == 200
    assert unpickler.MOST_STEPS > 1_000_000

"""Pickles of strangers: arrays and tables come out, and nothing that they name is run."""

from __future__ import annotations

import gzip
import io
import os
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drives.formats.pandas_pickles import table_pickle
from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.pandas_tables import read_table
from unveil_core.drives.formats.pickled import stand_ins
from unveil_core.drives.formats.safe_pickle import read_archived_object, read_arrays


class Calls:
    """Unpickled, it calls a function."""

    def __init__(self, function: Callable[..., Any], *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[object, ...]]:
        return self.call


def hostile(victim: Path) -> dict[str, object]:
    """By name, objects whose pickle makes the file ``victim`` when it is loaded without care."""
    touch = f"touch {victim}"
    loaded = victim.with_name("loaded.npy")
    np.save(loaded, np.array([Calls(os.system, touch)], dtype=object), allow_pickle=True)
    return {
        "os.system": Calls(os.system, touch),
        "eval": Calls(eval, f"open({str(victim)!r}, 'w').close()"),
        "exec": Calls(exec, f"open({str(victim)!r}, 'w').close()"),
        "numpy.load": Calls(np.load, str(loaded), None, True),
        "numpy.memmap": Calls(np.memmap, str(victim), "u1", "w+", 0, (1,)),
        "nested": {"frames": [np.zeros(2), (1, {"deep": Calls(os.system, touch)})]},
        "in an array": np.array([1, Calls(os.system, touch)], dtype=object),
        "a pickle in a call": Calls(pickle.loads, pickle.dumps(Calls(os.system, touch))),
    }


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


ATTACKS = (
    "os.system",
    "eval",
    "exec",
    "numpy.load",
    "numpy.memmap",
    "nested",
    "in an array",
    "a pickle in a call",
)


@pytest.mark.parametrize("name", ATTACKS)
@pytest.mark.parametrize("protocol", [0, 2, 3, 4, 5])
def test_a_hostile_pickle_runs_nothing(name: str, protocol: int, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    assert set(hostile(victim)) == set(ATTACKS)
    content = pickle.dumps(hostile(victim)[name], protocol=protocol)
    pickle.loads(content)
    assert victim.exists()  # the attack works where nothing holds it back
    victim.unlink()
    for suffix in (".pkl", ".pkl.gz"):
        path = write(tmp_path / f"00{suffix}", content)
        for read in (read_arrays, read_table):
            with pytest.raises(
                DriveError, match=r"00\.pkl.*no such file needs|00\.pkl.*Not a readable pickle"
            ) as caught:
                read(path)
            assert "\n" not in str(caught.value) and not victim.exists()


@pytest.mark.parametrize(
    "code",
    [
        b"cposix\nsystem\n(S'touch VICTIM'\ntR.",  # protocol 0, by hand
        b"(S'touch VICTIM'\niposix\nsystem\n.",  # INST
        b"(cposix\nsystem\nS'touch VICTIM'\no.",  # OBJ
        b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x0ctouch VICTIM\x85R.",  # STACK_GLOBAL
        b"\x80\x02\x82\x01.",  # of the registry of extensions
        b"P42\n.",  # persistent
        b"cnumpy.core.multiarray\n_reconstruct\n(cposix\nsystem\n(I0\ntS'b'\ntR.",
        b"cnumpy\ndtype.__reduce__\n.",  # a dotted name, out of what is admitted
        b"\x80\x04\x8c\x05numpy\x8c\x0fdtype.__class__\x93.",
        b"cbuiltins\nslice.__class__\n.",
    ],
)
def test_pickles_written_by_hand_run_nothing(code: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path / "00.pkl", code)
    for read in (read_arrays, read_table):
        with pytest.raises(DriveError, match="Not a readable pickle"):
            read(path)
    assert not (tmp_path / "VICTIM").exists()


class Stated:
    """Unpickled, NumPy's own type gets a state."""

    def __init__(self, *parts: object) -> None:
        self.parts = parts

    def __reduce__(self) -> tuple[object, ...]:
        return self.parts


def test_numbers_are_not_taken_for_pointers(tmp_path: Path) -> None:
    """A type whose state says that its bytes are objects: NumPy believes it, and follows them."""
    fields = {"a": (np.dtype("O"), 0)}
    pointers = Stated(np.dtype, ("V8", False, True), (3, "|", None, ("a",), fields, 8, 1, 63))
    wide = Stated(np.dtype, ("i8", False, True), (3, "<", None, None, None, 1 << 20, 1, 63))
    made = np.array([1.0]).__reduce__()[0]
    for kind in (pointers, wide):
        held = Stated(made, (np.ndarray, (0,), b"b"), (1, (1,), kind, False, b"\x41" * 8))
        path = write(tmp_path / "t.pkl", pickle.dumps({"x": held}, protocol=2))
        try:
            found = read_arrays(path)["x"]
        except DriveError as error:
            assert "neither numbers" in str(error)
        else:
            assert kind is wide and found.dtype == np.int64 and found.shape == (1,)


def test_functions_get_no_state(tmp_path: Path) -> None:
    path = write(tmp_path / "t.pkl", b"c_codecs\nencode\n(N}S'__defaults__'\n(S'x'\nS'latin1'\ntstb.")
    with pytest.raises(DriveError, match="state to what has none"):
        read_arrays(path)


def test_an_object_of_an_archive_runs_nothing(tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    for held in (Calls(os.system, f"touch {victim}"), {"points": Calls(os.system, f"touch {victim}")}):
        packed = np.empty((), dtype=object)
        packed[()] = held
        np.savez(tmp_path / "cloud.npz", cloud=packed)
        with pytest.raises(DriveError, match="no such file needs"):
            read_archived_object(tmp_path / "cloud.npz", "cloud")
    assert not victim.exists()


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
@pytest.mark.parametrize("suffix", [".pkl", ".pkl.gz"])
def test_arrays_come_out_as_they_went_in(protocol: int, suffix: str, tmp_path: Path) -> None:
    held = {
        "floats": np.arange(12.0).reshape(3, 4),
        "columns": np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3)),
        "names": np.array(["a", "b"], dtype=object),
        "none": np.zeros((0, 3), np.float32),
        "scalar": np.float64(2.5),
        "rest": [1, "x", b"\xff\x00", None, True, (1.5, 2)],
    }
    found = read_arrays(write(tmp_path / f"a{suffix}", pickle.dumps(held, protocol=protocol)))
    assert found["rest"] == held["rest"] and found["scalar"] == 2.5
    for name in ("floats", "columns", "names", "none"):
        assert found[name].dtype == held[name].dtype and np.array_equal(found[name], held[name])


@pytest.mark.parametrize("protocol", [2, 4, 5])
@pytest.mark.parametrize("release", ["1.0", "1.5", "2.x"])
@pytest.mark.parametrize("suffix", [".pkl", ".pkl.gz"])
def test_tables_come_out_as_they_went_in(protocol: int, release: str, suffix: str, tmp_path: Path) -> None:
    """As three generations of pandas write them: columns of several types, in blocks of theirs."""
    held = {
        "x": np.array([1.5, 2.5, 3.5]),
        "class": np.array([7, 13, 5], np.int64),
        "y": np.array([-1.0, 0.0, 1.0]),
        "label": np.array(["Car", "Bus", "Sign"], dtype=object),
    }
    found = read_table(write(tmp_path / f"t{suffix}", table_pickle(held, release=release, protocol=protocol)))
    assert list(found) == list(held)
    for name, values in held.items():
        assert found[name].dtype == values.dtype and np.array_equal(found[name], values)


def test_what_is_no_table_is_one_line(tmp_path: Path) -> None:
    for held in (np.zeros(3), {"x": np.zeros(3)}, [1, 2], None, "text"):
        with pytest.raises(DriveError, match=r"t\.pkl.*Not a table of pandas"):
            read_table(write(tmp_path / "t.pkl", pickle.dumps(held)))
    short = table_pickle({"x": np.zeros(3), "y": np.zeros(3)}, placed={"x": [0], "y": [0]})
    with pytest.raises(DriveError, match="Not a table of pandas"):
        read_table(write(tmp_path / "t.pkl", short))


@pytest.mark.parametrize("suffix", [".pkl", ".pkl.gz"])
def test_a_file_that_is_cut_anywhere_is_one_line(suffix: str, tmp_path: Path) -> None:
    columns = {"x": np.linspace(0, 1, 50), "i": np.arange(50)}
    whole = write(tmp_path / f"whole{suffix}", table_pickle(columns)).read_bytes()
    path = tmp_path / f"cut{suffix}"
    for length in (*range(0, len(whole), 37), len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DriveError, match="cut") as caught:
            read_table(path)
        assert "\n" not in str(caught.value)


def test_bytes_changed_at_random_are_an_error_or_another_table(tmp_path: Path) -> None:
    """Never anything else than DriveError, and nothing that takes long."""
    whole = bytearray(table_pickle({"x": np.linspace(0, 1, 8), "name": np.array(list("abcdefgh"), dtype=object)}))
    generator = np.random.default_rng(0)
    path = tmp_path / "t.pkl"
    for _ in range(400):
        changed = bytearray(whole)
        for at in generator.integers(0, len(changed), 2):
            changed[at] = generator.integers(0, 256)
        path.write_bytes(changed)
        try:
            read_table(path)
        except DriveError as error:
            assert "t.pkl" in str(error)


def test_a_missing_file_and_a_folder_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match=r"none\.pkl\.gz.*Not found"):
        read_table(tmp_path / "none.pkl.gz")
    (tmp_path / "folder.pkl").mkdir()
    with pytest.raises(DriveError, match=r"folder\.pkl"):
        read_table(tmp_path / "folder.pkl")


def test_a_bomb_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stand_ins, "MOST_BYTES", 100_000)
    packed = io.BytesIO()
    with gzip.GzipFile(fileobj=packed, mode="wb") as stream:
        for _ in range(300):
            stream.write(bytes(1 << 20))
    assert len(packed.getvalue()) < 400_000
    read = gzip.GzipFile.read
    asked: list[int | None] = []

    def watched(self: gzip.GzipFile, size: int | None = -1) -> bytes:
        asked.append(size)
        return read(self, size)

    monkeypatch.setattr(gzip.GzipFile, "read", watched)
    path = tmp_path / "00.pkl.gz"
    path.write_bytes(packed.getvalue())
    for reader in (read_arrays, read_table):
        with pytest.raises(DriveError, match=r"00\.pkl\.gz.*unpacks to more than"):
            reader(path)
    assert asked and all(size is not None and 0 < size <= 100_001 for size in asked)
    fits = pickle.dumps(np.zeros(10))
    path.write_bytes(gzip.compress(fits))
    assert read_arrays(path).shape == (10,)


def test_a_length_that_is_a_lie_takes_no_memory(tmp_path: Path) -> None:
    """BINBYTES8 of 2^60 bytes, and an array of as many numbers."""
    path = write(tmp_path / "t.pkl", b"\x80\x04\x8e" + struct.pack("<Q", 1 << 60) + b"x.")
    with pytest.raises(DriveError):
        read_arrays(path)
    made = np.array([1.0]).__reduce__()[0]
    path.write_bytes(pickle.dumps(Calls(made, np.ndarray, (1 << 58,), b"d"), protocol=4))
    with pytest.raises(DriveError, match=r"t\.pkl"):
        read_arrays(path)

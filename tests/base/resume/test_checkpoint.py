"""Results kept on disk: computed once, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.resume.checkpoint import Checkpoint, Kept, read_arrays, write_arrays


def test_a_result_is_computed_once(tmp_path: Path) -> None:
    calls: list[int] = []

    def make() -> dict[str, np.ndarray]:
        calls.append(1)
        return {"a": np.arange(3), "b": np.float32([[0.1, np.inf]])}

    kept = Kept(tmp_path / "kept").within("part")
    for _ in range(2):
        found = kept.once("sum", make)
        assert found["a"].tolist() == [0, 1, 2] and found["b"].dtype == np.float32 and np.isinf(found["b"][0, 1])
    assert len(calls) == 1
    assert Kept().once("sum", make)["a"].tolist() == [0, 1, 2] and len(calls) == 2


@pytest.mark.parametrize("left", [0, 3, 60, 200])
def test_a_damaged_file_counts_as_none(left: int, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    write_arrays(path, {"a": np.arange(100)})
    path.write_bytes(path.read_bytes()[:left])
    assert read_arrays(path) is None
    path.write_bytes(bytes(300))
    assert read_arrays(path) is None and read_arrays(tmp_path / "absent.npz") is None
    assert [p.name for p in tmp_path.iterdir()] == ["x.npz"]


def test_no_pickled_object_is_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", a=np.array([{"an": "object"}], dtype=object))
    assert read_arrays(tmp_path / "x.npz") is None


def test_what_is_packed_is_not_unpacked(tmp_path: Path) -> None:
    """Checkpoints are written as they are: a file takes no more memory than it has bytes."""
    np.savez_compressed(tmp_path / "x.npz", a=np.zeros(1 << 20))
    assert read_arrays(tmp_path / "x.npz") is None
    write_arrays(tmp_path / "y.npz", {"a": np.zeros(1 << 20), "b": np.zeros(0)})
    found = read_arrays(tmp_path / "y.npz")
    assert found is not None and found["a"].nbytes == 1 << 23


def test_a_checkpoint_brings_back_arrays_and_facts(tmp_path: Path) -> None:
    facts = {"order": [3, 1], "state": {"big": 2**127 + 1}, "loss": 0.1 + 0.2, "none": None}
    checkpoint = Checkpoint(tmp_path / "c.npz", every_s=0.0)
    assert checkpoint.due() and checkpoint.load() is None
    checkpoint.save({"x": np.arange(4.0)}, facts)
    found = checkpoint.load()
    assert found is not None and found[1] == facts and found[0]["x"].tolist() == [0, 1, 2, 3]
    assert not Checkpoint(tmp_path / "c.npz").due() and not Checkpoint().due() and Checkpoint().load() is None

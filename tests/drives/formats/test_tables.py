"""Tables of datasets: columns by meaning whatever their type, single rows of large ones, and files that are damaged."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import feather, parquet

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats import tables
from unveil_core.drives.formats.tables import Rows, array_of, read_columns

COLUMNS = {
    "key.time": pa.array([3, 1, 2], pa.int64()),
    "half": pa.array(np.array([0.5, 1.5, -2.0], np.float16)),
    "text": pa.array(["a", "b", "a"]).dictionary_encode(),
    "[Part].values": pa.array([[1.0, 2.0], None, [3.0, 4.0]], pa.list_(pa.float32())),
    "[Part].fixed": pa.array([[1.0, 2.0]] * 3, pa.list_(pa.float64(), 2)),
    "gaps": pa.array([1.0, None, 3.0]),
}


@pytest.fixture(params=["parquet", "feather"])
def path(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    written = tmp_path / f"table.{request.param}"
    if request.param == "parquet":
        parquet.write_table(pa.table(COLUMNS), written, row_group_size=2)
    else:
        feather.write_feather(pa.table(COLUMNS), str(written))
    return written


def test_columns_are_read_by_what_they_mean(path: Path) -> None:
    found = read_columns(path, list(COLUMNS), ("not there",))
    assert found.count == 3 and "not there" not in found
    assert found.integers("key.time").tolist() == [3, 1, 2]
    assert found.numbers("half").dtype == np.float64 and found.numbers("half").tolist() == [0.5, 1.5, -2.0]
    assert found.words("text") == ["a", "b", "a"] and found.words("key.time") == ["3", "1", "2"]
    assert found.lists("[Part].values")[1] is None
    np.testing.assert_array_equal(found.vectors("[Part].values", 2), [[1, 2], [np.nan, np.nan], [3, 4]])
    np.testing.assert_array_equal(found.vectors("[Part].fixed", 2), [[1, 2]] * 3)
    np.testing.assert_array_equal(found.numbers("gaps"), [1, np.nan, 3])


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
@pytest.mark.parametrize("unit", ["us", "ns"])
def test_times_count_from_1970_in_greenwich(tmp_path: Path, unit: str, zone: str | None) -> None:
    stamps = np.array([1_552_440_195_362_591, 1_552_440_195_462_613])
    path = tmp_path / "t.parquet"
    parquet.write_table(
        pa.table({"t": pa.array(stamps * (1000 if unit == "ns" else 1), pa.timestamp(unit, zone))}), path
    )
    assert read_columns(path, ["t"]).integers("t").tolist() == stamps.tolist()
    assert read_columns(path, ["t"]).integers("t", "ns").tolist() == (stamps * 1000).tolist()


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda c: c.integers("gaps"), "lacks gaps in 1 rows"),
        (lambda c: c.integers("text"), "other than integers in text"),
        (lambda c: c.numbers("[Part].fixed"), "other than numbers"),
        (lambda c: c.vectors("[Part].fixed", 3), "has 2 numbers in"),
        (lambda c: c.lists("text"), "other than lists of numbers in text"),
    ],
)
def test_columns_of_another_kind_are_told(path: Path, ask: object, said: str) -> None:
    with pytest.raises(DriveError, match=said.replace("[", r"\[")):
        ask(read_columns(path, list(COLUMNS)))  # type: ignore[operator]


def test_a_missing_column_or_file_is_told(path: Path) -> None:
    with pytest.raises(DriveError, match="lacks the column nothing"):
        read_columns(path, ["nothing"])
    with pytest.raises(DriveError, match="Not found"):
        read_columns(path.with_stem("other"), ["key.time"])


def test_a_table_that_is_cut_short_is_told(path: Path) -> None:
    content = path.read_bytes()
    for length in (0, 3, len(content) // 2, len(content) - 3):
        path.write_bytes(content[:length])
        with pytest.raises(DriveError, match="Cut short or damaged"):
            read_columns(path, list(COLUMNS))


def test_what_is_missing_without_pyarrow_is_one_line(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(DriveError, match="pip install pyarrow"):
        read_columns(path, ["key.time"])


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """Forty rows in two row groups, each of a list of its number."""
    path = tmp_path / "many.parquet"
    rows = pa.array([[float(i)] * 100 for i in range(40)], pa.list_(pa.float32()))
    parquet.write_table(pa.table({"a.values": rows, "a.valuesX": [0] * 40}), path, row_group_size=25)
    return path


@pytest.mark.parametrize("held", [1 << 30, 2000, 1])
@pytest.mark.parametrize("order", ["forward", "backward", "mixed", "by fives"])
def test_single_rows_come_in_any_order(many: Path, order: str, held: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "HELD_BYTES", held)
    wanted = list(range(40))
    if order == "backward":
        wanted.reverse()
    elif order == "mixed":
        np.random.default_rng(0).shuffle(wanted)
    elif order == "by fives":
        wanted.sort(key=lambda i: (i % 5, i))
    rows = Rows(many, ("a.values",), ("second",))
    for i in wanted:
        found = rows.row(i)
        assert set(found) == {"a.values"}
        np.testing.assert_array_equal(array_of(found["a.values"], many, "a"), np.full(100, i))
    assert len(rows._places) <= tables.HELD_PLACES


def test_rows_forward_are_unpacked_once(many: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also from the places of five sensors that stand one after the other in the table."""
    monkeypatch.setattr(tables, "HELD_BYTES", 1)
    opened: list[int] = []
    batches = Rows._batches
    monkeypatch.setattr(Rows, "_batches", lambda rows, group: opened.append(group) or batches(rows, group))
    rows = Rows(many, ("a.values",))
    for i in range(40):
        rows.row(i)
    assert opened == [0, 1]
    opened.clear()
    rows = Rows(many, ("a.values",))
    for step in range(5):
        for sensor in range(5):
            rows.row(sensor * 5 + step)
    assert len(opened) <= 5


def test_rows_that_are_not_there_are_told(many: Path) -> None:
    for number in (-1, 40):
        with pytest.raises(DriveError, match="has no row"):
            Rows(many, ("a.values",)).row(number)
    with pytest.raises(DriveError, match="lacks the column b"):
        Rows(many, ("b",)).row(0)


def test_rows_of_a_damaged_table_are_told(many: Path) -> None:
    content = bytearray(many.read_bytes())
    content[4:600] = bytes(596)
    many.write_bytes(content)
    rows = Rows(many, ("a.values",))
    for _ in range(2):
        with pytest.raises(DriveError):
            rows.row(0)

"""What tables unpack to is told by their headers: for tables as writers make them, and for those that stand for gigabytes."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import feather, parquet

from unveil_core.base.errors import DriveError
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.drives.formats import tables
from unveil_core.drives.formats.columnar.feather_sizes import batches_of
from unveil_core.drives.formats.columnar.parquet_sizes import groups_of
from unveil_core.drives.formats.columnar.thrift import ThriftReader
from unveil_core.drives.formats.tables import Rows, read_columns

ROWS = 100_000
TABLE = pa.table(
    {
        "zeros": np.zeros(ROWS),
        "numbers": np.random.default_rng(0).normal(size=ROWS).astype(np.float32),
        "texts": [f"track {k % 50}" for k in range(ROWS)],
        "lists": pa.array([[1.0, float(k)] for k in range(ROWS)], pa.list_(pa.float32())),
        "gaps": pa.array([None if k % 3 else k for k in range(ROWS)], pa.int64()),
    }
)


@pytest.mark.parametrize(
    "options", [{}, {"data_page_version": "2.0"}, {"use_dictionary": False}, {"compression": "gzip"}]
)
def test_no_column_of_parquet_unpacks_to_more_than_was_told(tmp_path: Path, options: dict[str, object]) -> None:
    path = tmp_path / "t.parquet"
    parquet.write_table(TABLE, path, row_group_size=30_000, **options)
    with path.open("rb") as stream:
        for name in TABLE.column_names:
            groups = groups_of(stream, [name])
            assert [g.rows for g in groups] == [30_000] * 3 + [10_000]
            read = parquet.ParquetFile(path, read_dictionary=["texts"]).read([name])
            assert read.nbytes <= sum(g.unpacked for g in groups) < 8 * read.nbytes + 1_000_000
            assert all(g.values >= g.rows for g in groups)
            assert groups_of(stream, [name], 1) == groups[1:2]


@pytest.mark.parametrize("compression", ["uncompressed", "lz4", "zstd"])
@pytest.mark.parametrize("texts", ["plain", "dictionary"])
def test_no_feather_unpacks_to_more_than_was_told(tmp_path: Path, compression: str, texts: str) -> None:
    path = tmp_path / "t.feather"
    table = TABLE.set_column(2, "texts", TABLE["texts"].dictionary_encode()) if texts == "dictionary" else TABLE
    feather.write_feather(table, str(path), compression=compression, chunksize=30_000)
    with path.open("rb") as stream:
        told = batches_of(stream)
    assert told.rows == ROWS
    assert table.nbytes <= told.unpacked < 1.2 * table.nbytes


def _write(path: Path, table: pa.Table, **options: object) -> Path:
    if path.suffix == ".parquet":
        parquet.write_table(table, path, compression="zstd", **options)
    else:
        feather.write_feather(table, str(path), compression="zstd", chunksize=max(1, table.num_rows))
    return path


def _zeros(count: int) -> pa.Array:
    return pa.array(np.zeros(count))


BOMBS = {
    "zeros.feather": lambda: pa.table({"x": _zeros(50_000_000)}),
    "zeros.parquet": lambda: pa.table({"x": _zeros(50_000_000)}),
    "one list.feather": lambda: pa.table({"x": pa.ListArray.from_arrays([0, 50_000_000], _zeros(50_000_000))}),
    "one list.parquet": lambda: pa.table({"x": pa.ListArray.from_arrays([0, 50_000_000], _zeros(50_000_000))}),
    "long texts.parquet": lambda: pa.table({"x": ["x" * 20_000_000 + str(k) for k in range(20)]}),
    "rows of nothing.feather": lambda: pa.table({"x": pa.Array.from_buffers(pa.null(), 1 << 30, [None])}),
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_stands_for_gigabytes_is_refused_before_it_is_unpacked(name: str, tmp_path: Path) -> None:
    path = _write(tmp_path / name, BOMBS[name]())
    assert path.stat().st_size < 1_000_000
    held = pa.total_allocated_bytes()
    before = peak_memory_mb()
    with pytest.raises(DriveError, match=r"unpacks to [0-9,]+ rows and [0-9,]+ MB"):
        read_columns(path, ["x"])
    assert pa.total_allocated_bytes() - held < 1 << 20
    assert peak_memory_mb() - before < 100
    if name == "one list.parquet":
        with pytest.raises(DriveError, match=r"unpacks to [0-9,]+ rows and [0-9,]+ MB"):
            Rows(path, ("x",)).row(0)


ONE_TEXT = """
import sys
from pathlib import Path
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.drives.formats.tables import read_columns
before = peak_memory_mb()
words = read_columns(Path(sys.argv[1]), ["x"]).words("x")
assert len(words) == 1_000_000 and words[-1] is words[0]
print(peak_memory_mb() - before)
"""


def test_a_text_of_a_dictionary_is_kept_once(tmp_path: Path) -> None:
    """A million rows of ten megabytes."""
    text = "x" * 10_000_000
    table = pa.table({"x": pa.DictionaryArray.from_arrays(pa.array(np.zeros(1_000_000, np.int32)), pa.array([text]))})
    for name in ("t.parquet", "t.feather"):
        done = subprocess.run(
            [sys.executable, "-c", ONE_TEXT, _write(tmp_path / name, table)], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert float(done.stdout) < 200


@pytest.mark.parametrize(
    "column",
    [
        pa.RunEndEncodedArray.from_arrays(pa.array([1 << 20], pa.int32()), pa.array([1.0])),
        pa.ListViewArray.from_arrays(pa.array([0] * 999, pa.int32()), pa.array([1000] * 999, pa.int32()), _zeros(1000)),
        pa.nulls(9),
        pa.array([{"a": 1}] * 9),
        pa.ListArray.from_arrays([0, 9], pa.array(["x" * 9] * 9).dictionary_encode()),
        pa.array([[["a"]]] * 9),
    ],
    ids=["runs", "views", "nothing", "structs", "lists of texts", "lists of lists"],
)
def test_columns_of_no_numbers_times_or_texts_are_refused(column: pa.Array, tmp_path: Path) -> None:
    path = _write(tmp_path / "t.feather", pa.table({"x": column}))
    with pytest.raises(DriveError, match="holds .* in x"):
        read_columns(path, ["x"])


def test_rows_of_a_group_that_unpacks_to_much_more_than_it_has_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "MOST_BYTES", 1 << 20)
    path = _write(tmp_path / "t.parquet", pa.table({"x": pa.array([[0.0] * 100_000] * 10), "y": _zeros(10)}))
    with pytest.raises(DriveError, match=r"unpacks to 10 rows and \d+ MB in row group 0"):
        Rows(path, ("x",)).row(0)
    assert Rows(path, ("y",)).row(9)["y"].as_py() == 0


def test_headers_without_end_are_told() -> None:
    for content in (
        b"\x1c" * 99,
        b"\x19" + b"\xff" * 9,
        b"\x18\xff\xff\xff\xff\x0f",
        b"",
        b"\x15" + b"\xff" * 20,
        b"\x1d\0",
    ):
        with pytest.raises(ValueError):
            ThriftReader(io.BytesIO(content)).structure()

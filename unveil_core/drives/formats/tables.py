"""Parquet and feather tables of datasets: few columns at a time, and single rows of columns that do not fit into memory.

Writers differ in types (float or double, lists of fixed size or not, strings as they are or as a dictionary, time stamps as
integers or as times), so a column is asked for by what it means. pyarrow reads the files; nothing else of the core needs it. A
table of a hundred kilobytes can stand for gigabytes, so its headers are asked first what it unpacks to.
"""

from __future__ import annotations

import bisect
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import check_file, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.formats.columnar.feather_sizes import batches_of
from unveil_core.drives.formats.columnar.parquet_sizes import groups_of

__all__ = ["Columns", "Rows", "array_of", "read_columns"]

HELD_BYTES = 32 << 20
"""Unpacked, of the rows that are read at once. Released tables have row groups of 50 sweeps, a gigabyte each; a photograph or
a sweep has 0.5 to 20 MB. Unpacking takes twice as much again."""
HELD_PLACES = 5
"""Places in one table that are kept open. Rows are asked for in order of time; in a table that is in order of its sensors, each
of these (Waymo has five) then goes forward from its own place instead of starting anew for each row."""
MOST_BYTES = 256 << 20
"""Unpacked, of columns that are read as a whole: ten times the largest of the datasets."""
MOST_ROWS = 1 << 21
"""The same, of their rows."""
MOST_GROUP_BYTES = 1 << 31
"""Unpacked, of a row group of which single rows are read."""
MOST_UNPACKED = 64
"""Bytes that a byte of such a group unpacks to at most, beyond the first ``MOST_BYTES``. Photographs and ranges make 1 to 10."""
AGAIN = "download it again"
NO_TABLE = "download it again"


@contextmanager
def _reading(path: Path) -> Iterator[Any]:
    """pyarrow, with all that can go wrong in a file told as that file's fault."""
    try:
        import pyarrow as arrow
    except ImportError as error:
        wanted = "pip install pyarrow"
        raise DriveError("pyarrow is needed to read this table", path=path, mend=wanted) from error
    try:
        yield arrow
    except FileNotFoundError as error:
        raise DriveError("Not found", path=path, mend=AGAIN) from error
    except MemoryError as error:  # pyarrow's own is one, and a damaged length asks for anything
        raise DriveError("asks for more memory than there is", path=path, mend=AGAIN) from error
    except (arrow.ArrowException, OSError, EOFError, UnicodeDecodeError, ValueError) as error:
        raise DriveError(f"Cut short or damaged: {error}", path=path, mend=AGAIN) from error


@dataclass(frozen=True, eq=False)
class Columns:
    """Some columns of a table.

    Attributes:
        path: of the table, for messages.
        columns: pyarrow arrays by name.
        count: N, of the rows.
    """

    path: Path
    columns: dict[str, Any]
    count: int

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def numbers(self, name: str) -> Float64:
        """(N,) float64, NaN where a row has none. Raises DriveError: no numbers."""
        return self._as(name, np.float64)

    def integers(self, name: str, time_step: str = "us") -> NDArray[np.int64]:
        """(N,) int64; times, of any zone, since 1970 UTC in ``time_step``. Raises DriveError: no integers, or rows without one."""
        with _reading(self.path) as arrow:
            column = self.columns[name]
            if arrow.types.is_timestamp(column.type):
                column = column.cast(arrow.timestamp(time_step, column.type.tz)).cast(arrow.int64())
            if column.null_count:
                raise DriveError(f"lacks {name} in {column.null_count} rows", path=self.path, mend=AGAIN)
            try:
                return np.asarray(column.cast(arrow.int64()).to_numpy(), dtype=np.int64)
            except (arrow.ArrowException, ValueError) as error:
                raise DriveError(f"holds other than integers in {name}", path=self.path, mend=AGAIN) from error

    def words(self, name: str) -> list[str]:
        """N strings; of integers their digits, empty where a row has none."""
        found: list[Any] = []
        with _reading(self.path):
            for chunk in self.columns[name].chunks:
                if hasattr(chunk, "dictionary"):  # each text once, however many rows have it
                    known = chunk.dictionary.to_pylist()
                    found += [None if k is None else known[k] for k in chunk.indices.to_pylist()]
                else:
                    found += chunk.to_pylist()
            return ["" if value is None else str(value) for value in found]

    def vectors(self, name: str, size: int) -> Float64:
        """(N, size) float64, NaN where a row has no such list. Raises DriveError: a list of another size."""
        found = np.full((self.count, size), np.nan)
        for i, row in enumerate(self.lists(name)):
            if row is None:
                continue
            if len(row) != size:
                raise DriveError(f"has {len(row)} numbers in {name}, not {size}", path=self.path, mend=AGAIN)
            found[i] = row
        return found

    def lists(self, name: str) -> list[NDArray[Any] | None]:
        """N arrays, None where a row has none. Raises DriveError: no lists of numbers."""
        with _reading(self.path):
            return [array_of(value, self.path, name) for value in self.columns[name]]

    def _as(self, name: str, kind: type) -> Any:
        with _reading(self.path) as arrow:
            column = self.columns[name]
            if column.type == arrow.float16():  # Arrow itself casts it to float32 only in newer versions
                return column.to_numpy().astype(kind)
            try:
                return np.asarray(column.cast(arrow.float64()).to_numpy(), dtype=kind)
            except (arrow.ArrowException, ValueError) as error:
                raise DriveError(f"holds other than numbers in {name}", path=self.path, mend=AGAIN) from error


def array_of(value: Any, path: Path, name: str) -> NDArray[Any] | None:
    """The (K,) array in one row of a column of lists, None where the row has none.

    Raises:
        DriveError: no list of numbers.
    """
    inner = getattr(value, "values", None) if value is not None and value.is_valid else None
    inner = None if callable(inner) else inner  # of a struct it is a method
    if inner is not None and hasattr(inner, "dictionary"):  # a value that stands there once may come a million times
        raise DriveError(f"holds other than lists of numbers in {name}", path=path, mend=AGAIN)
    if inner is None and (value is None or not value.is_valid):
        return None
    found = None if inner is None else inner.to_numpy(zero_copy_only=False)
    if found is None or found.dtype.kind not in "bfiu":
        raise DriveError(f"holds other than lists of numbers in {name}", path=path, mend=AGAIN)
    return found


def read_columns(path: Path, names: Sequence[str], optional: Sequence[str] = ()) -> Columns:
    """Whole columns of a .parquet or .feather table; for small ones.

    Args:
        names: of columns that must be there; optional: that may be.
    Raises:
        DriveError: missing, cut short, or without one of ``names``; pyarrow is not installed.
    """
    with _reading(path) as arrow, open_file(path) as stream:
        if path.suffix == ".parquet":
            from pyarrow import parquet

            with parquet.ParquetFile(path) as file:
                chosen = _chosen(path, file.schema_arrow.names, names, optional)
                groups = groups_of(stream, chosen)
                _refuse_more(path, sum(g.rows for g in groups), sum(g.unpacked for g in groups))
            with parquet.ParquetFile(path, read_dictionary=_texts(file, chosen)) as file:
                table = file.read(columns=chosen, use_threads=False)
        else:
            from pyarrow import feather

            batches = batches_of(stream)
            _refuse_more(path, batches.rows, batches.unpacked)
            with arrow.OSFile(str(path)) as file:
                chosen = _chosen(path, arrow.ipc.open_file(file).schema.names, names, optional)
                file.seek(0)
                table = feather.read_table(file, columns=chosen, use_threads=False)
        table.validate(full=True)  # pyarrow trusts the offsets in a file and reads where a damaged one points
        for name in chosen:
            _check_kind(path, name, table.column(name).type)
        return Columns(path, {name: table.column(name) for name in chosen}, table.num_rows)


def _refuse_more(path: Path, rows: int, unpacked: int) -> None:
    if unpacked > MOST_BYTES or rows > MOST_ROWS:
        problem = f"unpacks to {rows:,} rows and {unpacked >> 20:,} MB, of which {MOST_ROWS:,} and {MOST_BYTES >> 20} are read"
        raise DriveError(problem, path=path, mend=NO_TABLE)


def _texts(file: Any, chosen: Sequence[str]) -> list[str]:
    """Paths of the columns of texts. They are read as a dictionary, or a text that stands there once may come a million times."""
    leaves = [file.schema.column(k) for k in range(len(file.schema))]
    parts = [leaf for leaf in leaves if leaf.path.startswith(tuple(chosen))]
    return [leaf.path for leaf in parts if leaf.physical_type == "BYTE_ARRAY"]


def _check_kind(path: Path, name: str, kind: Any) -> None:
    """Refuse columns of other than numbers, times, texts and lists of numbers: those of nothing, of runs and of views may have any
    number of rows in a few bytes."""
    import pyarrow.types as types

    if types.is_dictionary(kind):
        kind = kind.value_type
    elif types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        kind = kind.value_type
        if types.is_dictionary(kind) or types.is_string(kind) or types.is_binary(kind):
            raise DriveError(f"holds lists of other than numbers in {name}", path=path, mend=AGAIN)
    plain = (
        types.is_integer,
        types.is_floating,
        types.is_boolean,
        types.is_timestamp,
        types.is_string,
        types.is_large_string,
    )
    if not any(known(kind) for known in (*plain, types.is_binary, types.is_large_binary)):
        raise DriveError(f"holds {kind} in {name}", path=path, mend=AGAIN)


def _chosen(path: Path, there: Sequence[str], names: Sequence[str], optional: Sequence[str]) -> list[str]:
    missing = [name for name in names if name not in there]
    if missing:
        raise DriveError(f"lacks the column {missing[0]}", path=path, mend=AGAIN)
    return [*names, *(name for name in optional if name in there)]


@dataclass(eq=False)
class _Place:
    """Rows ``first`` to ``last`` of the table, unpacked, and how the rows after them are read."""

    group: int
    first: int
    last: int
    following: Iterator[Any]
    held: Any = None


@dataclass(eq=False)
class Rows:
    """Single rows of a large parquet table, which is opened when the first is asked for.

    Going forward through the rows is cheap; a step back unpacks its row group again from its beginning unless the row is still
    held. May be shared by threads.

    Attributes:
        path: of the table.
        names: of the columns that are read; optional: of those that are read where the table has them.
    """

    path: Path
    names: tuple[str, ...]
    optional: tuple[str, ...] = ()
    _chosen: list[str] = field(default_factory=list)
    _places: list[_Place] = field(default_factory=list)
    _starts: list[int] = field(default_factory=list)
    _texts: list[str] = field(default_factory=list)
    _metadata: Any = None
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def row(self, number: int) -> dict[str, Any]:
        """The row's pyarrow scalars by the name of their column.

        Raises:
            DriveError: no such row or column, or the file is damaged there.
        """
        with self._lock, _reading(self.path):
            place = self._place(number)
            while number >= place.last:
                place.held, place.first = None, place.last  # before the next is read, or two are in memory
                place.held = next(place.following, None)
                if place.held is None:
                    raise DriveError(f"has no row {number}", path=self.path, mend=AGAIN)
                place.last += place.held.num_rows
            return {name: place.held.column(name)[number - place.first] for name in self._chosen}

    def _place(self, number: int) -> _Place:
        """The nearest place at or before a row in its row group, else a new one; it becomes the last to be given up."""
        if self._metadata is None:
            from pyarrow import parquet

            check_file(self.path)
            with parquet.ParquetFile(self.path) as file:
                self._chosen = _chosen(self.path, file.schema_arrow.names, self.names, self.optional)
                self._texts = _texts(file, self._chosen)
                for name in self._chosen:
                    _check_kind(self.path, name, file.schema_arrow.field(name).type)
                self._metadata = file.metadata
            counts = [self._metadata.row_group(g).num_rows for g in range(self._metadata.num_row_groups)]
            self._starts = [0, *np.cumsum(counts).tolist()]
        group = bisect.bisect_right(self._starts, number) - 1
        if not 0 <= number < self._starts[-1]:
            raise DriveError(f"has no row {number}", path=self.path, mend=AGAIN)
        before = [p for p in self._places if p.group == group and p.first <= number]
        place = max(before, key=lambda p: p.first, default=None)
        if place is None:
            while len(self._places) >= HELD_PLACES:
                self._places.pop(0)
            start = self._starts[group]
            place = _Place(group, start, start, self._batches(group))
        else:
            self._places.remove(place)
        self._places.append(place)
        return place

    def _batches(self, group: int) -> Iterator[Any]:
        from pyarrow import parquet

        part = self._metadata.row_group(group)
        with open_file(self.path) as stream:
            (told,) = groups_of(stream, self._chosen, group)
        if told.unpacked > min(MOST_GROUP_BYTES, MOST_BYTES + MOST_UNPACKED * told.packed) or told.rows > told.values:
            problem = f"unpacks to {told.rows:,} rows and {told.unpacked >> 20:,} MB in row group {group}"
            raise DriveError(problem, path=self.path, mend=NO_TABLE)
        # So it reads page by page instead of a whole column of the row group.
        way = {"pre_buffer": False, "buffer_size": 1 << 20, "read_dictionary": self._texts}
        with parquet.ParquetFile(self.path, metadata=self._metadata, **way) as file:
            batches = partial(file.iter_batches, row_groups=[group], columns=self._chosen, use_threads=False)
            # A column of few values is small in the file, as its values stand there once, so a row tells more than the footer,
            # of whose columns, besides, pyarrow cannot be asked without risk: it ends the process where they are damaged.
            first = next(batches(batch_size=1), None)
            each = max(part.total_byte_size / max(part.num_rows, 1), 1 if first is None else first.nbytes, 1)
            yield from batches(batch_size=max(1, min(int(HELD_BYTES / each), part.num_rows)))

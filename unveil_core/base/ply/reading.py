"""The vertices of a PLY, text or binary, of either order of bytes. What follows them in the file, as faces, is not looked at."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.ply.header import Element, ListOf, read_header

__all__ = ["UNREADABLE", "Vertices", "read_vertices"]

UNREADABLE = (LookupError, TypeError, ValueError, ArithmeticError, MemoryError, EOFError, OSError, RuntimeError)
"""What comes of reading a file that is no PLY."""
T = TypeVar("T", bound=np.generic)
AT_ONCE = 1 << 12
"""Rows whose fields are taken together: what a processor keeps at hand."""
MOST_LISTS = 1 << 20
"""Rows with lists, as faces: each is read by itself, in some microseconds, whether the lists hold something or not."""


@dataclass(frozen=True, eq=False)
class Vertices:
    """Attributes:
    table: (N,) structured, fields by the file's names and in its order of bytes; lists are left out.
    comments: of the header, without the word.
    """

    table: NDArray[np.void]
    comments: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the fields."""
        return self.table.dtype.names or ()

    def columns(self, names: Sequence[str], kind: type[T]) -> NDArray[T]:
        """(N, len(names)) some fields as numbers of one kind; what is too large for it becomes infinite.

        Raises:
            ValueError: it has no such field.
        """
        found = np.empty((len(self.table), len(names)), kind)
        with np.errstate(over="ignore", invalid="ignore"):  # of a signalling NaN NumPy warns
            # Some rows at a time: those of one field after the other would be fetched from memory anew for each.
            for first in range(0, len(found), AT_ONCE):
                rows, some = self.table[first : first + AT_ONCE], found[first : first + AT_ONCE]
                for k, name in enumerate(names):
                    some[:, k] = rows[name]
        return found


def read_vertices(path: Path, *, links: bool = False) -> Vertices:
    """The vertices of a PLY whose header was looked at before anything was taken from memory for it.

    Args:
        links: whether a symbolic link is followed, see :func:`open_file`.
    Raises:
        Exception: one of :data:`UNREADABLE`: it cannot be read, has no vertices, tells more than the file can hold, or has more
            lists before the end of its vertices than can be read in some seconds.
    """
    with open_file(path, links=links) as stream:
        header = read_header(stream)
        names = [element.name for element in header.elements]
        if "vertex" not in names:
            raise ValueError("it has no vertices")
        *before, own = header.elements[: names.index("vertex") + 1]
        lists = sum(element.rows for element in (*before, own) if element.has_lists)
        if lists > MOST_LISTS:
            raise ValueError(
                f"it has {lists:,} faces or other lists, of which {MOST_LISTS:,} are read: save it without them"
            )
        if header.order:
            for element in before:
                _rows_of_bytes(stream, element, header.order, keep=False)
            table = _rows_of_bytes(stream, own, header.order)
        else:
            lines = _full_lines(stream, header.line_end)
            for element in before:
                if sum(1 for _ in islice(lines, element.rows)) < element.rows:
                    raise ValueError("it is cut short")
            table = _rows_of_text(lines, own)
    return Vertices(table, header.comments)


def _kinds(element: Element, order: str) -> np.dtype[np.void]:
    """Of a row without its lists."""
    return np.dtype([(name, order + kind) for name, kind in element.properties.items() if isinstance(kind, str)])


# Binary


def _rows_of_bytes(stream: BinaryIO, element: Element, order: str, *, keep: bool = True) -> NDArray[np.void]:
    """The rows of an element; nothing in particular where they are not to be kept."""
    if element.has_lists:
        return _rows_with_lists(stream, element, order, keep=keep)
    kinds = _kinds(element, order)
    if not keep:
        stream.seek(element.rows * kinds.itemsize, 1)
        return np.empty(0, kinds)
    table = np.fromfile(stream, kinds, element.rows)
    if len(table) < element.rows:
        raise ValueError("it is cut short")
    return table


def _rows_with_lists(stream: BinaryIO, element: Element, order: str, *, keep: bool) -> NDArray[np.void]:
    """Row by row: after a list, everything lies elsewhere in each."""
    kinds = _kinds(element, order)
    kept = bytearray()
    parts = _parts(element, order)
    for _ in range(element.rows):
        for part in parts:
            if isinstance(part, int):
                content = _taken(stream, part)
                if keep:
                    kept += content
            else:
                count, size = part
                length = int(np.frombuffer(_taken(stream, count.itemsize), count)[0])
                if length < 0:
                    raise ValueError(f"it has a list of {length} numbers")
                stream.seek(length * size, 1)
    if element.rows and keep:
        stream.seek(-1, 1)  # what a last list leads beyond is not in the file
        _taken(stream, 1)
    return np.frombuffer(bytes(kept), kinds).copy() if keep else np.empty(0, kinds)


def _parts(element: Element, order: str) -> list[int | tuple[np.dtype[np.generic], int]]:
    """What a row is made of: bytes of numbers in a run, and lists by the kind of their count and the bytes of an item."""
    found: list[int | tuple[np.dtype[np.generic], int]] = []
    for kind in element.properties.values():
        if isinstance(kind, ListOf):
            found.append((np.dtype(order + kind.count), int(kind.item[1:])))
        elif found and isinstance(found[-1], int):
            found[-1] += int(kind[1:])
        else:
            found.append(int(kind[1:]))
    return found


def _taken(stream: BinaryIO, size: int) -> bytes:
    content = stream.read(size)
    if len(content) < size:
        raise ValueError("it is cut short")
    return content


# Text


def _full_lines(stream: BinaryIO, line_end: bytes) -> Iterator[bytes]:
    """The lines of a text that are not empty."""
    lines: Iterable[bytes] = stream if line_end.endswith(b"\n") else stream.read().split(line_end)
    return (line for line in lines if line.strip())


def _rows_of_text(lines: Iterator[bytes], element: Element) -> NDArray[np.void]:
    kinds = _kinds(element, "=")
    width, own = len(kinds.names or ()), islice(lines, element.rows)
    if element.has_lists:
        rows = [_without_lists(line.split(), element) for line in own]
        values = np.array(rows, dtype=np.float64).reshape(len(rows), -1)
    elif element.rows:
        texts = (line.decode("ascii") for line in own)
        values = np.loadtxt(texts, dtype=np.float64, comments=None, ndmin=2)
    else:
        values = np.zeros((0, width))
    if values.shape != (element.rows, width):
        raise ValueError(
            "it is cut short" if len(values) < element.rows else "a row has more or fewer numbers than the header says"
        )
    table = np.empty(element.rows, kinds)
    for k, name in enumerate(kinds.names or ()):
        with np.errstate(invalid="ignore", over="ignore"):
            table[name] = values[:, k]
        if kinds[name].kind in "iu" and not (table[name] == values[:, k]).all():
            raise ValueError(f"{name[:40]} has a value that its kind cannot hold")
    return table


def _without_lists(words: list[bytes], element: Element) -> list[float]:
    """The numbers of a row that are not in lists."""
    found, at = [], 0
    for kind in element.properties.values():
        if isinstance(kind, ListOf):
            length = int(words[at])
            if length < 0:
                raise ValueError(f"it has a list of {length} numbers")
            at += 1 + length
        else:
            found.append(float(words[at]))
            at += 1
    if at != len(words):
        raise ValueError("a row has more or fewer numbers than the header says")
    return found

"""What columns of a Parquet table unpack to, by the headers of their pages.

Values that repeat are written once with a count, so that a page of a few bytes can stand for gigabytes. A decoder makes of a page
as many values as its own header says, whatever the footer claims. Facts: apache/parquet-format (``parquet.thrift``).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, BinaryIO

from unveil_core.drives.formats.columnar.thrift import ThriftReader

__all__ = ["Group", "groups_of"]

MAGIC = b"PAR1"
VALUE_BYTES = {0: 1, 1: 4, 2: 8, 3: 12, 4: 4, 5: 8, 6: 4}
"""Of a value by the number of its physical type; a text is the number of its entry in a dictionary. Others tell their length."""
LEVEL_BYTES = 4
"""Of a value, for its places in lists and gaps."""
DICTIONARY_PAGE = 2


@dataclass(frozen=True)
class Group:
    """Some columns of a row group.

    Attributes:
        rows: that it claims.
        values: of that column which has fewest.
        packed: bytes in the file; unpacked: at most, of all the columns.
    """

    rows: int
    values: int
    packed: int
    unpacked: int


NO_HEADERS = (AttributeError, IndexError, KeyError, OverflowError, TypeError)
"""What comes of fields that hold other than they should."""


def groups_of(stream: BinaryIO, columns: Sequence[str], only: int | None = None) -> list[Group]:
    """The row groups of an open file, or ``only`` one of them.

    Args:
        columns: names of the columns that are to be read.
    Raises:
        ValueError: headers that cannot be read, or tell of places outside of the file.
    """
    try:
        return _groups(stream, columns, only)
    except NO_HEADERS as error:
        raise ValueError("its headers hold other than they should") from error


def _groups(stream: BinaryIO, columns: Sequence[str], only: int | None) -> list[Group]:
    size = stream.seek(0, 2)
    if size < 12:
        raise ValueError("it has no footer")
    stream.seek(size - 8)
    end = stream.read(8)
    length = int.from_bytes(end[:4], "little")
    if end[4:] != MAGIC or length > size - 12:
        raise ValueError("it has no footer")
    stream.seek(size - 8 - length)
    footer = ThriftReader(stream).structure()
    leaves = [_value_bytes(e) for e in _list(footer, 2) if not e.get(5)]
    chosen = {name.encode() for name in columns}
    found = []
    for number, group in enumerate(_list(footer, 4)):
        if only is None or number == only:
            parts = list(_columns(stream, size, group, leaves, chosen))
            rows = _whole(group, 3)
            values = min((v for v, _, _ in parts), default=rows)
            found.append(Group(rows, values, sum(p for _, p, _ in parts), sum(u for _, _, u in parts)))
    return found


def _columns(
    stream: BinaryIO, size: int, group: dict[int, Any], leaves: list[int], chosen: set[bytes]
) -> Iterator[tuple[int, int, int]]:
    """Per column its values, its bytes in the file, and unpacked."""
    for number, column in enumerate(_list(group, 1)):
        about = column.get(3)
        if not isinstance(about, dict) or number >= len(leaves):
            raise ValueError("a column without its headers")
        path = about.get(3) or [b""]
        if path[0] not in chosen:
            continue
        start = _whole(about, 9)
        if 0 < about.get(11, 0) < start:
            start = _whole(about, 11)
        packed = _whole(about, 7)
        if start + packed > size:
            raise ValueError("a column lies outside of it")
        yield _pages(stream, start, packed, _whole(about, 5), leaves[number])


def _pages(stream: BinaryIO, start: int, packed: int, wanted: int, each: int) -> tuple[int, int, int]:
    at, values, unpacked = start, 0, 0
    while values < wanted and at < start + packed:
        stream.seek(at)
        page = ThriftReader(stream).structure()
        begins = stream.tell()
        about = page.get(5) or page.get(8) or {}
        count = _whole(about, 1) if about else 0
        if not about and page.get(1) != DICTIONARY_PAGE and page.get(1) != 1:
            raise ValueError("a page of an unknown kind")
        values += count
        unpacked += _whole(page, 2) + count * (each + LEVEL_BYTES)
        at = begins + _whole(page, 3)
        if at > start + packed:
            raise ValueError("a page lies outside of its column")
    return values, packed, unpacked


def _value_bytes(element: dict[int, Any]) -> int:
    return VALUE_BYTES.get(element.get(1, 0), max(int(element.get(2, 0)), 4))


def _list(fields: dict[int, Any], number: int) -> list[Any]:
    found = fields.get(number)
    if not isinstance(found, list):
        raise ValueError("its headers lack a list")
    return found


def _whole(fields: dict[int, Any], number: int) -> int:
    found = fields.get(number)
    if not isinstance(found, int) or found < 0:
        raise ValueError("its headers lack a number")
    return found

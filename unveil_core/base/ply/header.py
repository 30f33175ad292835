"""The header of a PLY, and what it claims, before anything is taken from memory for it.

A header is text: ``ply``, ``format``, then elements with their properties in the order of the file, with comments in between, up to
``end_header``. Its lines end as those of Unix, Windows or old Macs, the first one tells; the rows begin right behind the last.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from typing import BinaryIO

__all__ = ["Element", "Header", "ListOf", "read_header"]

MOST_HEADER = 1 << 20
"""Bytes: programs write a line for each property, and some a history as comments."""
MOST_LINES = 10_000
KINDS = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
"""NumPy's kinds of numbers by the names that PLY has for them, old and new."""
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""NumPy's signs of an order of bytes by the format; "" for text."""
COUNT = re.compile(r"[0-9]{1,18}")


@dataclass(frozen=True)
class ListOf:
    """A property of several numbers a row: kind of their count, and of each."""

    count: str
    item: str


@dataclass
class Element:
    """A table of a file.

    Attributes:
        name: as "vertex"; rows: that it claims.
        properties: kind of each by its name, in the order of the file.
    """

    name: str
    rows: int
    properties: dict[str, str | ListOf] = field(default_factory=dict)

    @property
    def has_lists(self) -> bool:
        """Whether its rows have several lengths."""
        return any(isinstance(kind, ListOf) for kind in self.properties.values())


@dataclass
class Header:
    """What a file says of itself.

    Attributes:
        order: NumPy's sign of its order of bytes, "" for text.
        line_end: of the header, and of rows that are text.
        elements: in the order of the file; comments: without the word.
    """

    order: str
    line_end: bytes
    elements: list[Element]
    comments: tuple[str, ...]


def read_header(stream: BinaryIO) -> Header:
    """Read the header of an open file, which is left at its first row.

    Raises:
        ValueError: it is no PLY, or claims more rows than the file has bytes for.
    """
    head = stream.read(MOST_HEADER)
    begin = re.match(rb"ply[ \t]*(\r\n|\n|\r)", head)
    if begin is None:
        raise ValueError("it does not begin as one" if head else "it is empty")
    end = begin.group(1)
    lines: list[str] = []
    at = begin.end()
    while True:
        stop = head.find(end, at)
        if stop < 0 or len(lines) > MOST_LINES:
            raise ValueError("its header has no end")
        line, at = head[at:stop].decode("ascii", errors="replace"), stop + len(end)
        if line.split() == ["end_header"]:
            break
        lines.append(line)
    stream.seek(at)
    found = _parsed(lines, end)
    _check_rows(found, os.fstat(stream.fileno()).st_size - at)
    return found


def _parsed(lines: list[str], line_end: bytes) -> Header:
    order: str | None = None
    elements: list[Element] = []
    comments = []
    for line in lines:
        word, *rest = line.split() or ["comment"]
        if word == "comment":
            comments.append(line.strip().removeprefix("comment").lstrip())
        elif word == "format":
            order = ORDERS.get(rest[0]) if rest else None
            if order is None:
                raise ValueError(f"its format is {' '.join(rest)[:40] or 'not told'}")
        elif word == "element":
            elements.append(_element(rest, elements))
        elif word == "property":
            _add_property(rest, elements)
        elif word != "obj_info":
            raise ValueError(f"its header has a line that begins with {word[:40]!r}")
    if order is None:
        raise ValueError("its header lacks the format")
    return Header(order, line_end, elements, tuple(comments))


def _element(words: list[str], before: list[Element]) -> Element:
    if len(words) != 2:
        raise ValueError(f"its header has an element {' '.join(words)[:40]!r} without name or number of rows")
    name, rows = words
    if not COUNT.fullmatch(rows):
        raise ValueError(f"it says {rows[:40]} rows of {name[:40]}")
    if any(e.name == name for e in before):
        raise ValueError(f"it has the element {name[:40]} twice")
    return Element(name, int(rows))


def _add_property(words: list[str], elements: list[Element]) -> None:
    """Add a property to the last element."""
    kinds = words[1:-1] if words[:1] == ["list"] else words[:-1]
    if len(words) != (4 if words[:1] == ["list"] else 2) or not all(kind in KINDS for kind in kinds):
        raise ValueError(f"its header has a property {' '.join(words)[:60]!r} of no kind that PLY has")
    if not elements:
        raise ValueError("its header has a property before all elements")
    name, own = words[-1], elements[-1].properties
    if name in own:
        raise ValueError(f"it has the property {name[:40]} twice")
    if len(kinds) == 1:
        own[name] = KINDS[kinds[0]]
        return
    count, item = (KINDS[kind] for kind in kinds)
    if count.startswith("f"):
        raise ValueError(f"its list {name[:40]} counts by fractions")
    own[name] = ListOf(count, item)


def _check_rows(header: Header, size: int) -> None:
    """Raise a ValueError where rows need more bytes than ``size``; a number of text, and an empty list, is a byte at least."""
    needed = 0
    for element in header.elements:
        kinds = [kind.count if isinstance(kind, ListOf) else kind for kind in element.properties.values()]
        row = sum(int(kind[1:]) if header.order else 1 for kind in kinds)
        needed += element.rows * max(row, 1)
    if needed > size:
        rows = max(element.rows for element in header.elements)
        raise ValueError(f"it says {rows:,} rows, which take {needed:,} bytes at least, in {size:,}")

"""Thrift's compact protocol, in which Parquet writes its headers, as far as these need it: numbers of fields to values."""

from __future__ import annotations

import struct
from typing import Any, BinaryIO

__all__ = ["ThriftReader"]

MOST_BYTES = 4 << 20
"""Of one structure. A footer has some hundred bytes for each column of each row group."""
DEEPEST = 12
TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, MAP, STRUCT = 1, 2, 3, 7, 8, 9, 10, 11, 12
WHOLE = (4, 5, 6)


class ThriftReader:
    """Reads one structure from where a stream stands.

    Raises:
        ValueError: from any method, where the bytes are no such structure, or end.
    """

    def __init__(self, stream: BinaryIO, most: int = MOST_BYTES) -> None:
        self._stream, self._left = stream, most

    def structure(self, depth: int = 0) -> dict[int, Any]:
        """The fields of a structure by number: numbers, bytes, lists and further structures."""
        if depth > DEEPEST:
            raise ValueError("structures lie too deep within one another")
        fields: dict[int, Any] = {}
        last = 0
        while head := self._bytes(1)[0]:
            last = last + (head >> 4) if head >> 4 else self._signed()
            kind = head & 15
            fields[last] = kind == TRUE if kind in (TRUE, FALSE) else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        if kind in WHOLE:
            return self._signed()
        if kind in (TRUE, FALSE, BYTE):
            return self._bytes(1)[0]
        if kind == DOUBLE:
            return struct.unpack("<d", self._bytes(8))[0]
        if kind == BINARY:
            return self._bytes(self._varint())
        if kind == STRUCT:
            return self.structure(depth + 1)
        if kind in (LIST, SET):
            head = self._bytes(1)[0]
            count = self._varint() if head >> 4 == 15 else head >> 4
            return [self._value(head & 15, depth + 1) for _ in range(count)]
        if kind == MAP:
            count = self._varint()
            kinds = self._bytes(1)[0] if count else 0
            return [(self._value(kinds >> 4, depth + 1), self._value(kinds & 15, depth + 1)) for _ in range(count)]
        raise ValueError(f"a value of the unknown type {kind}")

    def _signed(self) -> int:
        coded = self._varint()
        return (coded >> 1) ^ -(coded & 1)

    def _varint(self) -> int:
        found = 0
        for shift in range(0, 70, 7):
            byte = self._bytes(1)[0]
            found |= (byte & 0x7F) << shift
            if byte < 0x80:
                return found
        raise ValueError("a number of more than 64 bits")

    def _bytes(self, count: int) -> bytes:
        self._left -= count
        found = self._stream.read(count) if self._left >= 0 else b""
        if len(found) != count:
            raise ValueError("a header ends too soon, or is too long")
        return found

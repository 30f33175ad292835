"""What a Feather table (Arrow's file format) unpacks to, by the headers of its record batches.

Each buffer of a batch that is compressed begins with the number of bytes that it unpacks to, for which a decoder makes room. Facts:
apache/arrow (``format/File.fbs``, ``Message.fbs``) and FlatBuffers' own layout of tables and vectors.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

__all__ = ["Batches", "batches_of"]

MAGIC = b"ARROW1"
MOST_HEADER = 4 << 20
"""Bytes of the footer, or of the header of a batch."""
DICTIONARY, RECORDS = 2, 3


@dataclass(frozen=True)
class Batches:
    """Attributes: rows: of all record batches; unpacked: bytes of all their buffers, those of dictionaries among them."""

    rows: int
    unpacked: int


class _Table:
    """A table of FlatBuffers: its fields by number."""

    def __init__(self, data: bytes, at: int) -> None:
        self.data, self.at = data, at
        self._fields = at - struct.unpack_from("<i", data, at)[0]
        if self._fields < 0:
            raise ValueError("a header points before itself")
        self._end = self._fields + int(struct.unpack_from("<H", data, self._fields)[0])

    def place(self, number: int) -> int | None:
        """Where a field lies, None where the table has none."""
        entry = self._fields + 4 + 2 * number
        offset = struct.unpack_from("<H", self.data, entry)[0] if entry + 2 <= self._end else 0
        return self.at + offset if offset else None

    def number(self, number: int, kind: str) -> int:
        """A number, 0 where it is left out."""
        at = self.place(number)
        return 0 if at is None else int(struct.unpack_from("<" + kind, self.data, at)[0])

    def _target(self, number: int) -> int | None:
        at = self.place(number)
        return None if at is None else at + int(struct.unpack_from("<I", self.data, at)[0])

    def table(self, number: int) -> _Table | None:
        """A table within this one."""
        at = self._target(number)
        return None if at is None else _Table(self.data, at)

    def structures(self, number: int, layout: str) -> list[tuple[int, ...]]:
        """A vector of structures."""
        at = self._target(number)
        if at is None:
            return []
        (count,) = struct.unpack_from("<I", self.data, at)
        size = struct.calcsize(layout)
        if at + 4 + count * size > len(self.data):
            raise ValueError("a list of its headers ends too soon")
        return list(struct.iter_unpack(layout, self.data[at + 4 : at + 4 + count * size]))


def _root(data: bytes) -> _Table:
    return _Table(data, struct.unpack_from("<I", data)[0])


def batches_of(stream: BinaryIO) -> Batches:
    """What all batches of an open file hold.

    Raises:
        ValueError: headers that cannot be read, or tell of places outside of the file.
    """
    try:
        found = list(_batches(stream))
    except struct.error as error:
        raise ValueError(f"a header is damaged: {error}") from error
    return Batches(sum(rows for rows, _ in found), sum(unpacked for _, unpacked in found))


def _batches(stream: BinaryIO) -> Iterator[tuple[int, int]]:
    size = stream.seek(0, 2)
    stream.seek(max(0, size - 10))
    end = stream.read(10)
    if len(end) < 10 or end[4:] != MAGIC:
        raise ValueError("it has no footer")
    (length,) = struct.unpack_from("<i", end)
    if not 8 <= length <= min(size - 10, MOST_HEADER):
        raise ValueError("its footer has another length")
    stream.seek(size - 10 - length)
    footer = _root(stream.read(length))
    for number in (2, 3):  # dictionaries, records
        for start, header, body in footer.structures(number, "<qi4xq"):
            if min(start, header, body) < 0 or start + header + body > size or header > MOST_HEADER:
                raise ValueError("a batch lies outside of it")
            yield _batch(stream, start, header, body)


def _batch(stream: BinaryIO, start: int, header: int, body: int) -> tuple[int, int]:
    """Rows and unpacked bytes of a batch."""
    stream.seek(start)
    data = stream.read(header)
    data = data[8 if data[:4] == b"\xff\xff\xff\xff" else 4 :]
    message = _root(data)
    kind, batch = message.number(1, "B"), message.table(2)
    rows = 0
    if batch is not None and kind == DICTIONARY:
        batch = batch.table(1)
    elif batch is not None and kind == RECORDS:
        rows = batch.number(0, "q")
    if batch is None or kind not in (DICTIONARY, RECORDS) or rows < 0:
        raise ValueError("a batch of an unknown kind")
    unpacked, compressed = 0, batch.place(3) is not None
    for offset, length in batch.structures(2, "<qq"):
        if offset < 0 or length < 0 or offset + length > body:
            raise ValueError("a buffer lies outside of its batch")
        stream.seek(start + header + offset)
        told = int.from_bytes(stream.read(8), "little", signed=True) if compressed and length >= 8 else -1
        unpacked += length if told < 0 else told
    # An empty buffer of gaps says that there are none; columns of nothing have no buffers at all.
    return rows, unpacked

"""Changed copies of binary files: of their bytes, of the text at their beginning, and of what is packed in them."""

from __future__ import annotations

import gzip
import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random

from tests.fuzz.hostile import CHUNKS, packed_numbers
from tests.fuzz.mutate_text import TextMutator

__all__ = ["BinaryMutator"]

NUMBERS = packed_numbers()
PNG = b"\x89PNG\r\n\x1a\n"
HEADER_BYTES = 512
"""Most of what is decided is decided here, so it is changed as often as all the rest."""


class BinaryMutator:
    """Changed copies of one file.

    Args:
        content: of the file. Of archives, gzip, PNG and PLY the parts are changed, too, so that sums over them stay right.
    """

    def __init__(self, content: bytes) -> None:
        self.content = content
        ways: list[Callable[[Random], bytes]] = [self._plain]
        if content[:4] == b"PK\x03\x04":
            with zipfile.ZipFile(io.BytesIO(content)) as packed:
                self.parts = {name: packed.read(name) for name in packed.namelist()}
            ways += [self._archive] * 3
        elif content[:2] == b"\x1f\x8b":
            self.unpacked = gzip.decompress(content)
            ways += [self._packed] * 3
        elif content[:8] == PNG:
            ways += [self._png] * 2
        elif content[:3] == b"ply":
            self.header = content.index(b"end_header\n") + len(b"end_header\n")
            ways += [self._ply]
        self.ways = ways

    def mutate(self, rng: Random) -> bytes:
        """One of them; of equal generators the same."""
        return rng.choice(self.ways)(rng)

    def _plain(self, rng: Random) -> bytes:
        return _changed(self.content, rng)

    def _archive(self, rng: Random) -> bytes:
        parts = dict(self.parts)
        name = rng.choice(list(parts))
        match rng.randrange(8):
            case 0:
                del parts[name]
            case 1:
                parts[name] = parts[rng.choice(list(parts))]
            case _:
                parts[name] = _npy(parts[name], rng)
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as packed:
            for name, content in parts.items():
                packed.writestr(name, content)
        return stream.getvalue()

    def _packed(self, rng: Random) -> bytes:
        return gzip.compress(_changed(self.unpacked, rng), 1)

    def _png(self, rng: Random) -> bytes:
        """With right sums, so that a decoder looks further."""
        content, at = bytearray(_changed(self.content, rng)), 8
        while at + 12 <= len(content):
            (size,) = struct.unpack_from(">I", content, at)
            if at + 12 + size > len(content):
                break
            content[at + 8 + size : at + 12 + size] = struct.pack(">I", zlib.crc32(content[at + 4 : at + 8 + size]))
            at += 12 + size
        return bytes(content)

    def _ply(self, rng: Random) -> bytes:
        return TextMutator(self.content[: self.header]).mutate(rng) + self.content[self.header :]


def _npy(content: bytes, rng: Random) -> bytes:
    """An array with a changed header, often of the right length, or with changed numbers."""
    if content[:6] != b"\x93NUMPY" or rng.random() < 0.4:
        return _changed(content, rng)
    end = content.index(b"\n") + 1
    header = TextMutator(content[10:end].rstrip()).mutate(rng)[:60_000] + b"\n"
    if rng.random() < 0.5:
        shape = rng.choice((b"()", b"(0,)", b"(3,)", b"(0, 3)", b"(1000000000000,)", b"(2, -1)", b"(1,1,1,1)"))
        kind = rng.choice((b"<f8", b"<f4", b"|O", b"<M8[s]", b"<c16", b"|V8", b"<U9", b"|b1", b"|i1", b">i4", b"<f2"))
        header = b"{'descr': '%s', 'fortran_order': False, 'shape': %s, }\n" % (kind, shape)
    return content[:8] + struct.pack("<H", len(header)) + header + content[end:]


def _changed(content: bytes, rng: Random) -> bytes:
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 4, 16))):
        if not found:
            break
        reach = min(len(found), HEADER_BYTES) if rng.random() < 0.5 else len(found)
        i = rng.randrange(reach)
        match rng.randrange(10):
            case 0 | 1:
                found[i] ^= 1 << rng.randrange(8)
            case 2:
                found[i] = rng.randrange(256)
            case 3 | 4:
                number = rng.choice(NUMBERS)
                found[i : i + len(number)] = number
            case 5:
                del found[i : i + rng.choice((1, 4, 8, 64, 1024))]
            case 6:
                piece = found[i : i + rng.choice((1, 8, 64, 1024))]
                place = rng.randrange(len(found) + 1)
                found[place:place] = piece * rng.choice((1, 1, 16))
            case 7:
                chunk = rng.choice(CHUNKS)
                found[i : i + (len(chunk) if rng.random() < 0.5 else 0)] = chunk
            case 8:
                found[i:i] = rng.randbytes(rng.choice((1, 4, 8)))
            case _:
                del found[i:]
    return bytes(found)

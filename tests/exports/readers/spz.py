"""SPZ 2, 3 and 4 by the format's description, as each generation of readers finds them.

*UnityGaussianSplatting* (``SPZFileReader``) takes version 2 alone; readers of 2025 take 2 and 3; that of Niantic's library takes
all, and version 4 in a container of its own.
"""

from __future__ import annotations

import gzip
import struct

import numpy as np

__all__ = ["MAGIC", "read_spz"]

MAGIC = 0x5053474E


def read_spz(content: bytes, knows: tuple[int, ...] = (2, 3, 4)) -> dict[str, np.ndarray]:
    """What a file holds; quaternions are wxyz.

    Args:
        knows: versions that the reader takes.
    Raises:
        ValueError: of another version.
    """
    if content[:2] == b"\x1f\x8b":
        content = gzip.decompress(content)
        magic, version, count, degree, bits, flags, reserved = struct.unpack("<IIIBBBB", content[:16])
        assert version < 4 and reserved == 0
        body = content[16:]
    else:
        magic, version, count, degree, bits, flags, streams, table = struct.unpack("<IIIBBBBI", content[:20])
        assert content[20:32] == bytes(12) and table == 32
        body = _joined(content, streams, table)
    if magic != MAGIC or version not in knows:
        raise ValueError(f"unsupported version {version}")
    assert flags == 0
    at = 0

    def take(width: int) -> np.ndarray:
        nonlocal at
        part = np.frombuffer(body, np.uint8, count * width, at).reshape(count, width)
        at += count * width
        return part.astype(np.int64)

    raw = take(9).reshape(count, 3, 3)
    fixed = raw[..., 0] | raw[..., 1] << 8 | raw[..., 2] << 16
    fixed = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed)
    alpha, color, scale = take(1)[:, 0] / 255, take(3), take(3)
    quats = _first_three(take(3)) if version < 3 else _smallest_three(take(4))
    coefficients = (degree + 1) ** 2 - 1
    sh = (take(3 * coefficients).reshape(count, coefficients, 3) - 128) / 128
    assert at == len(body)
    return {
        "positions": fixed / 2.0**bits,
        "alpha": alpha,
        "dc": (color / 255 - 0.5) / 0.15,
        "log_scales": scale / 16 - 10,
        "quats": np.roll(quats, 1, axis=1),
        "sh": sh,
    }


def _joined(content: bytes, streams: int, table: int) -> bytes:
    """The attributes of a file of version 4, one after the other."""
    import zstandard

    at, found = table + 16 * streams, []
    for k in range(streams):
        packed, whole = struct.unpack_from("<QQ", content, table + 16 * k)
        found.append(zstandard.ZstdDecompressor().decompress(content[at : at + packed]))
        assert len(found[-1]) == whole
        at += packed
    assert at == len(content)
    return b"".join(found)


def _first_three(rotation: np.ndarray) -> np.ndarray:
    """(N, 4) xyzw of x y z in a byte each."""
    xyz = rotation / 127.5 - 1
    w = np.sqrt(np.maximum(0.0, 1 - np.square(xyz).sum(axis=1, keepdims=True)))
    return np.concatenate([xyz, w], axis=1)


def _smallest_three(rotation: np.ndarray) -> np.ndarray:
    """(N, 4) xyzw of four bytes each."""
    word = (rotation << np.array([0, 8, 16, 24])).sum(axis=1)
    largest, quats = word >> 30, np.zeros((len(word), 4))
    for row in range(len(word)):
        rest = int(word[row])
        for i in (3, 2, 1, 0):
            if i != largest[row]:
                size = (rest & 511) / 511 * np.sqrt(0.5)
                quats[row, i] = -size if rest & 512 else size
                rest >>= 10
        quats[row, largest[row]] = np.sqrt(max(0.0, 1 - np.square(quats[row]).sum()))
    return quats

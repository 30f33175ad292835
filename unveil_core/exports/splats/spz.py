"""SPZ, a tenth of the size of a PLY: fixed-point numbers, compressed (Niantic's *spz*, its README and ``load-spz.cc``).

Versions 2 and 3 are one gzip stream: a header of 16 bytes, magic "NGSP", version, count (uint32 each), degree, fractional bits,
flags, reserved (bytes); then for all splats, an attribute after the other. Version 4 is not gzipped: a header of 32 bytes, the same
with the number of streams in the last place and the offset of their table (uint32); the table, per stream its compressed and its
whole size (uint64); and the streams, each an attribute, compressed by Zstandard.

========== ============================================================== =================================================
positions  3 x 24-bit fixed point, y up                                   off by 2^-(bits + 1) units at most: 0.12 mm for 12 bits
opacity    8 bits                                                         off by 0.002 at most
colour     3 x 8 bits of 0.15 f_dc + 0.5                                  f_dc off by 0.013, a colour by 0.004; f_dc to +-3.3
scales     3 x 8 bits of 16 (ln scale + 10)                               off by 3.2 % at most, 45 micrometres to 379 units
rotation   the three smaller of x y z w: 9 bits and a sign each           each off by 0.0007 at most
           version 2: x y z of 8 bits each, w follows from them           each off by 0.004 at most, an axis by 1.6 degrees
harmonics  8 bits of 128 (c + 1), to 5 bits (degree 1), 4 bits (higher)   off by 0.031 and 0.063 at most, within +-0.99
========== ============================================================== =================================================

Labels and objects are lost. Coordinates are y up (the format's "RUB") less a shift, told in a JSON file beside it.
"""

from __future__ import annotations

import gzip
import struct
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.types import Float32, Float64
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.job import Job
from unveil_core.exports.splats.placed import opacities, placed
from unveil_core.exports.splats.ply import sidecar
from unveil_core.surfels.surfels import Surfels, three_log_scales

__all__ = [
    "MOST_FRACTIONAL_BITS",
    "SPZ_VERSION",
    "SPZ_VERSIONS",
    "check_spz",
    "packed",
    "packed_rotations",
    "write_spz",
]

MAGIC = 0x5053474E
SPZ_VERSIONS = (2, 3, 4)
"""That can be written. 2 is read by every program that reads SPZ, 3 by those of 2025 and later, 4 by the newest."""
SPZ_VERSION = 3
"""That is written unless another is asked for: its rotations are finer than those of 2, and few programs know 4 yet."""
ZSTANDARD_LEVEL = 12
"""As the format's own writer has it."""
MOST_FRACTIONAL_BITS = 12
"""Of positions: what other writers use, a quarter of a millimetre; fewer where the scene reaches over 2 km."""
COLOR_SCALE = 0.15
LEAST_LOG_SCALE, LOG_STEPS = 10.0, 16.0
BUCKETS = {1: 8, 2: 16, 3: 16}
"""Steps of 1/128 that coefficients of each degree are rounded to, as the format's own writer does: they compress better."""


def check_spz(version: int) -> None:
    """Check that a version can be written.

    Raises:
        SettingsError: no such version, or it needs a library that is not installed.
    """
    if version not in SPZ_VERSIONS:
        raise SettingsError(f"Not a version that is written: --spz {version}", mend="use 2, 3 or 4")
    if version >= 4 and find_spec("zstandard") is None:
        mend = "pip install '.[exports]' in the folder of Unveil, or use --spz 3"
        raise SettingsError("Not installed: zstandard, which SPZ 4 needs", mend=mend)


def write_spz(job: Job, path: Path) -> None:
    """The scene as one SPZ of the job's version.

    Raises:
        SettingsError: a scene too wide for its fixed-point positions.
    """
    frame = y_up(job.drive)
    there = placed(job.scene, frame.shifted)
    if len(there) and float(there.means.abs().max()) >= 2**22:
        raise SettingsError("Too far from its origin for SPZ", path=job.workspace.root, mend="export splat-ply")
    content = packed(there, three_log_scales(there, frame.from_local.scale).numpy(), job.spz_version)
    write_json_atomic(sidecar(path), {**frame.to_json(), "colorspace": job.colorspace})
    write_bytes_atomic(path, content)


def packed(surfels: Surfels, log_scales: Float32, version: int = SPZ_VERSION) -> bytes:
    """A file of splats (N) in its coordinates and three scales (N, 3) each; ``version``: of :data:`SPZ_VERSIONS`."""
    count, degree = len(surfels), surfels.sh_degree
    positions = surfels.means.double().numpy()
    bits = _fractional_bits(positions)
    sh = surfels.sh.double().numpy()
    quats = surfels.quats.double().numpy()
    parts = [
        _fixed_point(positions, bits),
        _bytes(opacities(surfels).double().numpy() * 255),
        _bytes((sh[:, 0] * COLOR_SCALE + 0.5) * 255),
        _bytes((log_scales.astype(np.float64) + LEAST_LOG_SCALE) * LOG_STEPS),
        packed_rotations(quats) if version >= 3 else _first_three(quats),
    ]
    if degree:
        buckets = np.repeat([BUCKETS[level] for level in range(1, degree + 1)], [3, 5, 7][:degree])[None, :, None]
        steps = np.round(sh[:, 1:] * 128 + 128)
        parts.append(_bytes(np.floor((steps + buckets / 2) / buckets) * buckets))
    if version >= 4:
        return _in_streams(parts, struct.pack("<IIIBBB", MAGIC, version, count, degree, bits, 0))
    head = struct.pack("<IIIBBBB", MAGIC, version, count, degree, bits, 0, 0)
    # Without a time in its header, the same scene gives the same file.
    return gzip.compress(b"".join((head, *parts)), mtime=0)


def _in_streams(parts: list[bytes], head: bytes) -> bytes:
    """A file of version 4 of its attributes and the first 15 bytes of its header; attributes of nothing have no stream."""
    import zstandard

    compressor = zstandard.ZstdCompressor(level=ZSTANDARD_LEVEL)
    kept = [part for part in parts if part]
    streams = [compressor.compress(part) for part in kept]
    table = b"".join(struct.pack("<QQ", len(s), len(part)) for s, part in zip(streams, kept, strict=True))
    return b"".join((head, struct.pack("<BI12x", len(streams), 32), table, *streams))


def _fractional_bits(positions: Float64) -> int:
    """As many as leave room for the largest coordinate in 24 bits with a sign."""
    reach = float(np.abs(positions).max(initial=0.0)) + 1.0
    return int(min(MOST_FRACTIONAL_BITS, max(0, 23 - np.ceil(np.log2(reach)))))


def _fixed_point(positions: Float64, bits: int) -> bytes:
    """24-bit little-endian signed integers."""
    steps = np.round(positions * 2.0**bits).astype("<i4")
    return steps.reshape(-1, 1).view(np.uint8)[:, :3].tobytes()


def _bytes(values: NDArray[np.number]) -> bytes:
    return np.clip(np.round(values), 0, 255).astype(np.uint8).tobytes()


def _first_three(quats: Float64) -> bytes:
    """3 bytes each of unit quaternions wxyz (N, 4): x y z.

    w follows from them, badly where it is small. A splat turned by half a circle about one of its axes is the same splat, so each
    is turned such that its largest component becomes w, and by its sign such that w is positive.
    """
    w, x, y, z = quats.T
    turned = np.stack([np.stack(q) for q in ((w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w))])
    q = turned[np.abs(quats).argmax(axis=1), :, np.arange(len(quats))]
    return _bytes(q[:, 1:] * np.where(q[:, :1] < 0, -127.5, 127.5) + 127.5)


def packed_rotations(quats: Float64) -> bytes:
    """4 bytes each of unit quaternions wxyz (N, 4): which of x y z w is largest, and the other three with a sign and 9 bits of
    their share of the square root of a half."""
    q = np.roll(quats, -1, axis=1)
    largest = np.abs(q).argmax(axis=1)
    rows = np.arange(len(q))
    q = q * np.where(q[rows, largest] < 0, -1.0, 1.0)[:, None]  # then the largest needs no sign
    word = largest.astype(np.uint32)
    for i in range(4):
        size = np.clip(np.floor(511 * np.abs(q[:, i]) * np.sqrt(2) + 0.5), 0, 511).astype(np.uint32)
        value = (word << 10) | ((q[:, i] < 0).astype(np.uint32) << 9) | size
        word = np.where(largest == i, word, value).astype(np.uint32)
    return word.astype("<u4").tobytes()

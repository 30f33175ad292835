"""SPZ version 3, a tenth of the size of a PLY: fixed-point numbers, gzipped (Niantic's *spz*, its README and ``load-spz.cc``).

Header, 16 bytes: magic "NGSP", version, count (uint32 each), degree, fractional bits, flags, reserved (bytes). Then for all
splats, an attribute after the other:

========== ============================================================== =================================================
positions  3 x 24-bit fixed point, y up                                   off by 2^-(bits + 1) units at most: 0.12 mm for 12 bits
opacity    8 bits                                                         off by 0.002 at most
colour     3 x 8 bits of 0.15 f_dc + 0.5                                  f_dc off by 0.013, a colour by 0.004; f_dc to +-3.3
scales     3 x 8 bits of 16 (ln scale + 10)                               off by 3.2 % at most, 45 micrometres to 379 units
rotation   the three smaller of x y z w: 9 bits and a sign each           each off by 0.0007 at most
harmonics  8 bits of 128 (c + 1), to 5 bits (degree 1), 4 bits (higher)   off by 0.031 and 0.063 at most, within +-0.99
========== ============================================================== =================================================

Labels and objects are lost. Coordinates are y up (the format's "RUB") less a shift, told in a JSON file beside it.
"""

from __future__ import annotations

import gzip
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.types import Float32, Float64
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.job import Job
from unveil_core.exports.splats.placed import opacities, placed, three_log_scales
from unveil_core.exports.splats.ply import sidecar
from unveil_core.surfels.surfels import Surfels

__all__ = ["MOST_FRACTIONAL_BITS", "packed", "packed_rotations", "write_spz"]

MAGIC, VERSION = 0x5053474E, 3
MOST_FRACTIONAL_BITS = 12
"""Of positions: what other writers use, a quarter of a millimetre; fewer where the scene reaches over 2 km."""
COLOR_SCALE = 0.15
LEAST_LOG_SCALE, LOG_STEPS = 10.0, 16.0
BUCKETS = {1: 8, 2: 16, 3: 16}
"""Steps of 1/128 that coefficients of each degree are rounded to, as the format's own writer does: they compress better."""


def write_spz(job: Job, path: Path) -> None:
    """The scene as one SPZ.

    Raises:
        SettingsError: a scene too wide for its fixed-point positions.
    """
    frame = y_up(job.drive)
    there = placed(job.scene, frame.shifted)
    if len(there) and float(there.means.abs().max()) >= 2**22:
        raise SettingsError("is too far from its origin for SPZ", path=job.workspace.root, mend="export splat-ply")
    content = packed(there, three_log_scales(there, frame.from_local.scale).numpy())
    write_json_atomic(sidecar(path), frame.to_json())
    # Without a time in its header, the same scene gives the same file.
    write_bytes_atomic(path, gzip.compress(content, mtime=0))


def packed(surfels: Surfels, log_scales: Float32) -> bytes:
    """The content of a file, not yet compressed, of splats (N) in its coordinates and three scales (N, 3) each."""
    count, degree = len(surfels), surfels.sh_degree
    positions = surfels.means.double().numpy()
    bits = _fractional_bits(positions)
    sh = surfels.sh.double().numpy()
    parts = [
        struct.pack("<IIIBBBB", MAGIC, VERSION, count, degree, bits, 0, 0),
        _fixed_point(positions, bits),
        _bytes(opacities(surfels).double().numpy() * 255),
        _bytes((sh[:, 0] * COLOR_SCALE + 0.5) * 255),
        _bytes((log_scales.astype(np.float64) + LEAST_LOG_SCALE) * LOG_STEPS),
        packed_rotations(surfels.quats.double().numpy()),
    ]
    if degree:
        buckets = np.repeat([BUCKETS[level] for level in range(1, degree + 1)], [3, 5, 7][:degree])[None, :, None]
        steps = np.round(sh[:, 1:] * 128 + 128)
        parts.append(_bytes(np.floor((steps + buckets / 2) / buckets) * buckets))
    return b"".join(parts)


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

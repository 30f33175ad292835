"""Colour profiles of the ICC (ICC.1:2022, and version 2) as far as they say what RGB or grey means: three primaries with a white,
and a curve for each. Profiles of printers and those that are tables of colours are recognized and not read.

A profile has its primaries as they are under the light of its connection space, D50, and how they were adapted to it, or at least
the white that they have without.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["BRADFORD", "D50", "Curve", "Profile", "adaptation", "read_profile"]

D50 = np.array([0.9642, 1.0, 0.8249])
"""White of the connection space, XYZ."""
BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
"""From XYZ to the responses in which whites are adapted."""
MOST_TAGS, MOST_SAMPLES = 200, 1 << 16
FUNCTIONS = {0: "g", 1: "gab", 2: "gabc", 3: "gabcd", 4: "gabcdef"}
"""Parameters of the kinds of curves that are formulas."""


@dataclass(frozen=True, eq=False)
class Curve:
    """From an encoded value to light, both 0 to 1.

    Attributes:
        samples: (N,) at even steps; parameters: of a formula, by its letters; one of them is None.
    """

    samples: Float64 | None = None
    parameters: dict[str, float] | None = None

    def light(self, value: NDArray[np.floating]) -> Float64:
        """Of values of any shape."""
        x = np.asarray(value, dtype=np.float64)
        if self.samples is not None:
            return np.interp(x, np.linspace(0, 1, len(self.samples)), self.samples)
        p = {"a": 1.0, "b": 0.0, "c": 0.0, "d": 0.0, "e": 0.0, "f": 0.0, **(self.parameters or {"g": 1.0})}
        power = np.maximum(p["a"] * x + p["b"], 0) ** p["g"]
        if "d" in (self.parameters or {}):
            return np.where(x >= p["d"], power + p["e"], p["c"] * x + p["f"])
        return power + p["c"]


@dataclass(frozen=True, eq=False)
class Profile:
    """Attributes:
    name: its description.
    kind: "RGB" or "GRAY", or what else it is for.
    matrix: (3, 3) XYZ under D50 of red, green and blue, in columns; None of one without primaries.
    white: (3,) XYZ of its white as it is; None where it does not tell.
    curves: one of grey, three of RGB; none where these are tables.
    """

    name: str
    kind: str
    matrix: Float64 | None
    white: Float64 | None
    curves: tuple[Curve, ...]


def adaptation(source: Float64, target: Float64) -> Float64:
    """(3, 3) from XYZ under one white (3,) to XYZ under another, by Bradford's responses."""
    gain = (BRADFORD @ target) / (BRADFORD @ source)
    return np.asarray(np.linalg.inv(BRADFORD) @ np.diag(gain) @ BRADFORD)


def read_profile(content: bytes) -> Profile | None:
    """What a profile says; None where it is damaged."""
    if len(content) < 132 or content[36:40] != b"acsp":
        return None
    try:
        tags = _tags(content)
        kind = content[16:20].decode("ascii", errors="replace").strip()
        columns = [_xyz(tags.get(name)) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]
        known = [c for c in columns if c is not None]
        matrix = np.stack(known, axis=1) if len(known) == 3 else None
        curves = [_curve(tags.get(name)) for name in ((b"kTRC",) if kind == "GRAY" else (b"rTRC", b"gTRC", b"bTRC"))]
        tables = b"A2B0" in tags and (matrix is None or content[20:24] != b"XYZ ")
        white = _xyz(tags.get(b"wtpt"))
        if (adapted := tags.get(b"chad")) is not None and adapted[:4] == b"sf32" and len(adapted) >= 44:
            white = np.linalg.solve(_fixed(adapted, 8, 9).reshape(3, 3), D50)
        whole = () if tables or any(c is None for c in curves) else tuple(c for c in curves if c is not None)
        return Profile(_name(tags.get(b"desc", b"")) or "unnamed", kind, matrix, white, whole)
    except (ValueError, struct.error, np.linalg.LinAlgError, UnicodeDecodeError):
        return None


def _tags(content: bytes) -> dict[bytes, bytes]:
    """Content of the tags by their signature."""
    count = struct.unpack_from(">I", content, 128)[0]
    found: dict[bytes, bytes] = {}
    for k in range(min(count, MOST_TAGS)):
        name, at, size = struct.unpack_from(">4sII", content, 132 + 12 * k)
        if at + size <= len(content):
            found.setdefault(name, content[at : at + size])
    return found


def _fixed(content: bytes, at: int, count: int) -> Float64:
    """Numbers with 16 bits before and behind the point."""
    return np.array(struct.unpack_from(f">{count}i", content, at), dtype=np.float64) / 65536


def _xyz(content: bytes | None) -> Float64 | None:
    return _fixed(content, 8, 3) if content is not None and content[:4] == b"XYZ " and len(content) >= 20 else None


def _curve(content: bytes | None) -> Curve | None:
    if content is None or len(content) < 12:
        return None
    if content[:4] == b"para":
        letters = FUNCTIONS.get(struct.unpack_from(">H", content, 8)[0])
        if letters is None:
            return None
        numbers = dict(zip(letters, _fixed(content, 12, len(letters)).tolist(), strict=True))
        if letters == "gab":  # 0 up to where the power begins
            numbers |= {"d": -numbers["b"] / numbers["a"] if numbers["a"] else 0.0}
        elif letters == "gabc":  # c up to there, and added beyond
            numbers |= {
                "d": -numbers["b"] / numbers["a"] if numbers["a"] else 0.0,
                "e": numbers["c"],
                "f": numbers["c"],
                "c": 0.0,
            }
        return Curve(parameters=numbers)
    if content[:4] != b"curv":
        return None
    count = struct.unpack_from(">I", content, 8)[0]
    if count == 0:
        return Curve(parameters={"g": 1.0})
    if count == 1:
        return Curve(parameters={"g": struct.unpack_from(">H", content, 12)[0] / 256})
    if count > MOST_SAMPLES:
        return None
    return Curve(samples=np.array(struct.unpack_from(f">{count}H", content, 12), dtype=np.float64) / 65535)


def _name(content: bytes) -> str:
    """A description of version 2 or 4, in its first language."""
    if content[:4] == b"desc":
        size = struct.unpack_from(">I", content, 8)[0]
        text = content[12 : 12 + min(size, 200)].split(b"\0")[0].decode("ascii", errors="replace")
    elif content[:4] == b"mluc":
        size, at = struct.unpack_from(">II", content, 20)
        text = content[at : at + min(size, 400)].decode("utf-16-be", errors="replace")
    else:
        return ""
    return "".join(c for c in text if c.isprintable()).strip()

"""Colour profiles made byte by byte, with the published numbers of well-known colours under D50."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

__all__ = ["ADOBE", "COLUMNS", "GAMMA", "LINEAR", "P3", "PROPHOTO", "REC2020", "SRGB", "STEPS", "profile"]

SRGB = ((0.43607, 0.22249, 0.01392), (0.38515, 0.71687, 0.09708), (0.14307, 0.06061, 0.71410))
P3 = ((0.51512, 0.24120, -0.00105), (0.29198, 0.69225, 0.04189), (0.15710, 0.06657, 0.78407))
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
REC2020 = ((0.67348, 0.27904, -0.00194), (0.16566, 0.67534, 0.02998), (0.12505, 0.04561, 0.79686))
PROPHOTO = ((0.79767, 0.28804, 0.0), (0.13519, 0.71187, 0.0), (0.03134, 0.00009, 0.82491))
COLUMNS = {"sRGB": SRGB, "Display P3": P3, "Adobe RGB (1998)": ADOBE, "Rec. 2020": REC2020, "ProPhoto RGB": PROPHOTO}
"""XYZ of red, green and blue."""


def _fixed(*values: float) -> bytes:
    return struct.pack(f">{len(values)}i", *(round(v * 65536) for v in values))


LINEAR = b"curv" + bytes(4) + struct.pack(">I", 0)


def GAMMA(power: float) -> bytes:
    """A curve that is a power."""
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(power * 256)) + bytes(2)


OF_SRGB = b"para" + bytes(4) + struct.pack(">HH", 3, 0) + _fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
"""sRGB's curve as a formula."""
_steps = np.linspace(0, 1, 1024)
_light = np.where(_steps <= 0.04045, _steps / 12.92, ((_steps + 0.055) / 1.055) ** 2.4)
STEPS = b"curv" + bytes(4) + struct.pack(">I1024H", 1024, *np.round(_light * 65535).astype(int).tolist())
"""The same at even steps, as old profiles have it."""


def profile(
    name: str,
    columns: Sequence[Sequence[float]] | None,
    curve: bytes = OF_SRGB,
    *,
    kind: bytes = b"RGB ",
    version: int = 4,
    white: Sequence[float] = (0.9642, 1.0, 0.8249),
    more: Sequence[tuple[bytes, bytes]] = (),
) -> bytes:
    """A profile of a screen, or of grey where it has no columns.

    Args:
        white: as it is told: in version 2 that of the screen; more: tags, as they are.
    """
    if version == 2:
        text = b"desc" + bytes(4) + struct.pack(">I", len(name) + 1) + name.encode() + bytes(80)
    else:
        words = name.encode("utf-16-be")
        text = b"mluc" + bytes(4) + struct.pack(">II2s2sII", 1, 12, b"en", b"US", len(words), 28) + words
    tags = [(b"desc", text), (b"wtpt", b"XYZ " + bytes(4) + _fixed(*white)), *more]
    if columns is None:
        tags.append((b"kTRC", curve))
    else:
        for letter, column in zip((b"r", b"g", b"b"), columns, strict=True):
            tags += [(letter + b"XYZ", b"XYZ " + bytes(4) + _fixed(*column)), (letter + b"TRC", curve)]
    at = 132 + 12 * len(tags)
    table, body = struct.pack(">I", len(tags)), b""
    for sign, content in tags:
        content += bytes(-len(content) % 4)
        table += struct.pack(">4sII", sign, at + len(body), len(content))
        body += content
    size = at + len(body)
    head = struct.pack(">I4sI4s4s4s", size, b"none", version << 24, b"mntr", kind, b"XYZ ") + bytes(12) + b"acsp"
    head = head + bytes(28) + _fixed(0.9642, 1.0, 0.8249)
    return head + bytes(128 - len(head)) + table + body

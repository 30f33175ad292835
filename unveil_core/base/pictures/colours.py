"""What the numbers of a picture mean: which primaries and white, and how light is encoded. By its profile or its chunks, in the
order of W3C PNG, third edition, section 4.3, or by what its camera noted; sRGB where nothing says anything.

Names are those of the Color Interop Forum where it has one, as OpenEXR, OpenColorIO and glTF use them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.exif import exif_facts
from unveil_core.base.pictures.icc import D50, Curve, adaptation, read_profile
from unveil_core.base.pictures.metadata import Metadata
from unveil_core.base.srgb import linear_of_srgb
from unveil_core.base.types import Float64

__all__ = ["SRGB", "Colours", "colours_of", "to_xyz"]

D65 = (0.3127, 0.3290)
REC709 = (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *D65)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65)
ADOBE = (0.640, 0.330, 0.210, 0.710, 0.150, 0.060, *D65)
REC2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65)
ROMM = (0.7347, 0.2653, 0.1596, 0.8404, 0.0366, 0.0001, 0.3457, 0.3585)
"""Chromaticities: x and y of red, green, blue and white."""
SRGB_CURVE = Curve(parameters={"g": 2.4, "a": 1 / 1.055, "b": 0.055 / 1.055, "c": 1 / 12.92, "d": 0.04045})
NEAR, NEAR_CURVE = 3e-3, 4e-3
"""By how much the numbers of a matrix, and light at a value, may differ and still be the same: profiles round."""


@dataclass(frozen=True, eq=False)
class Colours:
    """Attributes:
    name: for people, as "Display P3".
    encoded, linear: names of the Color Interop Forum of the numbers as they are, and of their light; "" for none.
    chromaticities: x and y of red, green, blue and white; None where they are not told.
    curves: one, or one each of red, green and blue; none where they are not known.
    """

    name: str
    encoded: str
    linear: str
    chromaticities: tuple[float, ...] | None
    curves: tuple[Curve, ...]

    @property
    def is_srgb(self) -> bool:
        """Whether they are those that pictures have without a word."""
        return self.encoded == SRGB.encoded

    @property
    def is_known(self) -> bool:
        """Whether light can be computed of them."""
        return bool(self.curves) and self.chromaticities is not None

    def light(self, picture: NDArray[np.floating]) -> Float64:
        """(H, W, 3) light of a picture (H, W, 3) in [0, 1], in its own primaries; as of sRGB where its curves are not known."""
        if self.is_srgb or not self.curves:
            return linear_of_srgb(picture)
        if len(self.curves) == 1:
            return self.curves[0].light(picture)
        return np.stack([curve.light(picture[..., k]) for k, curve in enumerate(self.curves)], axis=-1)


SRGB = Colours("sRGB", "srgb_rec709_display", "lin_rec709_scene", REC709, (SRGB_CURVE,))
KNOWN = (
    SRGB,
    Colours("Display P3", "srgb_p3d65_display", "lin_p3d65_scene", P3, (SRGB_CURVE,)),
    Colours(
        "Adobe RGB (1998)", "g22_adobergb_display", "lin_adobergb_scene", ADOBE, (Curve(parameters={"g": 563 / 256}),)
    ),
    Colours("ProPhoto RGB", "", "", ROMM, (Curve(parameters={"g": 1.8, "a": 1, "b": 0, "c": 1 / 16, "d": 1 / 32}),)),
    Colours("Rec. 2020", "", "lin_rec2020_scene", REC2020, ()),
)
ADOBE_RGB = KNOWN[2]
PRIMARIES = {1: REC709, 9: REC2020, 12: P3}
TRANSFERS = {
    8: Curve(parameters={"g": 1.0}),
    13: SRGB_CURVE,
    4: Curve(parameters={"g": 2.2}),
    5: Curve(parameters={"g": 2.8}),
}
"""Of ITU-T H.273, which a PNG names in its chunk cICP. Those of television (1, 6, 14, 15), PQ and HLG are not read as light."""


def colours_of(metadata: Metadata) -> Colours:
    """The colours of a picture that has this beside its pixels."""
    if (coded := metadata.chunk(b"cICP")) is not None and len(coded) == 4:
        return _of_codes(coded[0], coded[1])
    if metadata.profile is not None and (found := _of_profile(metadata.profile)) is not None:
        return found
    if metadata.chunk(b"sRGB") is not None:
        return SRGB
    gamma, corners = metadata.chunk(b"gAMA"), metadata.chunk(b"cHRM")
    if gamma is not None and len(gamma) == 4:
        return _of_chunks(gamma, corners)
    return ADOBE_RGB if exif_facts(metadata.exif).adobe_rgb else SRGB


def to_xyz(chromaticities: tuple[float, ...]) -> Float64:
    """(3, 3) from light in primaries to XYZ under D50."""
    xy = np.array(chromaticities, dtype=np.float64).reshape(4, 2)
    xyz = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(axis=1)) / xy[:, 1]])
    matrix = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    return np.asarray(adaptation(xyz[:, 3], D50) @ matrix)


def _of_profile(content: bytes) -> Colours | None:
    """None of profiles that are damaged, or not for pictures of a screen."""
    profile = read_profile(content)
    if profile is None or profile.kind not in ("RGB", "GRAY"):
        return None
    if profile.kind == "GRAY":
        return _known(REC709, profile.curves, profile.name)
    if profile.matrix is None:
        return Colours(profile.name, "", "", None, ())
    for one in KNOWN:
        assert one.chromaticities is not None
        if np.abs(to_xyz(one.chromaticities) - profile.matrix).max() < NEAR:
            return _known(one.chromaticities, profile.curves, profile.name)
    white = D50 if profile.white is None else profile.white
    try:
        corners = np.concatenate([adaptation(D50, white) @ profile.matrix, white[:, None]], axis=1)
        xy = (corners[:2] / corners.sum(axis=0)).T.ravel()
    except (ArithmeticError, np.linalg.LinAlgError):
        return Colours(profile.name, "", "", None, profile.curves)
    told = tuple(np.round(xy, 5).tolist()) if np.isfinite(xy).all() else None
    return Colours(profile.name, "", "", told, profile.curves)


def _known(corners: tuple[float, ...], curves: tuple[Curve, ...], name: str) -> Colours:
    """The colours of these primaries and curves, by the name that they are known by, else by their own."""
    steps = np.linspace(0, 1, 65)
    for one in KNOWN:
        same = one.chromaticities == corners and bool(curves) and bool(one.curves)
        if same and all(np.abs(c.light(steps) - one.curves[0].light(steps)).max() < NEAR_CURVE for c in curves):
            return one
    linear = next((one.linear for one in KNOWN if one.chromaticities == corners), "")
    return Colours(name, "", linear, corners, curves)


def _of_codes(primaries: int, transfer: int) -> Colours:
    name = f"H.273 {primaries}, {transfer}"
    corners, curve = PRIMARIES.get(primaries), TRANSFERS.get(transfer)
    if corners is None:
        return Colours(name, "", "", None, () if curve is None else (curve,))
    return _known(corners, () if curve is None else (curve,), name)


def _of_chunks(gamma: bytes, corners: bytes | None) -> Colours:
    """By gAMA and cHRM."""
    power = struct.unpack(">I", gamma)[0] / 100_000
    exact = REC709
    if corners is not None and len(corners) == 32:
        white_x, white_y, *rest = (v / 100_000 for v in struct.unpack(">8I", corners))
        told = (*rest, white_x, white_y)
        exact = next((o for o in PRIMARIES.values() if np.abs(np.subtract(o, told)).max() < NEAR), told)
    if not 0.1 < power < 10 or min(exact[1::2]) <= 0:
        return SRGB
    if abs(power - 1 / 2.2) < 1e-3 and exact == REC709:
        return SRGB  # who writes these means sRGB
    return _known(exact, (Curve(parameters={"g": 1 / power}),), f"gamma {1 / power:.3g}")

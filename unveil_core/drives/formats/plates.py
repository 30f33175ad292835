"""What the plates of a drive mean: one way for all of them, found from their headers and from a few of their pictures."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from unveil_core.base.pictures.colours import SRGB, to_xyz
from unveil_core.base.plates.colours import PlateColours
from unveil_core.base.plates.exr import is_lossy
from unveil_core.base.plates.files import plate_facts, read_plate
from unveil_core.base.plates.library import PLATES
from unveil_core.base.plates.ocio import space_of_file
from unveil_core.base.plates.plate import PlateFacts
from unveil_core.base.srgb import srgb_of_linear
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.importing.colours import looked_at

__all__ = ["with_plates"]

ACES = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
ACESCG = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
"""Chromaticities of AP0 and AP1: x and y of red, green, blue and white."""
PRIMARIES = {"lin_ap0_scene": ACES, "lin_ap1_scene": ACESCG, "aces2065-1": ACES, "acescg": ACESCG}
"""Names of spaces in headers, in small letters."""
DPX = {
    "printing density": "log", "logarithmic": "log", "linear": "linear", "itu-r 709-4": "rec709", "rec709": "rec709",
    "smpte 274m": "rec709", "unspecified video": "rec709",
}  # fmt: skip
"""Encodings by what a DPX calls its transfer, in small letters."""
LOG_BITS = 10
"""Of a DPX that does not tell its transfer: so deep they are logarithmic, by habit."""
GREY = 0.18
"""Mean light of a picture that is exposed as usual."""
USUAL = 0.02, 0.6
"""Mean light that needs no other exposure: dusk, and a street in snow."""
BRIGHTEST = 99.99
"""Percentile of the channels that is taken for the brightest: single pixels are sparks."""
STEP = 7
"""Every so many pixels are looked at, across and down."""


def with_plates(drive: Drive) -> Drive:
    """The drive with what its plates mean at each frame that is one, and a line that tells it.

    Raises:
        DriveError: a plate that cannot be read, or OpenImageIO is not installed. SettingsError: see ``base.plates.ocio``.
    """
    plates = [f for f in drive.frames if f.image_bytes is None and f.image_path.suffix.lower() in PLATES]
    if not plates:
        return drive
    seen = looked_at(plates)
    facts = plate_facts(seen[0].image_path)
    colours, told = _meant(seen[0].image_path, facts)
    colours = _exposed(colours, seen)
    chosen = {id(f) for f in plates}
    frames = tuple(replace(f, plate=colours) if id(f) in chosen else f for f in drive.frames)
    return replace(drive, frames=frames, notices=(*drive.notices, _line(facts, colours, told)))


def _meant(path: Path, facts: PlateFacts) -> tuple[PlateColours, str]:
    """What the numbers of a plate are, by the studio's configuration or its header, and how that is known."""
    configuration = os.environ.get("OCIO", "").strip()
    if configuration:
        space = space_of_file(configuration, path, facts.kind)
        return PlateColours("ocio", configuration=configuration, space=space), f"{space}, by OCIO"
    if facts.kind == "dpx":
        named = str(facts.attributes.get("dpx:Transfer", "")).lower()
        if named in DPX:
            return PlateColours(DPX[named]), f"{DPX[named]}, as their header says"
        guess = "log" if facts.bits == LOG_BITS else "srgb"
        return PlateColours(guess), f"taken as {guess}, which their header does not tell; OCIO decides"
    corners, name = _primaries(facts)
    if corners is None:
        return PlateColours(), "linear Rec. 709"
    turn = np.linalg.solve(to_xyz(SRGB.chromaticities or ()), to_xyz(corners))
    return PlateColours(to_rec709=tuple(turn.ravel().tolist())), f"linear {name}"


def _primaries(facts: PlateFacts) -> tuple[tuple[float, ...] | None, str]:
    """Chromaticities of an EXR, None for those of Rec. 709, and what they are called."""
    told = facts.attributes.get("chromaticities")
    if told is not None and len(told) == 8 and np.isfinite(told).all() and min(told[1::2]) > -1 and told[7] > 0:
        corners = tuple(float(v) for v in told)
        usual = np.abs(np.subtract(corners, SRGB.chromaticities or ())).max() < 2e-3
        known = {ACES: "ACES2065-1", ACESCG: "ACEScg"}
        name = next((n for c, n in known.items() if np.abs(np.subtract(c, corners)).max() < 2e-3), "of their primaries")
        return (None, "") if usual else (corners, name)
    space = str(facts.attributes.get("colorInteropID", "")).lower()
    if space in PRIMARIES:
        return PRIMARIES[space], space
    if facts.attributes.get("acesImageContainerFlag"):
        return ACES, "ACES2065-1"
    return None, ""


def _exposed(colours: PlateColours, seen: list[Frame]) -> PlateColours:
    """The colours with an exposure and a ceiling that fit what some plates show."""
    light = np.concatenate([_some_light(colours, f) for f in seen])
    level = float(np.exp(np.log(np.maximum(light, 1e-4)).mean())) if len(light) else GREY
    exposure = 1.0 if USUAL[0] <= level <= USUAL[1] else 2.0 ** round(float(np.log2(GREY / level)))
    brightest = float(np.percentile(light, BRIGHTEST)) * exposure if len(light) else 1.0
    ceiling = float(srgb_of_linear(np.array(max(brightest, 1.0))))
    return replace(colours, exposure=exposure, ceiling=round(ceiling, 4) if ceiling > 1.001 else 1.0)


def _some_light(colours: PlateColours, frame: Frame) -> Float64:
    size = (frame.camera.width, frame.camera.height)
    values = read_plate(frame.image_path, size).values[::STEP, ::STEP].reshape(-1, 3)
    light = colours.light(values)
    return light[np.isfinite(light).all(axis=1)].ravel()


def _line(facts: PlateFacts, colours: PlateColours, told: str) -> str:
    stops = round(float(np.log2(colours.exposure)))
    exposed = f", exposed by {stops:+d} stops for the scene alone" if stops else ""
    kind = "EXR" if facts.kind == "openexr" else "DPX"
    packed = ", but packed without loss" if is_lossy(facts) else ""
    return f"plates are {kind}, {told}{exposed}; frames/ gets them back as they came{packed}, beside PNGs"

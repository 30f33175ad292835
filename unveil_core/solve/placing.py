"""Metres and up of a solved model, from what is known of the footage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, Frame, PointCloud, tracks
from unveil_core.drives.scale_and_up import CAMERA_HEIGHT_M, camera_height, measured_up
from unveil_core.geometry.axes import upright
from unveil_core.geometry.similarity import Similarity
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.gpx import level_metres, read_gpx
from unveil_core.solve.mapping.model import Model
from unveil_core.solve.settings import SolveSettings

__all__ = ["Placed", "as_drive", "height_over_way", "placed", "up_and_height"]

FEWEST_PLACES = 3
"""Places of a GPS receiver that tell the scale."""
BESIDE, AROUND, FINE, CLOSE = 0.6, 0.35, 0.1, 0.05
"""In heights of the camera: points so far beside the way are below it; drops so far from the rough height count; steps of the way;
and how close the drops lie that agree."""
FEWEST_BELOW = 60
LEAST_WAY_M = 20.0
"""Way that they tell it over: receivers are off by metres."""


@dataclass(frozen=True, eq=False)
class Placed:
    """Attributes:
    to_model: from metres with z up to the model's own coordinates.
    known: the scale is; False: cameras are assumed to be at the usual height.
    told: how it was found, one line.
    up_source: "ground" or "cameras".
    height_m: of the cameras above the ground; None where no ground was found.
    """

    to_model: Similarity
    known: bool
    told: str
    up_source: str
    height_m: float | None


def as_drive(model: Model, cameras: Sequence[str], points: PointCloud) -> Drive:
    """A model as a drive without files, for what is asked of drives.

    Args:
        cameras: name of each picture's camera.
    """
    frames = tuple(
        Frame(name=name, camera_name=camera, camera=model.camera(i), image_path=Path(name))
        for i, (name, camera) in enumerate(zip(model.names, cameras, strict=True))
    )
    return Drive(Path("."), frames, points, units_per_metre=None, scale_source="", up=None, up_source="")


def up_and_height(model: Model, cameras: Sequence[str], points: PointCloud) -> tuple[Float64, str, float | None]:
    """(3,) unit vector that is up in a model, what tells it, and the height of the cameras above the ground in its units, None
    where no ground is seen."""
    drive = as_drive(model, cameras, points)
    up, source = measured_up(drive)
    roughly = camera_height(drive, up)
    if roughly is None:
        return up, source, None
    below = height_over_way([drive.frames[i].camera.centre for i in tracks(drive)[0]], points.positions, up, roughly)
    return up, source, roughly if below is None else below


def height_over_way(centres: Sequence[Float64], points: Float64, up: Float64, roughly: float) -> float | None:
    """Height of a camera above what it drives over, in units of its positions; None where too few points lie there.

    What lies beside the way is often higher by a kerb, which is a tenth of a camera's height.

    Args:
        centres: (3,) each, in order; points: (P, 3); up: (3,) unit; roughly: the height as all points below the cameras tell it.
    """
    way = np.stack(centres)
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if along[-1] < roughly:
        return None
    fine = np.arange(0.0, along[-1], FINE * roughly)
    path = np.stack([np.interp(fine, along, way[:, k]) for k in range(3)], axis=1)
    level = upright(up)[:, :2]
    apart, nearest = cKDTree(path @ level).query(points @ level, distance_upper_bound=BESIDE * roughly)
    under = np.isfinite(apart)
    drop = (path[nearest[under]] - points[under]) @ up
    drop = drop[np.abs(drop / roughly - 1) < AROUND]
    if len(drop) < FEWEST_BELOW:
        return None
    drop = np.sort(drop)
    # The densest: what lies on the ground only makes it higher, and points that are wrong lie anywhere.
    first, last = np.searchsorted(drop, drop - CLOSE * roughly), np.searchsorted(drop, drop + CLOSE * roughly)
    best = int(np.argmax(last - first))
    return float(np.median(drop[first[best] : last[best]]))


def placed(
    model: Model, reels: Sequence[Reel], up: Float64, up_source: str, height: float | None, settings: SolveSettings
) -> Placed:
    """Where metres and up are in a model.

    Args:
        up, up_source, height: see :func:`up_and_height`.
    Raises:
        DriveError: what is given does not tell the scale of this footage.
    """
    units, known, told = _scale(model, reels, up, height, settings)
    origin = model.centres[0]
    return Placed(
        Similarity(units, upright(up), origin), known, told, up_source, None if height is None else height / units
    )


def _scale(
    model: Model, reels: Sequence[Reel], up: Float64, height: float | None, settings: SolveSettings
) -> tuple[float, bool, str]:
    """Units of the model in a metre, whether that is known, and how."""
    way, seconds = _way(model, reels)
    if settings.camera_height is not None:
        if height is None:
            raise DriveError(
                "shows no ground below its cameras, so their height gives no scale",
                path=reels[0].source,
                mend="give --speed or --known-length instead",
            )
        return height / settings.camera_height, True, f"the cameras are {settings.camera_height:g} m high, as given"
    if settings.known_length is not None:
        return way / settings.known_length, True, f"the way is {settings.known_length:g} m long, as given"
    if settings.speed is not None:
        if seconds is None:
            raise DriveError(
                "has no time stamps, so a speed gives no scale",
                path=reels[0].source,
                mend="give --known-length or --camera-height instead",
            )
        return way / (settings.speed / 3.6 * seconds), True, f"the mean speed is {settings.speed:g} km/h, as given"
    if settings.gpx is not None:
        return _by_gpx(model, reels, settings.gpx, up), True, f"the track {settings.gpx.name}"
    by_exif = _by_places(model, _noted_places(reels), up)
    if by_exif is not None:
        return by_exif, True, "the places that the photographs note (GPS)"
    if height is not None:
        assumed = f"the cameras are assumed to be {CAMERA_HEIGHT_M} m above the ground; --camera-height METRES decides"
        return height / CAMERA_HEIGHT_M, False, assumed
    return 1.0, False, "the scale is unknown: give --camera-height, --speed, --known-length or --gpx"


def _way(model: Model, reels: Sequence[Reel]) -> tuple[float, float | None]:
    """Length of the first camera's way in units of the model, and the seconds that it took."""
    number = {n: i for i, n in enumerate(model.names)}
    frames = [f for f in reels[0].frames if f.file in number]
    centres = model.centres[[number[f.file] for f in frames]]
    # Of many frames a second each step is short, and what shakes adds to it: some steps are long enough not to.
    some = centres[np.unique(np.linspace(0, len(centres) - 1, min(len(centres), 60)).astype(int))]
    length = float(np.linalg.norm(np.diff(some, axis=0), axis=1).sum())
    if length <= 0:
        raise DriveError("The camera did not move", path=reels[0].source, mend="give a part in which it does")
    first, last = frames[0].time_s, frames[-1].time_s
    return length, None if first is None or last is None or last <= first else last - first


def _noted_places(reels: Sequence[Reel]) -> list[tuple[FootageFrame, float, float]]:
    return [
        (f, f.latitude, f.longitude)
        for reel in reels
        for f in reel.frames
        if f.latitude is not None and f.longitude is not None
    ]


def _by_gpx(model: Model, reels: Sequence[Reel], path: Path, up: Float64) -> float:
    times, places = read_gpx(path)
    timed = []
    for reel in reels:
        start = reel.begun if reel.begun is not None else 0.0
        timed += [(f, start + f.time_s) for f in reel.frames if f.time_s is not None]
    inside = [(f, t) for f, t in timed if times[0] <= t <= times[-1]]
    if len(inside) < FEWEST_PLACES:
        first = f", whose first frame is at {timed[0][1]:.0f} s since 1970" if timed else ", which has no times"
        raise DriveError(
            f"covers {times[0]:.0f} to {times[-1]:.0f} s since 1970, and not the footage{first}",
            path=path,
            mend="give the track of that day, or --speed or --known-length",
        )
    north, east = (np.interp([t for _, t in inside], times, places[:, k]) for k in (0, 1))
    found = [(f, float(a), float(b)) for (f, _), a, b in zip(inside, north, east, strict=True)]
    units = _by_places(model, found, up)
    if units is None:
        raise DriveError(
            f"covers less than {LEAST_WAY_M:g} m of the footage's way", path=path, mend="give --speed or --known-length"
        )
    return units


def _by_places(model: Model, noted: list[tuple[FootageFrame, float, float]], up: Float64) -> float | None:
    """Units of the model in a metre by where a receiver was; None where that are too few places, or too near each other."""
    number = {n: i for i, n in enumerate(model.names)}
    noted = [n for n in noted if n[0].file in number]
    if len({n[1:] for n in noted}) < FEWEST_PLACES:
        return None
    metres = level_metres([n[1:] for n in noted])
    if np.linalg.norm(metres[:, None] - metres[None, :: max(1, len(metres) // 50)], axis=2).max() < LEAST_WAY_M:
        return None
    centres = model.centres[[number[n[0].file] for n in noted]] @ upright(up)
    level = centres[:, :2] - centres[:, :2].mean(axis=0)
    # As complex numbers: the similarity in the plane that brings the cameras to the places.
    here, there = level[:, 0] + 1j * level[:, 1], metres[:, 0] + 1j * metres[:, 1]
    factor = np.vdot(here, there) / np.vdot(here, here).real
    return float(1 / abs(factor)) if abs(factor) > 0 else None

"""Poses refined against the photographs, where these disagree with the given ones.

Inertial poses are off by a pixel or, where a dataset keeps no heights, by several; a scene that is trained with them is blurred by
as much. The photographs of each camera and its neighbours are matched, and all of the vehicle moves so that the matches meet (see
``geometry.adjustment``): cameras of a rig and LiDAR sweeps with it. Tracks that took no part decide whether that is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept, facts_array, facts_of
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Drive, Frame, Sweep, SweepPoints, instants, tracks
from unveil_core.drives.importing.frames import working_camera
from unveil_core.geometry.adjustment.bundle import Motions, adjusted, reprojection_errors, triangulated
from unveil_core.geometry.adjustment.features import Features, find_features, matched
from unveil_core.geometry.adjustment.tracks import Tracks, joined_tracks
from unveil_core.geometry.camera import Camera

__all__ = ["Refinement", "found_refinement", "kept_refinement", "refined", "refinement_by_pictures", "unrefined"]

APART = (1, 2, 4)
"""Which later photographs of its camera each one is compared with: the next ones share most, farther ones show more parallax."""
HELD = 5
"""Every so many-th track decides and takes no part."""
LEAST_PX, LEAST_GAIN = 0.25, 0.2
"""The given poses stay where they explain most tracks to so many pixels, or where refined ones explain not even that share more:
nothing is sharper for it, and cameras that an artist matched stay where they are."""
FEWEST_TRACKS = 50
MOVING_IDS = range(CITYSCAPES.index("person"), len(CITYSCAPES))
"""trainIds of what may move: riders and vehicles follow."""
SAME_MOMENT = 0.5
"""Share of the time between two photographs of a camera within which those of other cameras belong to one moment."""


@dataclass(frozen=True, eq=False)
class Refinement:
    """How the vehicle moves from the given poses to the refined ones.

    Attributes:
        motions: by moment; moment: (F,) that of each frame; times: (K,) of the moments, comparable with time stamps where
            ``timed``.
        timed: whether all frames have time stamps.
        facts: JSON-able: ``refined``, and where enough was matched ``given_px`` and ``refined_px``, the median error of the tracks
            that decide, ``tracks``, ``shift_m`` and ``turn_deg``, the largest.
    """

    motions: Motions
    moment: NDArray[np.int64]
    times: Float64
    timed: bool
    facts: dict[str, Any]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All but the facts."""
        m = self.motions
        return {
            "rotations": m.rotations,
            "shifts": m.shifts,
            "pivots": m.pivots,
            "moment": self.moment,
            "times": self.times,
        }


def _moments(drive: Drive) -> tuple[NDArray[np.int64], Float64]:
    """(F,) the moment of each frame, numbered in order of time, and (K,) their times: cameras of a rig take turns within one."""
    at = instants(drive.frames)
    steps = np.concatenate([np.diff(np.sort(at[track])) for track in tracks(drive)])
    steps = steps[steps > 0]
    order = np.argsort(at, kind="stable")
    apart = SAME_MOMENT * float(np.median(steps)) if len(steps) else 0.0
    moment, number, begun = np.zeros(len(at), dtype=np.int64), -1, -np.inf
    shown: set[str] = set()
    for i in order:
        camera = drive.frames[i].camera_name
        if camera in shown or at[i] - begun > apart or number < 0:
            number, begun, shown = number + 1, at[i], set()
        moment[i] = number
        shown.add(camera)
    times = np.bincount(moment, at - at.min()) / np.bincount(moment) + at.min()
    return moment, np.asarray(times)


def unrefined(drive: Drive) -> Refinement:
    """That the given poses stay."""
    moment, times = _moments(drive)
    pivots = _pivots(drive, moment)
    return Refinement(Motions.none(pivots), moment, times, False, {"refined": False})


def _pivots(drive: Drive, moment: NDArray[np.int64]) -> Float64:
    centres = np.stack([f.camera.centre for f in drive.frames])
    count = np.bincount(moment)
    return np.stack([np.bincount(moment, centres[:, k]) / count for k in range(3)], axis=1)


def found_refinement(
    drive: Drive,
    cameras: Sequence[Camera],
    picture: Callable[[int], tuple[NDArray[np.uint8], NDArray[np.bool_] | None]],
    progress: Progress = no_progress,
) -> Refinement:
    """How the vehicle has to move for the photographs to agree; the given poses where they agree already.

    Args:
        drive: localized.
        cameras: of its frames, of the pictures' size.
        picture: grey (H, W) photograph of a frame by its number, and the pixels (H, W) that show what stands, None = unknown.
    """
    stays = unrefined(drive)
    features: dict[int, Features] = {}
    pairs: list[tuple[int, int, NDArray[np.int64]]] = []
    done = 0
    for track in tracks(drive):
        for place, i in enumerate(track):
            features[i] = found = find_features(*picture(i))
            for step in APART:
                if place >= step:
                    j = track[place - step]
                    pairs.append((j, i, matched(features[j], found, cameras[j], cameras[i])))
            if place >= APART[-1]:  # of a long drive not all descriptors are held
                old = track[place - APART[-1]]
                features[old] = Features(features[old].pixels, np.zeros((0, 128), np.float32))
            done += 1
            progress(done, len(cameras), "comparing photographs")
    found_tracks = joined_tracks([features[i] for i in range(len(cameras))], pairs)
    held = np.arange(found_tracks.count) % HELD == 0
    fitted, deciding = found_tracks.of_points(~held), found_tracks.of_points(held)
    if deciding.count < FEWEST_TRACKS:
        return replace(stays, facts={"refined": False, "tracks": found_tracks.count})
    given = _error(cameras, deciding)
    facts = {"refined": False, "tracks": found_tracks.count, "given_px": round(given, 3)}
    if given < LEAST_PX:
        return replace(stays, facts=facts)
    motions, _ = adjusted(cameras, stays.moment, stays.motions.pivots, fitted)
    after = _error([motions.of_camera(c, k) for c, k in zip(cameras, stays.moment, strict=True)], deciding)
    facts |= {"refined_px": round(after, 3)}
    if after > (1 - LEAST_GAIN) * given:
        return replace(stays, facts=facts)
    facts |= {
        "refined": True,
        "shift_m": round(float(np.linalg.norm(motions.shifts, axis=1).max()), 3),
        "turn_deg": round(float(np.degrees(motions.turned_rad).max()), 3),
    }
    timed = all(f.timestamp is not None for f in drive.frames)
    return Refinement(motions, stays.moment, stays.times, timed, facts)


def _error(cameras: Sequence[Camera], deciding: Tracks) -> float:
    """Median distance of the observations from the best places, pixels."""
    return float(np.median(reprojection_errors(cameras, deciding, triangulated(cameras, deciding))))


def refined(drive: Drive, by: Refinement) -> Drive:
    """A localized drive with its cameras, boxes and sweeps moved; its points, which no vehicle measured at a known time, stay."""
    if not by.facts["refined"]:
        return drive

    def moved(frame: Frame, k: int) -> Frame:
        footage = frame.footage and replace(frame.footage, camera=by.motions.of_camera(frame.footage.camera, k))
        camera = by.motions.of_camera(frame.camera, k)
        boxes = tuple(_moved_box(b, lambda p: by.motions.of_points(p, k)) for b in frame.boxes)
        return replace(frame, camera=camera, boxes=boxes, footage=footage)

    frames = tuple(moved(f, int(k)) for f, k in zip(drive.frames, by.moment, strict=True))
    return replace(drive, frames=frames, sweeps=tuple(_moved_sweep(s, by) for s in drive.sweeps))


def _moved_box(box: TrackedBox, motion: Callable[[Float64], Float64]) -> TrackedBox:
    """A box moved with the vehicle that measured it; it stays upright."""
    along = np.array([np.cos(box.yaw), np.sin(box.yaw), 0.0])
    centre, ahead = motion(np.asarray(box.centre) + np.stack([np.zeros(3), along]))
    x, y, z = (float(v) for v in centre)
    turn = float(np.arctan2(*(ahead - centre)[1::-1])) - box.yaw
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    return replace(box, centre=(x, y, z), yaw=box.yaw + turn)


def _moved_sweep(sweep: Sweep, by: Refinement) -> Sweep:
    """A sweep moved as the vehicle was at its time, between two moments by shares; without a time it stays."""
    if sweep.timestamp is None or not by.timed:
        return sweep
    place = float(np.interp(sweep.timestamp, by.times, np.arange(len(by.times))))
    first = min(int(place), len(by.times) - 1)
    last, share = min(first + 1, len(by.times) - 1), place - first

    def motion(points: Float64) -> Float64:
        return (1 - share) * by.motions.of_points(points, first) + share * by.motions.of_points(points, last)

    def read() -> SweepPoints:
        found = sweep.read()
        return replace(found, positions=motion(found.positions))

    return replace(sweep, read=read, boxes=tuple(_moved_box(b, motion) for b in sweep.boxes))


def kept_refinement(kept: Kept, make: Callable[[], Refinement]) -> Refinement:
    """A refinement, made once."""

    def made() -> dict[str, NDArray[Any]]:
        by = make()
        return {**by.arrays(), "facts": facts_array({**by.facts, "timed": by.timed})}

    found = dict(kept.once("poses", made))
    facts = facts_of(found.pop("facts"))
    moment, times = found.pop("moment"), found.pop("times")
    return Refinement(Motions(**found), moment, times, facts.pop("timed"), facts)


def refinement_by_pictures(
    drive: Drive, folder: Path, entries: Sequence[dict[str, Any]], work_side: int | None, progress: Progress
) -> Refinement:
    """The refinement of a localized drive by the photographs that were written into ``folder``, as ``entries`` of cameras.json name
    them."""
    cameras = [working_camera(f.camera, work_side) for f in drive.frames]

    def picture(i: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
        gray = cv2.cvtColor(read_image(folder / entries[i]["image"]), cv2.COLOR_RGB2GRAY)
        if "semantics" not in entries[i]:
            return gray, None
        return gray, ~np.isin(read_label_image(folder / entries[i]["semantics"]), MOVING_IDS)

    return found_refinement(drive, cameras, picture, progress)

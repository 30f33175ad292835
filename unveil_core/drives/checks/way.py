"""Whether cameras can have gone where their poses say: heights, steps, and what neighbours see in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.drives.checks.findings import Finding
from unveil_core.drives.checks.matches import STILL
from unveil_core.drives.checks.points_seen import points_in_view
from unveil_core.drives.drive import Drive, Frame, PointCloud, tracks
from unveil_core.drives.scale_and_up import Placement, camera_height
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import every_nth

__all__ = ["height_above_ground", "way_findings"]

HEIGHTS_M = (0.3, 4.5)
"""Of cameras above the ground: from robots to the roofs of double-deckers. Drones and masts are higher."""
UNITS = {"centimetres": 100.0, "millimetres": 1000.0, "feet": 3.2808, "inches": 39.37, "kilometres": 0.001}
"""Units that coordinates may be in, in a metre."""
USUAL_M = (1.0, 2.6)
"""Heights of cameras on vehicles and in hands, by which such a unit is guessed."""
DEPTHS = (0.5, 1.0, 2.0, 4.0)
"""Times the median depth of what is seen, at which neighbours are asked for what they see in common."""
FAR_STEP = 50.0
"""A frame that lies so many median steps from both of its neighbours is misplaced."""
MOST_POINTS = 3000
UNSEEN_M = 10.0
"""Usual depth where cameras see no points, metres."""


def way_findings(drive: Drive, points: Float64, placement: Placement) -> list[Finding]:
    """What looks wrong with the cameras' way.

    Args:
        points: (P, 3) some of the drive's.
        placement: its scale and up.
    """
    return [*_steps(drive), *_heights(drive, points, placement), *_nothing_in_common(drive, points)]


def height_above_ground(drive: Drive, points: Float64, placement: Placement) -> float | None:
    """Of the cameras, metres by the drive's scale; None where no ground is found below them."""
    found = camera_height(replace(drive, points=PointCloud(points)), placement.to_world.up) if len(points) else None
    return None if found is None else found / placement.to_world.scale


def _heights(drive: Drive, points: Float64, placement: Placement) -> list[Finding]:
    if not placement.scale_is_known:
        return []  # it was made of the height
    height = height_above_ground(drive, points, placement)
    if height is None or HEIGHTS_M[0] <= height <= HEIGHTS_M[1]:
        return []
    scale = placement.to_world.scale
    fitting = [n for n, per_metre in UNITS.items() if USUAL_M[0] <= height / per_metre <= USUAL_M[1]]
    mend = "a drone, or other units than metres: --scale UNITS_PER_METRE decides"
    if fitting:
        mend = f"coordinates are {fitting[0]}? --scale {scale * UNITS[fitting[0]]:g} says so"
    return [Finding(f"cameras are {height:.3g} m above the ground", mend)]


def _steps(drive: Drive) -> list[Finding]:
    found = []
    for track in tracks(drive):
        frames = [drive.frames[i] for i in track]
        centres = np.stack([f.camera.centre for f in frames])
        if len(frames) > 1 and not (np.ptp(centres, axis=0) > STILL * np.abs(centres).max(initial=1.0)).any():
            name = frames[0].camera_name
            found.append(
                Finding(
                    f"all {len(frames)} frames of camera {name} are at one place",
                    "add their poses, which may be missing",
                )
            )
        steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
        usual = float(np.median(steps[steps > 0])) if (steps > 0).sum() > 2 else 0.0
        if usual > 0:
            before, after = np.append(np.inf, steps), np.append(steps, np.inf)
            far = np.flatnonzero(np.minimum(before, after) > FAR_STEP * usual)
            if len(far):
                away = float(min(before[far[0]], after[far[0]]))
                first = f"frame {frames[far[0]].name} lies {away:.3g} units from its neighbours, which are {usual:.3g} apart"
                found.append(Finding(first, f"leave it out by --frames, or correct its pose ({len(far)} such)"))
    return found


def _nothing_in_common(drive: Drive, points: Float64) -> list[Finding]:
    apart: list[tuple[Frame, Frame]] = []
    count = 0
    some = every_nth(points, MOST_POINTS)
    for track in tracks(drive):
        frames = [drive.frames[i] for i in track]
        depth = _usual_depth(some, [f.camera for f in frames], UNSEEN_M * (drive.units_per_metre or 1.0))
        for one, two in zip(frames[:-1], frames[1:], strict=True):
            count += 1
            if not (_sees_of(two.camera, one.camera, depth) or _sees_of(one.camera, two.camera, depth)):
                apart.append((one, two))
    if not apart:
        return []
    one, two = apart[0]
    which = f"{one.name} and {two.name}" if len(apart) == 1 else f"the first {one.name} and {two.name}"
    return [
        Finding(
            f"{len(apart)} of {count} pairs of neighbouring frames see nothing in common, {which}",
            "the order of the frames or a pose is wrong, or the drive is cut there: --frames takes a part",
        )
    ]


def _usual_depth(points: Float64, cameras: Sequence[Camera], otherwise: float) -> float:
    """Median depth of the points that some of the cameras see; ``otherwise`` where they see none."""
    depths = [points_in_view(points, c)[1] for c in cameras[:: max(1, len(cameras) // 8)]] if len(points) else []
    seen = np.concatenate(depths) if depths else np.zeros(0)
    return float(np.median(seen)) if len(seen) else otherwise


def _sees_of(camera: Camera, other: Camera, depth: float) -> bool:
    """Whether a camera sees something of what another one does, at usual depths."""
    across = (np.arange(3) + 0.5) / 3
    x, y = np.meshgrid(across * other.width, across * other.height)
    rays = np.stack([(x - other.cx) / other.fx, (y - other.cy) / other.fy, np.ones_like(x)], axis=-1).reshape(-1, 3)
    local = np.concatenate([rays * depth * times for times in DEPTHS])
    pose = other.camera_to_world
    pixels, far = camera.project(local @ pose[:3, :3].T + pose[:3, 3])
    return bool(camera.in_picture(pixels, far).any())

"""How a drive's own coordinates lie to those that everything inside uses: how long a metre is in them, and which way is up.

What the user gives decides, the scale or the height of the cameras, then what the files tell. Where neither knows, cameras and
points do:

* Up. Cameras drive along level ground more or less, and their x axes stay level when they are pitched: both together give a first
  direction. Around it a plane is looked for that most points below the cameras lie in, each relative to its nearest camera, so that
  hills and curves do not matter. Frames mostly have an axis up, so one that is near is taken.
* Scale. The distance to that plane, or the drop that most points agree on where up is known, is the height of the cameras, and
  cameras on streets are about as high as people and cars.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.checks.points_seen import some_points
from unveil_core.drives.drive import Drive, PointCloud, tracks
from unveil_core.geometry.axes import UP, upright
from unveil_core.geometry.cloud import every_nth
from unveil_core.geometry.similarity import Similarity

__all__ = [
    "CAMERA_HEIGHT_M",
    "ESTIMATED_SCALES",
    "ESTIMATED_UPS",
    "UP_AXES",
    "Placement",
    "camera_height",
    "estimate_up",
    "measured_up",
    "place_drive",
]

CAMERA_HEIGHT_M = 1.6
"""Assumed height of a camera above the street, metres, where the drive's scale is unknown. Hand-held 1.5 to 1.7, behind a
windscreen 1.2 to 1.4, on the roof of a car 1.6 to 2.1."""
UP_AXES = {
    sign + name: (1.0 if not sign else -1.0) * np.eye(3)[k] for sign in ("", "-") for k, name in enumerate("xyz")
}
"""Directions that can be given for up, by name."""
BELIEVED_HEIGHTS_M = (0.3, 30.0)
"""What only hints at the scale is believed if the cameras are then so high above the ground: robots to drones, metres. The unit of
COLMAP, a step between photographs mostly, falls below it on streets."""
NEAR_AXIS_DEG, SFM_NEAR_AXIS_DEG = 15.0, 6.0
"""An axis that is so near to the estimated up is taken for it. Frames that know metres know gravity, too, and what lies off is the
street's slope (15 degrees are 27 %). Frames of structure from motion often lie as the first camera did: there a larger angle is
their own, and the ground knows better."""
AWAY_FROM_Z_DEG = 30.0
"""Frames that know metres have z up unless the estimate is farther from it: cameras that are pitched, or climb, mislead it."""
BELOW_DEG, STEEP_DEG = 8.0, 12.0
"""Points so far below the horizon of their nearest camera may be ground: loosely while up is looked for, then strictly."""
PLANE_SHARE, PLANE_POINTS, ALIKE = 0.2, 50, 0.06
"""The ground is found where so large a share of those points, and so many, lie in one plane, up to a share of its distance."""
TILT_DEG = 30.0
"""Farthest that the ground may be tilted against what the cameras take for level."""
MOST_POINTS, MOST_SCORED, TRIES = 100_000, 4_000, 400
"""Points that are looked at, those of them that a plane is scored by, and planes tried."""


GIVEN_HEIGHT = "given height"
"""Source of a scale that follows from the cameras' height, which the user gives."""
ESTIMATED_SCALES = ("camera height", "nothing")
"""Sources of a scale that is a guess."""
ESTIMATED_UPS = ("ground", "cameras")


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a drive's local frame lies in its own coordinates, and how that is known.

    Attributes:
        to_world: scale and rotation from local to the drive's own coordinates; no translation.
        scale_source: "given", "given height", "metric", "depth unit", "measured points", "applied_scale", or, estimated,
            "camera height" and "nothing".
        up_source: "given", "drive", or, estimated, "ground" and "cameras".
        height: of the cameras above the ground, in units of the drive, where it was needed; None = not looked for or not found.
        before: the scale was estimated when the drive, now of metres, was imported into another workspace.
        height_m: of the cameras above the ground, as given.
    """

    to_world: Similarity
    scale_source: str
    up_source: str
    height: float | None = None
    before: bool = False
    height_m: float | None = None

    @property
    def scale_is_known(self) -> bool:
        """False where the scale was estimated."""
        return self.before or self.scale_source not in ESTIMATED_SCALES

    @property
    def up_is_known(self) -> bool:
        """False where up was estimated."""
        return self.up_source not in ESTIMATED_UPS

    @property
    def up_name(self) -> str:
        """The axis that is up, or the direction in numbers."""
        for name, axis in UP_AXES.items():
            if np.allclose(self.to_world.up, axis, atol=1e-9):
                return name
        return "(" + ", ".join(f"{v:.3f}" for v in self.to_world.up) + ")"

    @property
    def surprising(self) -> bool:
        """Whether a user should look at :meth:`message`: something was estimated that could as well be otherwise."""
        return not self.scale_is_known or (not self.up_is_known and self.up_name != "z")

    def message(self) -> str:
        """What is taken for scale and up, and why, in one line."""
        scale = self.to_world.scale
        scales = {
            "given": f"1 m is {scale:g} units, as given",
            GIVEN_HEIGHT: (
                f"1 m is {scale:.4g} units, since the cameras are {self.height or 0:.4g} units above the ground, "
                f"and {self.height_m} m as given"
            ),
            "metric": "coordinates are metres, as the drive says",
            "depth unit": "coordinates are metres, as the unit of the depth images says",
            "measured points": "coordinates are metres, as a laser scanner measured the points",
            "applied_scale": f"1 m is {scale:g} units, as applied_scale says",
            "camera height": (
                f"SCALE UNKNOWN: 1 m is taken as {scale:.4g} units, since the cameras are {self.height or 0:.4g} units above the "
                f"ground and are assumed to be {CAMERA_HEIGHT_M} m; --scale UNITS_PER_METRE decides"
            ),
            "nothing": (
                "SCALE UNKNOWN: units are taken as metres, since no ground was found below the cameras; "
                "--scale UNITS_PER_METRE decides"
            ),
        }
        ups = {
            "given": f"up is {self.up_name}, as given",
            "drive": f"up is {self.up_name}, as the drive says",
            "ground": f"up is taken as {self.up_name}, by cameras and ground; --up decides",
            "cameras": f"up is taken as {self.up_name}, by the cameras; --up decides",
        }
        known = (
            "coordinates are metres, as an import before has estimated" if self.before else scales[self.scale_source]
        )
        return f"{known}; {ups[self.up_source]}"

    def to_json(self) -> dict[str, object]:
        """What is recorded of it."""
        return {
            "units_per_metre": self.to_world.scale,
            "scale_source": self.scale_source,
            "up": self.to_world.up.tolist(),
            "up_source": self.up_source,
        }


def place_drive(
    drive: Drive, *, scale: float | None = None, up: str | None = None, camera_height_m: float | None = None
) -> Placement:
    """Scale and up of a drive, given, read from the drive, or estimated.

    Args:
        drive: as read from disk.
        scale: units per metre that the user gives; up: a name in :data:`UP_AXES` likewise.
        camera_height_m: height of the cameras above the ground likewise, from which the scale follows; metres.
    Raises:
        DriveError: a pose that is none, a scale that is none, or no ground whose distance the height could be.
    """
    for frame in drive.frames:
        if not np.isfinite(frame.camera.world_to_camera).all():
            raise DriveError(
                f"the pose of frame {frame.name} holds NaN or infinity", path=drive.root, mend="redo its pose"
            )
    source = "given" if up is not None else "drive"
    axis = UP_AXES[up] if up is not None else drive.up
    if axis is None:
        axis, source = estimate_up(drive)
    height = None
    units, scale_source = (scale, "given") if scale is not None else (drive.units_per_metre, drive.scale_source)
    if scale is None and camera_height_m is not None:
        height = camera_height(drive if len(drive.points.positions) else _with_some_points(drive), axis)
        if height is None:
            problem = "shows no ground below its cameras, so their height in its units is unknown"
            raise DriveError(
                problem, path=drive.root, mend="give --scale UNITS_PER_METRE in the place of --camera-height"
            )
        units, scale_source = height / camera_height_m, GIVEN_HEIGHT
    elif units is None or scale_source in ("depth unit", "measured points", "applied_scale"):
        height = camera_height(drive, axis)
        low, high = BELIEVED_HEIGHTS_M
        if units is not None and height is not None and not low <= height / units <= high:
            units = None
    before = False
    if units is None:
        units, scale_source = (1.0, "nothing") if height is None else (height / CAMERA_HEIGHT_M, "camera height")
    else:
        before = scale is None and scale_source in ESTIMATED_SCALES
    try:
        return Placement(Similarity(units, upright(axis)), scale_source, source, height, before, camera_height_m)
    except ValueError as error:
        raise DriveError(f"has no frame: {error}", path=drive.root, mend="give --scale and --up") from error


def _with_some_points(drive: Drive) -> Drive:
    """A drive that has its points in sweeps, with some of them."""
    return replace(drive, points=PointCloud(some_points(drive)))


def camera_height(drive: Drive, up: Float64) -> float | None:
    """Height of the cameras over the ground, in units of the drive: the drop that most points well below their horizon agree on.

    Args:
        up: (3,) unit.
    Returns:
        None where next to nothing lies below the cameras.
    """
    offsets = _from_cameras(drive)
    for steepness in (STEEP_DEG, 0.0):
        drop = np.sort(-(offsets[_below(offsets, up, steepness)] @ up))
        if len(drop) < 20:
            continue
        first, last = np.searchsorted(drop, drop * (1 - ALIKE)), np.searchsorted(drop, drop * (1 + ALIKE), side="right")
        best = int(np.argmax(last - first))
        return float(np.median(drop[first[best] : last[best]]))
    return None


def measured_up(drive: Drive) -> tuple[Float64, str]:
    """(3,) unit, the direction that is up as cameras and ground show it, and what tells: "ground" or "cameras"."""
    cameras = _up_of_cameras(drive)
    found = _ground_plane(_from_cameras(drive), cameras)
    return (cameras, "cameras") if found is None else (found, "ground")


def estimate_up(drive: Drive) -> tuple[Float64, str]:
    """(3,) unit, the direction that is up, and what tells: "ground" or "cameras"; an axis of the drive where one is near."""
    up, source = measured_up(drive)
    axis = max(UP_AXES.values(), key=lambda a: float(a @ up))
    limit = NEAR_AXIS_DEG
    if drive.units_per_metre is None:
        limit = NEAR_AXIS_DEG if source == "cameras" else SFM_NEAR_AXIS_DEG
    elif up[2] > np.cos(np.radians(AWAY_FROM_Z_DEG)):
        return UP_AXES["z"], source
    return (axis if axis @ up > np.cos(np.radians(limit)) else up), source


def _up_of_cameras(drive: Drive) -> Float64:
    """(3,) unit, against the cameras' y axes, and perpendicular to what is level: to their x axes where these are spread enough to
    tell, else to them and to the way."""
    poses = np.stack([f.camera.world_to_camera for f in drive.frames])
    above, right = -poses[:, 1, :3], poses[:, 0, :3]
    length = float(np.linalg.norm(above.mean(axis=0)))
    mean: Float64 = above.mean(axis=0) / length if length > 1e-6 else UP
    if len(right) >= 3:
        _, values, turned = np.linalg.svd(right)
        # The direction in which the x axes have the least extent.
        if values[1] > 0.3 * values[0] and abs(turned[2] @ mean) > 0.8:
            return np.asarray(turned[2] * np.sign(turned[2] @ mean))
    centres = np.stack([f.camera.centre for f in drive.frames])
    total = np.zeros(3)
    for track in tracks(drive):
        for k in range(1, len(track) - 1):
            way = centres[track[k + 1]] - centres[track[k - 1]]
            across = np.cross(right[track[k]], way)
            if np.linalg.norm(across) > 0.5 * np.linalg.norm(way):  # a side camera's x axis is the way
                total += across * np.sign(across @ above[track[k]])
    length = float(np.linalg.norm(total))
    if length > 0 and total @ mean > 0.17 * length:
        return total / length
    return mean


def _from_cameras(drive: Drive) -> Float64:
    """(P, 3) from the nearest camera to points of the drive, not more than enough of them."""
    points = every_nth(drive.points.positions, MOST_POINTS)
    centres = np.stack([f.camera.centre for f in drive.frames])
    offsets: Float64 = points - centres[cKDTree(centres).query(points)[1]]
    return offsets


def _below(offsets: Float64, up: Float64, steepness_deg: float) -> np.ndarray:
    """(P,) bool, which lie so far below the horizontal."""
    drop = -(offsets @ up)
    level = np.linalg.norm(offsets + drop[:, None] * up, axis=1)
    return np.asarray((drop > 0) & (drop > np.tan(np.radians(steepness_deg)) * level))


def _ground_plane(offsets: Float64, up: Float64) -> Float64 | None:
    """(3,) unit normal of the plane below the cameras that most points agree on, by RANSAC and least squares.

    Args:
        offsets: (P, 3) of points from their nearest cameras; up: (3,) unit, roughly.
    """
    points = offsets[_below(offsets, up, BELOW_DEG)]
    if len(points) < PLANE_POINTS:
        return None
    corner = points[np.random.default_rng(0).integers(0, len(points), (TRIES, 3))]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1)
    good = length > 1e-9 * np.square(corner).sum(axis=2).max(axis=1)
    normal, corner = normal[good] / length[good, None], corner[good]
    normal *= np.sign(normal @ up)[:, None]
    height = -(normal * corner[:, 0]).sum(axis=1)
    good = (normal @ up > np.cos(np.radians(TILT_DEG))) & (height > 0)
    if not good.any():
        return None
    normal, height = normal[good], height[good]
    some = points[:: -(-len(points) // MOST_SCORED)]
    best = int(np.argmax((np.abs(-(some @ normal.T) / height - 1) < ALIKE).sum(axis=0)))
    found, high = normal[best], float(height[best])
    for _ in range(5):
        own = points[np.abs(-(points @ found) / high - 1) < ALIKE]
        if len(own) < PLANE_POINTS or len(own) < PLANE_SHARE * len(points):
            return None
        # All p with p . n = -h, as p . (n / h) = -1.
        slope = np.linalg.lstsq(own, -np.ones(len(own)), rcond=None)[0]
        high = 1.0 / float(np.linalg.norm(slope))
        found = slope * high
    return np.asarray(found) if found @ up > np.cos(np.radians(TILT_DEG)) else None

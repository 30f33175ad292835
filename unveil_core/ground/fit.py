"""The ground of a drive: fitted once, to the scene with everything in it, and read by everything that asks where the ground is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import every_nth
from unveil_core.ground.height_field import HeightField
from unveil_core.ground.path import StreetPath
from unveil_core.ground.plain_fit import NOISY_M, height_noise
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import WALL_FOOT_M, WALL_TOP_M, fit_street_heights
from unveil_core.ground.terrain import fit_terrain, ground_points
from unveil_core.semantics.classes import GROUND_CLASSES, REMOVABLE, SIDE_CLASSES, LabelSet
from unveil_core.surfels.surfels import Surfels

__all__ = [
    "DriveGround",
    "GroundEvidence",
    "MeasuredGround",
    "fit_drive_terrain",
    "measured_ground",
]

OPAQUE_LOGIT = -1.0
"""Surfels that stop less light than this (27 %) tell nothing of where a surface is."""
MOST_MEASURED = 200_000
"""Measured points of a drive that the ground is fitted to at most: a point for each cell of a street of a kilometre."""
FEWEST = 50
"""So many surfels make a street's ground."""
OF_MEASURED, MOST_REPEATED = 16, 2_000_000
"""So many surfels a measured point stands for where heights are told by medians. Surfels lie 1 to 4 cm too low, on sidewalks most,
for those in the depth of the ground show through those above. By them a third to a half of the ground behind removed objects was
more than 2 pixels off where it belongs, by points of a LiDAR a tenth to a fifth; with 4 it is little more, with 1 half as good.
On a long drive they stand for fewer, so that all together are no more than the second number: 50 MB."""
LEVEL = 0.8
"""Cosine of the slope up to which a surfel is level."""
UNDERFOOT_M, DROP_M, ABOUT_M, ASIDE_M = 3.0, (0.5, 3.0), 0.35, 8.0
"""Without classes the ground is what is level, no farther aside of the path than the first and lower than the cameras by the
second: the median of that drop is the camera's height, and what departs from it by no more than the third is ground, as far
aside as the fourth."""
STRAY_M, AROUND_WAY_M = 0.5, 3.0
"""With classes, what lies no farther aside of the path than underfoot, and no farther from the way along it than the second, is a
stray if its drop differs by more than the first from the median: before a side camera's lens a few surfels float, named for the
road behind them, and where nothing else was seen they would lift the street."""
STEEPEN, BANK = 0.25, 1.0
"""Beyond the way and beside it the ground may differ by more: by the first times the metres before its start or after its end, as
at the foot of a hill, where the way is taken to go on as steeply as it did; by the second times the metres farther aside than
underfoot, as a bank. What lies deeper was put behind the surface that frames show, where these are too few to tell depth."""
GRADE_M = 10.0
"""Length of the way from whose ends its grade is taken, metres."""


@dataclass(frozen=True, eq=False)
class DriveGround:
    """What lies under a drive.

    Attributes:
        path: the street's, the way of the cameras moved so that lines and kerbs keep their distance from it.
        street: the ground in street coordinates, None where too few surfels lie on any.
        terrain: the ground by the drive's points, on the street and around it, None where no labels or points tell.
    """

    path: StreetPath
    street: Ground | None
    terrain: HeightField | None


def measured_points(points: PointCloud, classes: Sequence[str]) -> Float64:
    """(Q, 3) of a drive's points those that its dataset itself labels as one of some classes; moving ones left out.

    A LiDAR looks where no camera does, as on the sidewalk behind parked cars: there no surfel lies.
    """
    if points.classes is None:
        return np.zeros((0, 3))
    keep = np.isin(points.classes, [CITYSCAPES.index(name) for name in classes])
    if points.moving is not None:
        keep &= ~points.moving
    return every_nth(points.positions[keep], MOST_MEASURED)


@dataclass(frozen=True, eq=False)
class MeasuredGround:
    """What a drive's points tell of the ground, whatever path it is fitted along.

    Attributes:
        points: of the drive.
        among: (Q, 3) of them those that lie among surfels of the ground; none in a scene without classes.
    """

    points: PointCloud
    among: Float64


def measured_ground(points: PointCloud, surfels: Surfels, labels: LabelSet) -> MeasuredGround:
    """What points tell of the ground, by the labels of the full scene."""
    on_ground = np.isin(surfels.labels.numpy(), labels.indices(GROUND_CLASSES))
    return MeasuredGround(points, ground_points(points.positions, surfels.means.double().numpy(), on_ground))


@dataclass(frozen=True, eq=False)
class _Places:
    """What tells where a street's ground lies: (P, 3) places on it, (W, 3) of what bounds it, (O, 3) of what stands on it and could
    be removed."""

    ground: Float64
    walls: Float64 | None
    standing: Float64 | None


@dataclass(frozen=True, eq=False)
class GroundEvidence:
    """What tells of a street's ground, whatever path it is fitted along: the surfels that lie on it by label, or, without classes,
    the level ones underfoot.

    Attributes:
        surfels: the full scene; labels: its labels, which leave out what could be removed, whatever is chosen.
        cameras: of the path's track.
        measured: what the drive's points tell: of these count those that its dataset labels, and those that lie among surfels
            of the ground; None = none.
    """

    surfels: Surfels
    labels: LabelSet
    cameras: Sequence[Camera]
    measured: MeasuredGround | None = None

    @property
    def _sure(self) -> Float64:
        return np.zeros((0, 3)) if self.measured is None else self.measured.among

    def fit(self, path: StreetPath) -> Ground | None:
        """The ground along a path, None where too few surfels lie on any."""
        found = self._places(path)
        if found is None:
            return None
        return fit_street_heights(path, found.ground, walls=found.walls, standing=found.standing, sure=self._sure)

    def noise(self, path: StreetPath) -> float:
        """Spread of the height of what :meth:`fit` is fitted to, metres: more than ``NOISY_M`` and the fit is a plain one."""
        found = self._places(path)
        return 0.0 if found is None else height_noise(path.to_street(found.ground))

    def _places(self, path: StreetPath) -> _Places | None:
        """See :meth:`fit`; None where too few surfels lie on any ground."""
        surfels, labels, measured = self.surfels, self.labels, self.measured
        means = surfels.means.double().numpy()
        of_surfel = surfels.labels.numpy()
        opaque = surfels.opacity_logits.numpy() > OPAQUE_LOGIT
        wanted, standing = labels.indices(GROUND_CLASSES), None
        if wanted:
            chosen = np.isin(of_surfel, wanted) & opaque
            if on("ground_strays"):
                chosen[chosen] = ~_strays(path, means[chosen], self.cameras)
        else:
            goes = np.isin(of_surfel, labels.indices((*REMOVABLE, "remove")))
            standing, stays = means[goes & opaque], opaque & ~goes
            level = stays & (np.abs(surfels.normals().double().numpy() @ path.axes[2]) > LEVEL)
            chosen = _underfoot(path, means, level, self.cameras)
        if chosen.sum() < FEWEST:
            return None
        sides = labels.indices(SIDE_CLASSES)
        walls = _facing(path, surfels, np.isin(of_surfel, sides) & opaque) if sides else None
        ground = means[chosen]
        if len(self._sure) and on("measured_ground") and height_noise(path.to_street(ground)) <= NOISY_M:
            some = every_nth(self._sure, MOST_MEASURED)
            times = int(np.clip(MOST_REPEATED // len(some), 1, OF_MEASURED))
            ground = np.concatenate([ground, np.repeat(some, times, axis=0)])
        if measured is not None and measured.points.classes is not None:
            ground = np.concatenate([ground, measured_points(measured.points, GROUND_CLASSES)])
            more = measured_points(measured.points, SIDE_CLASSES)
            walls = more if walls is None else np.concatenate([walls, more])
        return _Places(ground, walls, standing)

    def side_places(self, ground: Ground) -> Float64:
        """(W, 3) places of what bounds the ground, as far up as it tells where the ground ends."""
        chosen = np.isin(self.surfels.labels.numpy(), self.labels.indices(SIDE_CLASSES))
        chosen &= self.surfels.opacity_logits.numpy() > OPAQUE_LOGIT
        means = self.surfels.means.double().numpy()[chosen]
        over = ground.over(ground.path.to_street(means))
        return means[(over > WALL_FOOT_M) & (over < WALL_TOP_M)]


def _facing(path: StreetPath, surfels: Surfels, chosen: Mask) -> Float64:
    """(W, 3) places of the ``chosen`` surfels (N,) that face the street: a wall across it tells nothing
    of where its sides are."""
    means, normals = (part.double().numpy()[chosen] for part in (surfels.means, surfels.normals()))
    return means[path.faced_by(path.to_street(means)[:, 0], normals)]


def _underfoot(path: StreetPath, means: Float64, level: Mask, cameras: Sequence[Camera]) -> Mask:
    """Which of the ``level`` places (N, 3) are as far below the cameras as most of them are close to the path."""
    street, drop, _ = _below_way(path, means, cameras)
    near = level & (np.abs(street[:, 1]) < UNDERFOOT_M) & (drop > DROP_M[0]) & (drop < DROP_M[1])
    if near.sum() < FEWEST:
        return near
    return level & (np.abs(drop - np.median(drop[near])) < ABOUT_M) & (np.abs(street[:, 1]) < ASIDE_M)


def _strays(path: StreetPath, means: Float64, cameras: Sequence[Camera]) -> Mask:
    """Which places (N, 3) are not as far below the cameras as most of those under the way: there hardly, farther off by more."""
    street, drop, beyond = _below_way(path, means, cameras)
    aside = np.maximum(np.abs(street[:, 1]) - UNDERFOOT_M, 0)
    under = (beyond == 0) & (aside == 0)
    if under.sum() < FEWEST:
        return np.zeros(len(means), dtype=bool)
    return np.abs(drop - np.median(drop[under])) > STRAY_M + STEEPEN * beyond + BANK * aside


def _below_way(path: StreetPath, means: Float64, cameras: Sequence[Camera]) -> tuple[Float64, Float64, Float64]:
    """Street coordinates (N, 3) of places, how far they lie below the cameras beside them, or below the line on which these would
    drive on (N,), and how far they lie before the way or after it along the street (N,), metres."""
    street, track = path.to_street(means), path.to_street(np.stack([c.centre for c in cameras]))
    s, height = track[np.argsort(track[:, 0])][:, [0, 2]].T
    along = street[:, 0]
    level = np.interp(along, s, height)
    for end, sign in ((s[0], -1), (s[-1], 1)):
        near = np.abs(s - end) <= GRADE_M
        run = np.ptp(s[near])
        grade = (height[near][-1] - height[near][0]) / run if run > GRADE_M / 2 else 0.0
        level += grade * sign * np.maximum(sign * (along - end), 0)
    beyond = np.maximum(np.maximum(s[0] - AROUND_WAY_M - along, along - s[-1] - AROUND_WAY_M), 0)
    return street, level - street[:, 2], beyond


def fit_drive_terrain(measured: MeasuredGround, axes: Float64, street: Ground | None) -> HeightField | None:
    """The ground by a drive's points.

    Args:
        axes: (3, 3) rows east, north, up.
        street: carries kerbs through where no point lies.
    """
    points = np.concatenate([measured.among, measured_points(measured.points, GROUND_CLASSES)])

    def guess(places: Float64) -> Float64:
        assert street is not None
        at = street.path.to_street(places)
        return street.height_at(at[:, 0], at[:, 1])

    return fit_terrain(points, axes, guess=None if street is None else guess)

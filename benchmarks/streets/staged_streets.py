"""Drives staged on the sample's true empty street: objects with known outlines stand on it, so what they hide is known.

Everything that a drive brings follows from the exact depth of the empty street and the exact outlines of the objects: images,
semantics, instances, simulated LiDAR, and a truth. The objects cast no shadows.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.base.types import Float64, Picture
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.formats.transforms_json import read_transforms_json
from unveil_core.drives.points import write_points
from unveil_core.evaluate.flicker import STEPS_A_METRE
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar, cast_car, paint_car
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.classes import CITYSCAPES

__all__ = ["Box", "Car", "GlassFront", "Person", "Staged", "Street", "empty_street", "stage"]


SCENE = Path(__file__).resolve().parent.parent / "sample_scenes" / "parked_street"
GROUND = tuple(CITYSCAPES.index(n) for n in ("road", "sidewalk", "terrain"))
SKY, BUILDING = CITYSCAPES.index("sky"), CITYSCAPES.index("building")
POINTS_A_FRAME, LIDAR_M, NOISE_M = 6000, 60.0, 0.012
LIGHT = np.array([0.3, 0.5, 0.81])


class Shape(Protocol):
    """Something that rays meet."""

    def cast(self, origin: Float64, rays: Float64) -> tuple[Float64, Picture]:
        """Depth (M,) along the rays (M, 3), inf where they miss, and the colours (M, 3) there."""


@dataclass(frozen=True, eq=False)
class Box:
    """A painted box: ``floor`` (3,) the middle of its floor, ``axes`` (3, 3) rows forward, left, up, ``size`` in metres."""

    floor: Float64
    axes: Float64
    size: tuple[float, float, float]
    color: tuple[float, float, float] = (0.75, 0.72, 0.66)

    def cast(self, origin: Float64, rays: Float64) -> tuple[Float64, Picture]:
        """See :class:`Shape`."""
        half = np.array(self.size) / 2
        start = self.axes @ (origin - self.floor) - (0, 0, half[2])
        direction = rays @ self.axes.T
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = (-half - start) / direction, (half - start) / direction
        enters, leaves = np.minimum(low, high), np.maximum(low, high)
        depth = enters.max(axis=1)
        met = (depth > 0) & (depth <= leaves.min(axis=1))
        at = start + np.where(met, depth, 0.0)[:, None] * direction
        face = enters.argmax(axis=1)
        normal = np.zeros_like(direction)
        normal[np.arange(len(rays)), face] = -np.sign(direction[np.arange(len(rays)), face])
        # Panels and dirt, fixed to the box, so that there is something to be found by.
        panels = 1 - 0.25 * ((at % 0.9) < 0.04).any(axis=1)
        dirt = 1 + 0.1 * np.sin(8.3 * at[:, 0] + 3 * at[:, 2]) * np.sin(6.1 * at[:, 1] - 7.7 * at[:, 2])
        shade = 0.45 + 0.55 * np.clip(normal @ LIGHT, 0, 1)
        color = np.array(self.color) * (panels * dirt * shade)[:, None]
        return np.where(met, depth, np.inf), _bytes(color)


@dataclass(frozen=True, eq=False)
class Person:
    """Someone who stands: two ellipsoids on a floor (3,)."""

    floor: Float64

    def cast(self, origin: Float64, rays: Float64) -> tuple[Float64, Picture]:
        """See :class:`Shape`."""
        depth, color = np.full(len(rays), np.inf), np.zeros((len(rays), 3))
        for middle, radii in ((0.75, (0.27, 0.24, 0.75)), (1.62, (0.12, 0.12, 0.14))):
            start = (origin - self.floor - (0, 0, middle)) / radii
            direction = rays / radii
            a, b, c = (direction**2).sum(1), direction @ start, start @ start - 1
            root = b**2 - a * c
            near = np.where(root > 0, (-b - np.sqrt(np.abs(root))) / a, np.inf)
            closer = (near > 0) & (near < depth)
            at = start + near[closer, None] * direction[closer]
            height = at[:, 2] * radii[2] + middle
            cloth = np.where((height < 0.8)[:, None], (0.15, 0.17, 0.3), (0.7, 0.2, 0.15))
            cloth[height > 1.45] = (0.75, 0.55, 0.45)
            depth[closer], color[closer] = near[closer], cloth * (0.5 + 0.5 * np.clip(at @ LIGHT, 0, 1))[:, None]
        return depth, _bytes(color)


@dataclass(frozen=True, eq=False)
class Car:
    """One of the virtual cars."""

    body: VirtualCar

    def cast(self, origin: Float64, rays: Float64) -> tuple[Float64, Picture]:
        """See :class:`Shape`."""
        hits = cast_car(self.body, origin, rays)
        return hits.depth, paint_car(self.body, origin, rays, hits)


@dataclass(frozen=True, eq=False)
class GlassFront:
    """A shop front of glass: it mirrors sky and the other side of the street, so it looks different from everywhere.

    Attributes:
        corner: (3,) where it begins, on the ground; along, out: (3,) unit vectors, level; size: length and height, metres.
    """

    corner: Float64
    along: Float64
    out: Float64
    size: tuple[float, float]

    def cast(self, origin: Float64, rays: Float64) -> tuple[Float64, Picture]:
        """See :class:`Shape`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = ((self.corner - origin) @ self.out) / (rays @ self.out)
        depth = np.where(np.isfinite(depth), depth, -1.0)
        at = origin + depth[:, None] * rays - self.corner
        s, h = at @ self.along, at[:, 2]
        met = (depth > 0) & (s > 0) & (s < self.size[0]) & (h > 0) & (h < self.size[1])
        back = rays - 2 * (rays @ self.out)[:, None] * self.out
        # The other side of the street, 15 m away and 7 m high, with windows; the road before it; the sky above.
        across = np.maximum(back @ self.out, 1e-6)
        over_s, over_h = s + 15 * (back @ self.along) / across, h + 15 * back[:, 2] / across
        color = np.where((over_h < 0)[:, None], (0.42, 0.42, 0.43), (0.78, 0.7, 0.55))
        color[(over_s % 3 < 1.3) & (over_h % 3 > 1) & (over_h % 3 < 2.4) & (over_h > 0)] = (0.2, 0.22, 0.26)
        color[over_h > 7] = (0.6, 0.75, 0.92)
        color = 0.7 * color + 0.3 * np.array([0.08, 0.1, 0.11])
        frame = (s % 1.4 < 0.07) | (h % 1.6 < 0.07)
        color[frame] = (0.25, 0.25, 0.26)
        return np.where(met, depth, np.inf), _bytes(color)


@dataclass(frozen=True, eq=False)
class Staged:
    """An object on the street: what it is, whether it goes, and in which of the drive's frames it is there (None: all)."""

    shape: Shape
    kind: str
    instance: int
    goes: bool = True
    frames: frozenset[int] | None = None


@dataclass(frozen=True, eq=False)
class _View:
    """A frame of the empty street: image (H, W, 3), trainIds (H, W), depth (H, W) with inf for the sky."""

    camera: Camera
    image: Picture
    labels: Picture
    depth: Float64


@dataclass(eq=False)
class Street:
    """The sample's empty street: its views, and where its ground lies."""

    views: list[_View]
    ground: Float64
    _tree: cKDTree = field(init=False)

    def __post_init__(self) -> None:
        self._tree = cKDTree(self.ground[:, :2])

    def place(self, frame: int, ahead: float, left: float) -> tuple[Float64, Float64]:
        """Point on the ground (3,) so many metres ahead and to the left of a frame's camera, and axes (3, 3) along its view."""
        pose = self.views[frame].camera.world_to_camera
        forward = pose[2, :3] * (1, 1, 0)
        forward /= np.linalg.norm(forward)
        sideways = np.cross((0, 0, 1), forward)
        point = self.views[frame].camera.centre + ahead * forward + left * sideways
        near = self._tree.query(point[:2], k=30)[1]
        point[2] = np.median(self.ground[near, 2])
        return point, np.stack([forward, sideways, (0.0, 0.0, 1.0)])


@cache
def empty_street() -> Street:
    """The true empty street of the sample, with the labels that the crowded frames have where no object stands."""
    drive = read_transforms_json(SCENE)
    truth = SCENE / "truth"
    read, places, known = [], [], []
    for frame in drive.frames:
        depth = read_instance_image(truth / "depth" / f"{frame.name}.png") / STEPS_A_METRE
        depth = np.where(depth > 0, depth, np.inf)
        labels = read_label_image(frame.semantic_path)  # type: ignore[arg-type]
        removed = read_label_image(truth / "removed" / f"{frame.name}.png") > 127
        at = frame.camera.centre + np.where(np.isfinite(depth), depth, 0)[..., None] * frame.camera.rays()[1::2, 1::2]
        fair = np.isfinite(depth) & ~removed[1::2, 1::2] & (labels[1::2, 1::2] != SKY)
        places.append(at[fair])
        known.append(labels[1::2, 1::2][fair])
        read.append((frame, depth, labels, removed, at))
    cloud, classes = np.concatenate(places), np.concatenate(known)
    tree = cKDTree(cloud)
    views = []
    for frame, depth, labels, removed, at in read:
        small = np.full(depth.shape, SKY, dtype=np.uint8)
        solid = np.isfinite(depth)
        small[solid] = classes[tree.query(at[solid])[1]]
        whole = np.where(removed, small.repeat(2, 0).repeat(2, 1), labels).astype(np.uint8)
        image = read_image(truth / "images" / f"{frame.name}.jpg")
        views.append(_View(frame.camera, image, whole, depth.repeat(2, 0).repeat(2, 1)))
    return Street(views, cloud[np.isin(classes, GROUND)])


def stage(folder: Path, frames: Sequence[int], objects: Sequence[Staged], glass: GlassFront | None = None) -> None:
    """Write a drive with its truth.

    Args:
        folder: of the drive, with ``transforms.json``, and ``truth/`` with ``images/``, ``removed/`` (255 where something that
            goes is in front), and, for what stays, ``kept/`` (255 where something that stays is nearest of all but what goes).
        frames: numbers of the sample's frames; objects: what stands there; glass: a front of glass that stays.
    """
    street, rng = empty_street(), np.random.default_rng(0)
    top = json.loads((SCENE / "transforms.json").read_text())
    entries, positions, colors = [], [], []
    for number in frames:
        view, entry = street.views[number], top["frames"][number]
        origin, rays = view.camera.centre, view.camera.rays().reshape(-1, 3)
        layers = {name: a.reshape(len(rays), -1).copy() for name, a in (("image", view.image), ("labels", view.labels))}
        depth, instances = view.depth.ravel().copy(), np.zeros((len(rays), 1), dtype=np.uint16)
        kept, removed = np.zeros((2, len(rays)), dtype=bool)
        mirrors = np.zeros(len(rays), dtype=bool)
        if glass is not None:
            away, paint = glass.cast(origin, rays)
            shown = (away < depth + 0.5) & np.isin(layers["labels"][:, 0], (BUILDING,))
            depth[shown], layers["image"][shown], kept[shown], mirrors = away[shown], paint[shown], True, shown
        there = [o for o in objects if o.frames is None or number in o.frames]
        for thing in sorted(there, key=lambda o: o.goes):
            if thing.goes and not removed.any():
                true = layers["image"].copy()
            away, paint = thing.shape.cast(origin, rays)
            shown = away < depth
            depth[shown], layers["image"][shown], mirrors = away[shown], paint[shown], mirrors & ~shown
            layers["labels"][shown], instances[shown] = CITYSCAPES.index(thing.kind), thing.instance
            removed[shown] = thing.goes
            kept[shown] |= not thing.goes
        if not any(o.goes for o in there):
            true = layers["image"]
        size = view.image.shape[:2]
        name = f"{number:04d}.png"
        for target, picture in (
            (f"images/{name}", layers["image"].reshape(*size, 3)), (f"semantics/{name}", layers["labels"].reshape(size)),
            (f"instances/{name}", instances.reshape(size)), (f"truth/images/{name}", true.reshape(*size, 3)),
            (f"truth/removed/{name}", _mask(removed, size)), (f"truth/kept/{name}", _mask(kept, size))
        ):
            write_image_atomic(folder / target, picture)
        files = {
            k: f"{d}/{name}"
            for k, d in (("file_path", "images"), ("semantic_path", "semantics"), ("instance_path", "instances"))
        }
        entries.append({**entry, **files})
        # Glass sends little back.
        measured = (depth < LIDAR_M) & ~(mirrors & (rng.random(len(rays)) < 0.8))
        met = rng.permutation(np.flatnonzero(measured))[:POINTS_A_FRAME]
        reach = depth[met] + rng.normal(0, NOISE_M, len(met))
        positions.append(origin + reach[:, None] * rays[met])
        colors.append(layers["image"][met])
    write_points(PointCloud(np.concatenate(positions), np.concatenate(colors)), folder / "points.ply")
    listed = [{"id": o.instance, "class": o.kind, "name": o.kind} for o in objects]
    write_json_atomic(folder / "transforms.json", {**top, "instances": listed, "frames": entries})


def _bytes(color: Float64) -> Picture:
    return np.clip(np.round(color * 255), 0, 255).astype(np.uint8)


def _mask(mask: NDArray[np.bool_], size: tuple[int, ...]) -> Picture:
    return np.where(mask, 255, 0).astype(np.uint8).reshape(size)

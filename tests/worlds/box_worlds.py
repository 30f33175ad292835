"""Worlds of boxes on flat ground, ray-cast with numpy: drives of any length and shape in seconds, with their truth."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points

ROAD, SIDEWALK, BUILDING, WALL, SKY, PERSON, CAR, TRUCK = 0, 1, 2, 3, 10, 11, 13, 14
SIZE = (96, 64)
FOCAL = 62.0
REACH_M = 80.0
"""How far boxes are drawn, metres; ground is drawn three quarters of the way. Enough for streets of a few frames, and fast."""
SAMPLES = ((0.5, 0.5), (0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75))
"""Places in a pixel: the first tells its class, the mean of the others its colour."""
NOTHING, GROUND = -2, -1


@dataclass(frozen=True)
class Box:
    """A box that stands upright.

    Attributes:
        centre: (3,) metres; size: (3,) length, width and height, metres; yaw: degrees to the left.
        kind: its Cityscapes trainId; color: RGB in [0, 1].
        windows: whether its sides have rows of them.
        removed: whether the empty world is without it.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    kind: int
    color: tuple[float, float, float]
    yaw: float = 0.0
    windows: bool = False
    removed: bool = False

    def local(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) along the axes of the box."""
        c, s = np.cos(np.radians(self.yaw)), np.sin(np.radians(self.yaw))
        return vectors @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])

    def shade(self, points: np.ndarray) -> np.ndarray:
        """Colours (N, 3) in [0, 1] of points (N, 3) on its surface."""
        p = self.local(points - np.array(self.centre)) + (0, 0, self.size[2] / 2)
        along = np.where(np.abs(np.abs(p[:, 0]) - self.size[0] / 2) < 1e-6, p[:, 1], p[:, 0])
        color = np.array(self.color) + 0.04 * (np.sin(2.5 * along) * np.cos(2.0 * p[:, 2]))[:, None]
        if self.windows:
            pane = (np.abs((along / 2.5) % 1 - 0.5) < 0.2) & (np.abs((p[:, 2] / 2.8) % 1 - 0.6) < 0.22)
            color[pane] = (0.2, 0.25, 0.3)
        return color


def street_ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N,) classes of a straight street along x: 9 m of road between sidewalks."""
    return np.where(np.abs(y) < 4.5, ROAD, SIDEWALK)


@dataclass(frozen=True)
class World:
    """Boxes on the plane z = 0.

    Attributes:
        ground: (N,) classes, ROAD or SIDEWALK, of places with coordinates x (N,) and y (N,).
        reach: how far boxes are drawn, metres.
    """

    boxes: Sequence[Box]
    ground: Callable[[np.ndarray, np.ndarray], np.ndarray] = street_ground
    reach: float = REACH_M

    def cast(self, origin: np.ndarray, rays: np.ndarray, crowded: bool) -> tuple[np.ndarray, np.ndarray]:
        """Distance along rays (N, 3), inf where nothing is hit, and (N,) the box that is hit, or GROUND or NOTHING."""
        with np.errstate(divide="ignore"):
            best = np.where(rays[:, 2] < 0, -origin[2] / rays[:, 2], np.inf)
        best[best * np.linalg.norm(rays, axis=1) > 0.75 * self.reach] = np.inf
        hit = np.where(np.isfinite(best), GROUND, NOTHING)
        there = [k for k, box in enumerate(self.boxes) if crowded or not box.removed]
        if there:
            centre, size = (np.array([getattr(self.boxes[k], n) for k in there]) for n in ("centre", "size"))
            angle = np.radians([self.boxes[k].yaw for k in there])
            turn = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            nearest = np.full(len(rays), -1)
            _meet(np.asarray(origin, float) - centre, rays, size / 2, turn, best, nearest)
            hit = np.where(nearest >= 0, np.array(there)[nearest], hit)
        return best, hit

    def around(self, place: np.ndarray) -> World:
        """The part of the world that is seen from a place (3,)."""
        gap = [np.linalg.norm(np.array(b.centre) - place) - np.linalg.norm(b.size) / 2 for b in self.boxes]
        return replace(self, boxes=[b for b, g in zip(self.boxes, gap, strict=True) if g < self.reach])

    def kinds(self, points: np.ndarray, hit: np.ndarray) -> np.ndarray:
        """(N,) Cityscapes trainIds of what is hit at points (N, 3)."""
        of_boxes = np.array([SKY, SKY, *(b.kind for b in self.boxes)])[hit + 2]
        return np.where(hit == GROUND, self.ground(points[:, 0], points[:, 1]), of_boxes)

    def colors(self, points: np.ndarray, hit: np.ndarray) -> np.ndarray:
        """(N, 3) colours in [0, 1] of what is hit at points (N, 3)."""
        color = np.tile(np.array([0.55, 0.7, 0.9]), (len(points), 1))
        x, y = points[:, 0], points[:, 1]
        kind = self.ground(x, y)
        slab = ((x / 0.8) % 1 < 0.12) | ((y / 0.8) % 1 < 0.12)
        stone = np.where(slab[:, None], (0.5, 0.46, 0.4), (0.66, 0.62, 0.55))
        tar = np.repeat((0.38 + 0.04 * np.sin(3 * x + 1.3 * y) * np.cos(2.1 * y))[:, None], 3, axis=1)
        color[hit == GROUND] = np.where((kind == SIDEWALK)[:, None], stone, tar)[hit == GROUND]
        for k, box in enumerate(self.boxes):
            color[hit == k] = box.shade(points[hit == k])
        return color


@njit(cache=True, nogil=True)
def _meet(origin, rays, half, turn, best, nearest):  # type: ignore[no-untyped-def]
    """Lower ``best`` (N,), distances along rays (N, 3), to the nearest box that a ray enters, and set ``nearest`` (N,) to it.

    Args:
        origin: (B, 3) of the rays as seen from each box; half: (B, 3) sizes; turn: (B, 2) cosine and sine of the yaws.
    """
    for n in range(rays.shape[0]):
        for k in range(half.shape[0]):
            c, s = turn[k, 0], turn[k, 1]
            enter, leave = 0.0, best[n]
            for axis in range(3):
                if axis == 0:
                    o, r = origin[k, 0] * c + origin[k, 1] * s, rays[n, 0] * c + rays[n, 1] * s
                elif axis == 1:
                    o, r = origin[k, 1] * c - origin[k, 0] * s, rays[n, 1] * c - rays[n, 0] * s
                else:
                    o, r = origin[k, 2], rays[n, 2]
                if r == 0.0:
                    if abs(o) > half[k, axis]:
                        enter = np.inf
                    continue
                a, b = (-half[k, axis] - o) / r, (half[k, axis] - o) / r
                enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
                if enter >= leave:
                    break
            if 0.0 < enter < leave:
                best[n] = enter
                nearest[n] = k


@dataclass(frozen=True)
class Lens:
    """A camera of a car.

    Attributes:
        name: of its track.
        yaw: degrees to the left of the way; aside: metres to the left of it.
        size: width and height of its pictures; focal: likewise in pixels.
    """

    name: str = "camera"
    yaw: float = 0.0
    aside: float = 0.0
    size: tuple[int, int] = SIZE
    focal: float = FOCAL

    def pose(self, place: Sequence[float], heading: float) -> np.ndarray:
        """(4, 4) OpenGL pose where the car is at a place (3,) and drives ``heading`` degrees to the left of x."""
        angle = np.radians(heading)
        left = np.array([-np.sin(angle), np.cos(angle), 0.0])
        angle += np.radians(self.yaw)
        forward = np.array([np.cos(angle), np.sin(angle), -0.1])
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(right, forward), -forward
        pose[:3, 3] = np.asarray(place) + self.aside * left
        return pose

    def picture(self, world: World, pose: np.ndarray, crowded: bool) -> tuple[np.ndarray, np.ndarray]:
        """Image (H, W, 3) uint8 BGR, antialiased, and classes (H, W) of an OpenGL pose."""
        width, height = self.size
        world = world.around(pose[:3, 3])
        total, classes = np.zeros((height, width, 3)), np.zeros((height, width), np.uint8)
        for k, (dx, dy) in enumerate(SAMPLES):
            u = (np.arange(width) + dx - width / 2) / self.focal
            v = -(np.arange(height) + dy - height / 2) / self.focal
            local = np.stack(np.broadcast_arrays(u[None], v[:, None], np.full((1, 1), -1.0)), axis=-1).reshape(-1, 3)
            rays = local @ pose[:3, :3].T
            t, hit = world.cast(pose[:3, 3], rays, crowded)
            points = pose[:3, 3] + np.where(np.isfinite(t), t, 0)[:, None] * rays
            if k == 0:
                classes = world.kinds(points, hit).reshape(height, width).astype(np.uint8)
            else:
                total += world.colors(points, hit).reshape(height, width, 3) / (len(SAMPLES) - 1)
        return (np.clip(total[..., ::-1], 0, 1) * 255).round().astype(np.uint8), classes


@dataclass(frozen=True)
class Way:
    """Where a car drives, and the cameras that it carries.

    Attributes:
        places: (3,) each; headings: degrees to the left of x, one per place.
        noise: (4,) each, by which the recorded poses are off, metres along x, y and z and degrees of heading; empty = by nothing.
    """

    places: Sequence[Sequence[float]]
    headings: Sequence[float]
    lenses: Sequence[Lens] = field(default_factory=lambda: [Lens()])
    noise: Sequence[Sequence[float]] = ()

    def recorded(self, lens: Lens, k: int) -> np.ndarray:
        """(4, 4) OpenGL pose that the drive records of a lens at the ``k``-th place."""
        if not len(self.noise):
            return lens.pose(self.places[k], self.headings[k])
        *aside, turned = self.noise[k]
        return lens.pose(np.asarray(self.places[k]) + aside, self.headings[k] + turned)


def straight(start: float, end: float, count: int, y: float = 0.0, lenses: Sequence[Lens] = (Lens(),)) -> Way:
    """A way along x, 1.6 m over the ground."""
    return Way([(x, y, 1.6) for x in np.linspace(start, end, count)], [0.0] * count, lenses)


def lidar(world: World, place: Sequence[float], rays: int, generator: np.random.Generator) -> np.ndarray:
    """(P, 3) points that a LiDAR 0.2 m over a place measures within 40 m."""
    origin = np.asarray(place) + (0, 0, 0.2)
    directions = generator.normal(size=(rays, 3)) * (1, 1, 0.35)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    t, _ = world.around(origin).cast(origin, directions, True)
    near = t < 40
    points: np.ndarray = origin + t[near, None] * directions[near]
    return points


FOLDERS = ("images", "semantics", "truth/images")


def _write_pictures(of: tuple[Path, World, Lens, np.ndarray, str]) -> None:
    """Image, labels and truth of one frame: folder, world, lens, OpenGL pose (4, 4), and the files' name."""
    folder, world, lens, pose, stem = of
    planes = (*lens.picture(world, pose, True), lens.picture(world, pose, False)[0])
    for name, plane in zip(FOLDERS, planes, strict=True):
        cv2.imwrite(str(folder / name / stem), plane)


def make_box_world(folder: Path, world: World, way: Way, *, rays: int = 2000, workers: int = 1) -> Path:
    """Write the drive, and the pictures of the empty world to ``truth/images``; returns the path of transforms.json.

    Args:
        rays: of the LiDAR at each place; workers: processes that cast the pictures.
    """
    generator = np.random.default_rng(0)
    frames, cloud, pictures = [], [], []
    for lens in way.lenses:
        for name in FOLDERS:
            (folder / name / lens.name).mkdir(parents=True)
        for i, (place, heading) in enumerate(zip(way.places, way.headings, strict=True)):
            pose, stem = lens.pose(place, heading), f"{lens.name}/{i:04d}.png"
            pictures.append((folder, world, lens, pose, stem))
            width, height = lens.size
            frames.append(
                {
                    "file_path": f"images/{stem}",
                    "semantic_path": f"semantics/{stem}",
                    "camera": lens.name,
                    "timestamp": 0.1 * i,
                    "transform_matrix": way.recorded(lens, i).tolist(),
                    "w": width,
                    "h": height,
                    "fl_x": lens.focal,
                    "fl_y": lens.focal,
                    "cx": width / 2,
                    "cy": height / 2,
                }
            )
    if workers > 1:
        with ProcessPoolExecutor(workers) as pool:
            list(pool.map(_write_pictures, pictures, chunksize=8))
    else:
        for one in pictures:
            _write_pictures(one)
    for place in way.places:
        cloud.append(lidar(world, place, rays, generator))
    write_points(PointCloud(np.concatenate(cloud)), folder / "points.ply")
    document = {"metric": True, "ply_file_path": "points.ply", "semantic_classes": "cityscapes", "frames": frames}
    path = folder / "transforms.json"
    path.write_text(json.dumps(document))
    return path

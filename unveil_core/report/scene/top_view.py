"""The street from above: what was removed, and where the empty street was continued or invented."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGIN_COUNT, RELIT
from unveil_core.raster.on_device import array, rendered
from unveil_core.report.scene.path import Way
from unveil_core.surfels.surfels import Surfels

__all__ = ["MARKED", "Map", "TopView", "map_of", "top_view"]

MARKED = (RELIT, CONTINUED, INVENTED)
"""Origins that the map shows, each in its colour."""
AROUND_M = 22.0
"""What lies farther from the drive's way is not on the map, metres: a street with its sidewalks and house fronts."""
AHEAD_M, BEHIND_M = 35.0, 4.0
"""The way is followed so far beyond the last camera, and the map begins so far before the first: a camera sees what is ahead."""
ABOVE_M = 1.2
"""What rises so far above the drive's camera is left away, or tree crowns and wires would hide the street."""
MOST_PIXELS, PIXELS_PER_M = 2_400_000, 16.0
"""Of the map: as many as it may have, and of a metre at most."""
LONGEST_PX = 8_000
"""Browsers show larger pictures, but scale them badly."""
TILE_PX = 512
"""The map is drawn in tiles: each is seen from straight above its middle."""
ALTITUDE_M = 400.0
"""Of a tile's camera: a wall of 3 m leans by a quarter of a metre at the border of a tile of 64 m."""
STANDARD_DEVIATIONS = 3.4
"""As far as a surfel reaches."""
NEEDLE_M, NEEDLE_RATIO = 1.0, 5.0
"""Standard deviation, metres, and how many times the other it is, from which on a surfel is a needle: 0.5 % of a fitted scene."""
LEAST_WEIGHT = 0.3
"""Of a pixel, from which on it counts as continued or invented."""
BACKGROUND = (43, 48, 56)
"""sRGB where the scene has nothing: that of the other pictures."""


@dataclass(frozen=True, eq=False)
class Map:
    """A level picture of the ground, turned so that the drive goes from left to right.

    Attributes:
        along: (2,) unit vector of the picture's x, in local east and north.
        corner: (2,) local place of the upper left corner.
        pixels_per_m: scale.
        size: width and height in pixels.
    """

    along: Float64
    corner: Float64
    pixels_per_m: float
    size: tuple[int, int]

    @property
    def axes(self) -> Float64:
        """(2, 2) the picture's x and y (down) in local east and north."""
        return _axes_of(self.along)

    def to_pixels(self, points: Float64) -> Float64:
        """(N, 2) pixels of local places (N, 2 or 3)."""
        return (points[:, :2] - self.corner) @ self.axes.T * self.pixels_per_m


@dataclass(frozen=True, eq=False)
class TopView:
    """The street from above.

    Attributes:
        map: where it lies.
        picture: (H, W, 3).
        origins: (H, W) uint8, one of :data:`MARKED` or 0; None where that is not known.
    """

    map: Map
    picture: Picture
    origins: NDArray[np.uint8] | None


def _axes_of(along: Float64) -> Float64:
    return np.stack([along, [along[1], -along[0]]])


def map_of(way: Way) -> Map:
    """The map of a way and of what lies around it."""
    along = _direction(way)
    axes = _axes_of(along)
    turned = _seen(way)[:, :2] @ axes.T
    low, high = turned.min(axis=0) - (BEHIND_M, AROUND_M), turned.max(axis=0) + (0, AROUND_M)
    sides = high - low
    scale = min(PIXELS_PER_M, float(np.sqrt(MOST_PIXELS / np.prod(sides))), LONGEST_PX / float(sides.max()))
    width, height = (max(1, round(float(v) * scale)) for v in sides)
    return Map(along, low @ axes, scale, (width, height))


def _seen(way: Way) -> Float64:
    """(S, 3) the way, and on from its end as far as its last camera sees."""
    on = way.eyes[-1] + np.arange(1.0, AHEAD_M)[:, None] * (way.views[-1] * (1, 1, 0))
    return np.concatenate([way.eyes, on])


def _direction(way: Way) -> Float64:
    """(2,) unit vector along the longest extent of a way, in the direction of travel."""
    flat = way.eyes[:, :2] - way.eyes[:, :2].mean(axis=0)
    travel = way.eyes[-1, :2] - way.eyes[0, :2]
    if way.length < 1.0:
        travel = way.views[0, :2]
        return travel / np.linalg.norm(travel) if np.linalg.norm(travel) > 1e-3 else np.array([1.0, 0.0])
    along: Float64 = np.linalg.svd(flat, full_matrices=False)[2][0]
    return -along if along @ travel < 0 else along


def top_view(surfels: Surfels, origins: NDArray[np.uint8] | None, way: Way) -> TopView:
    """Draw the map of a scene.

    Args:
        surfels: N of the empty scene.
        origins: (N,) where their colours come from, None where that is not known.
    """
    place = map_of(way)
    width, height = place.size
    seen = _seen(way)
    tree = cKDTree(seen[:, :2])
    low = _low_enough(surfels, seen, tree) & ~_needles(surfels)
    marked = replace(surfels, labels=torch.zeros(len(surfels), dtype=torch.int64))
    if origins is not None:
        marked = replace(surfels, labels=torch.from_numpy(origins.astype(np.int64)))
    at = place.to_pixels(surfels.means.numpy()).astype(np.float32)
    reach = np.exp(surfels.log_scales.amax(dim=1, keepdim=True).numpy()) * (STANDARD_DEVIATIONS * place.pixels_per_m)
    picture = np.empty((height, width, 3), np.uint8)
    picture[:] = BACKGROUND
    found = np.zeros((height, width), np.uint8)
    solid = np.zeros((height, width), np.bool_)
    for top in range(0, height, TILE_PX):
        for left in range(0, width, TILE_PX):
            size, corner = np.array([min(TILE_PX, width - left), min(TILE_PX, height - top)]), np.array([left, top])
            camera = _above(place, corner, size, seen, tree)
            inside = low & ((at > corner - reach) & (at < corner + size + reach)).all(axis=1)
            if camera is None or not inside.any():
                continue
            here = slice(top, top + size[1]), slice(left, left + size[0])
            some = marked.select(torch.from_numpy(np.flatnonzero(inside)))
            picture[here], found[here], solid[here] = _tile(some, camera)
    rows, columns = (_extent(solid.any(axis=k), place.pixels_per_m) for k in (1, 0))  # type: ignore[arg-type]
    origin = place.corner + np.array([columns.start, rows.start]) / place.pixels_per_m @ place.axes
    place = replace(place, corner=origin, size=(columns.stop - columns.start, rows.stop - rows.start))
    return TopView(place, picture[rows, columns], None if origins is None else found[rows, columns])


def _extent(some: Mask, pixels_per_m: float) -> slice:
    """From the first to the last of a line of pixels (P,) that has something, and a metre around; of an empty one all."""
    found = np.flatnonzero(some)
    if not len(found):
        return slice(0, len(some))
    return slice(max(0, int(found[0] - pixels_per_m)), min(len(some), int(found[-1] + pixels_per_m) + 1))


def _low_enough(surfels: Surfels, seen: Float64, tree: Any) -> Mask:
    """(N,) which surfels do not rise above the drive's camera, near what was seen (S, 3)."""
    means = surfels.means.numpy()
    far, nearest = tree.query(means[:, :2], distance_upper_bound=AROUND_M + 3)
    near = np.isfinite(far)
    heights = np.append(seen[:, 2], 0.0)[nearest]
    found: Mask = near & (means[:, 2] < heights + ABOVE_M)
    return found


def _needles(surfels: Surfels) -> Mask:
    """(N,) which surfels are long and thin: cameras look along them and see a dot, from above they would be a beam over the map."""
    scales = np.sort(surfels.log_scales.numpy(), axis=1)
    found: Mask = (scales[:, -1] > np.log(NEEDLE_M)) & (scales[:, -1] - scales[:, -2] > np.log(NEEDLE_RATIO))
    return found


def _above(place: Map, corner: NDArray[np.int64], size: NDArray[np.int64], seen: Float64, tree: Any) -> Camera | None:
    """The camera over a tile; None where nothing near was seen."""
    middle = place.corner + (corner + size / 2) / place.pixels_per_m @ place.axes
    far, nearest = tree.query(middle)
    if far > AROUND_M + float(np.linalg.norm(size)) / 2 / place.pixels_per_m:
        return None
    x, y = (np.append(axis, 0.0) for axis in place.axes)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, y, -UP])
    eye = np.append(middle, seen[nearest, 2] + ALTITUDE_M)
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    focal = place.pixels_per_m * ALTITUDE_M
    return Camera(int(size[0]), int(size[1]), focal, focal, size[0] / 2, size[1] / 2, matrix)


def _tile(surfels: Surfels, camera: Camera) -> tuple[Picture, NDArray[np.uint8], Mask]:
    """(H, W, 3) what is seen, (H, W) which of :data:`MARKED` it is, or 0, and (H, W) where anything is."""
    planes = ("rgb", "alpha", "semantics")
    out = rendered(surfels, camera, planes, label_count=ORIGIN_COUNT, near=NEAR_M, far=FAR_M)
    alpha = array(out.alpha)
    shown = array(out.rgb) + (1 - alpha)[..., None] * (np.array(BACKGROUND, np.float32) / 255)
    weights = array(out.semantics)[..., list(MARKED)]
    kinds = np.where(weights.max(axis=2) > LEAST_WEIGHT, np.array(MARKED, np.uint8)[weights.argmax(axis=2)], 0)
    picture = np.clip(np.round(255 * shown), 0, 255).astype(np.uint8)
    return picture, kinds.astype(np.uint8), np.asarray(alpha > 0.5)

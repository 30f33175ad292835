"""The ground of the empty street for a whole drive: fitted, read from the frames, relit, filled, and looked up per pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground, StreetPath, fit_ground, fit_path, straighten_path
from unveil_core.inpaint.chart.rectify import find_drift
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart, blur_levels, read_chart, sample_chart
from unveil_core.inpaint.fill.chart_fill import FillSettings, fill_chart
from unveil_core.inpaint.light.scene_light import light_of_scene
from unveil_core.inpaint.light.sun import Sun
from unveil_core.semantics.classes import LabelSet
from unveil_core.surfels.surfels import Surfels

__all__ = [
    "GROUND_CLASSES",
    "GroundLayer",
    "GroundPixels",
    "build_ground_layer",
    "fit_drive_ground",
    "ground_usable",
    "path_by_lines",
]

GROUND_CLASSES = ("road", "sidewalk", "terrain")
FOOT_DEPTH = 0.05
"""Relative difference of depth within which a foot is what is seen."""
SIDE_CLASSES = ("building", "wall", "fence")
Float32 = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class GroundPixels:
    """What a view would see of the ground if nothing stood on it; planes (H, W…), nothing outside ``hit``.

    Attributes:
        hit: (H, W) bool, the ray meets the ground.
        depth: (H, W) along the optical axis, inf where not hit.
        color: (H, W, 3) float32; gain: (H, W, 3) float32, see StreetChart.
        covered: (H, W) bool, the chart has a colour there.
        shadow: (H, W) bool, ground in the shadow of something removed; replaced: (H, W) bool, ground whose seen colour
            was given up, see StreetChart.
        extent: (H, W) of a pixel along its ray on the ground, in texels of the chart.
    """

    hit: NDArray[np.bool_]
    depth: NDArray[np.float64]
    color: Float32
    gain: Float32
    covered: NDArray[np.bool_]
    shadow: NDArray[np.bool_]
    replaced: NDArray[np.bool_]
    extent: Float32


@dataclass(frozen=True, eq=False)
class GroundLayer:
    """A filled chart with its blur levels, and the sun that shone on it, where that is known.

    Attributes:
        feet: (N, 3) world places just above the ground where something stands whose foot was hidden.
        ground_labels: compact labels of the ground; none where the scene has no classes.
    """

    chart: StreetChart
    colors: list[Float32]
    gains: list[Float32]
    sun: Sun | None = None
    feet: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    ground_labels: tuple[int, ...] = ()

    def foot_pixels(self, camera: Camera, depth: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(H, W) pixels that show such a foot, where it is what is seen at this ``depth`` (H, W)."""
        mask = np.zeros(depth.shape, dtype=np.uint8)
        if len(self.feet):
            pixel, z = camera.project(self.feet)
            inside = camera.in_picture(pixel, z)
            x, y = pixel[inside].astype(np.int64).T
            seen = np.abs(depth[y, x] - z[inside]) < FOOT_DEPTH * z[inside]
            mask[y[seen], x[seen]] = 1
            mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        return mask.astype(bool)

    def shadow_pixels(self, camera: Camera) -> NDArray[np.bool_]:
        """(H, W) pixels that may show relit ground, found by projecting its texels."""
        mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
        rows, columns = np.nonzero((self.chart.gain.max(axis=2) > 1.02) | self.chart.replaced)
        if len(rows):
            pixel, depth = camera.project(self.chart.world(rows, columns))
            inside = camera.in_picture(pixel, depth, nearest=0.3 * self.chart.texel / 0.04)
            mask[pixel[inside, 1].astype(int), pixel[inside, 0].astype(int)] = 1
            # Close to the camera texels lie some pixels apart.
            mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
            mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
        return mask.astype(bool)

    def look(self, camera: Camera, wanted: NDArray[np.bool_]) -> GroundPixels:
        """The ground as ``camera`` would see it in the ``wanted`` (H, W) pixels."""
        shape = wanted.shape
        rays = camera.rays()[wanted]
        depth, street = self.chart.ground.intersect(camera, rays)
        hit = np.isfinite(depth)
        color = np.zeros((len(rays), 3), dtype=np.float32)
        gain = np.ones((len(rays), 3), dtype=np.float32)
        covered = np.zeros(len(rays), dtype=bool)
        replaced = np.zeros(len(rays), dtype=bool)
        extent = np.zeros(len(rays), dtype=np.float32)
        if hit.any():
            z = depth[hit]
            # A pixel's extent on the ground: z/f across the view, and stretched by the grazing angle along it.
            ground, at = self.chart.ground, street[hit]
            direction = ground.path.along_street(at[:, 0], rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True))
            ahead, aside = ground.slope_at(at[:, 0], at[:, 1])
            steep = np.abs(direction[:, 2] - ahead * direction[:, 0] - aside * direction[:, 1])
            grazing = np.maximum(steep / np.sqrt(1 + ahead**2 + aside**2), 0.01)
            across = z / camera.fx
            extent[hit] = across / grazing / self.chart.texel
            level = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-6)
            footprint = direction[:, :2] * (across / grazing / level)[:, None]
            color[hit] = sample_chart(self.colors, self.chart, at, footprint, across)
            gain[hit] = sample_chart(self.gains, self.chart, at, footprint, across)
            row, column, on_chart = self.chart.index_of(street[hit])
            covered[hit] = on_chart & (self.chart.source[row, column] > 0)
            replaced[hit] = on_chart & self.chart.replaced[row, column]

        def spread(values: Any, default: float | bool) -> Any:
            plane = np.full((*shape, *values.shape[1:]), default, dtype=values.dtype)
            plane[wanted] = values
            return plane

        gain = np.maximum(gain, 1.0)
        return GroundPixels(
            hit=spread(hit, False),
            depth=spread(np.where(hit, depth, np.inf), np.inf),
            color=spread(np.clip(color, 0, 1), 0.0),
            gain=spread(gain, 1.0),
            covered=spread(covered, False),
            shadow=spread((gain.max(axis=1) > 1.02) | replaced, False),
            replaced=spread(replaced, False),
            extent=spread(extent, 0.0),
        )


def fit_drive_ground(
    surfels: Surfels, labels: LabelSet, cameras: Sequence[Camera], up: NDArray[np.float64], *, unit: float,
    path: StreetPath | None = None,
) -> Ground | None:  # fmt: skip
    """The ground from the surfels that lie on it: by label, or, in a scene without classes, the level ones underfoot.

    Args:
        surfels: the full scene.
        cameras: of the first track, in order of travel.
        unit: world units per metre.
        path: the street's, where more is known of it than the way that the cameras took.
    Returns:
        the ground, or None where too few surfels lie on any.
    """
    path = fit_path(list(cameras), up, unit=unit) if path is None else path
    means = surfels.means.double().numpy()
    opaque = surfels.opacity_logits.numpy() > -1.0
    wanted = labels.indices(GROUND_CLASSES)
    if wanted:
        chosen = np.isin(surfels.labels.numpy(), wanted) & opaque
    else:
        level = np.abs(surfels.normals().double().numpy() @ (up / np.linalg.norm(up))) > 0.8
        street = path.to_street(means)
        centres = np.stack([c.centre for c in cameras])
        track = path.to_street(centres)
        order = np.argsort(track[:, 0])
        eye = np.interp(street[:, 0], track[order, 0], track[order, 2])
        drop = eye - street[:, 2]
        near = np.abs(street[:, 1]) < 3 * unit
        keep = near & level & opaque & (drop > 0.5 * unit) & (drop < 3.0 * unit)
        if keep.sum() < 50:
            return None
        typical = float(np.median(drop[keep]))
        chosen = level & opaque & (np.abs(drop - typical) < 0.35 * unit) & (np.abs(street[:, 1]) < 8 * unit)
    if chosen.sum() < 50:
        return None
    sides = labels.indices(SIDE_CLASSES)
    walls = means[np.isin(surfels.labels.numpy(), sides) & opaque] if sides else None
    return fit_ground(path, means[chosen], unit=unit, walls=walls)


def path_by_lines(
    ground: Ground, cameras: Sequence[Camera], images: Sequence[NDArray[np.uint8]], labels: Sequence[NDArray[np.int64]],
    usable: Sequence[NDArray[np.bool_]], *, unit: float,
) -> StreetPath:  # fmt: skip
    """The ground's path, moved so that paint and kerbs keep their lateral offset: the car does not keep its distance from them.

    Args:
        images, labels, usable: (H, W…) per camera, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
        unit: world units per metre.
    """
    chart = read_chart(ground, cameras, images, labels, usable, unit=unit)
    drift = find_drift(chart.color, chart.source == OBSERVED, texels_per_m=unit / chart.texel)
    return straighten_path(ground.path, chart.coordinates()[0], drift.texels * chart.texel, unit=unit)


def ground_usable(
    label: NDArray[np.int64],
    labels: LabelSet,
    removed: NDArray[np.bool_],
    ground_depth: NDArray[np.float64],
    scene_depth: NDArray[np.floating],
) -> NDArray[np.bool_]:
    """(H, W) pixels that show nothing but ground.

    Args:
        label: (H, W) compact labels; removed: (H, W) with its borders.
        ground_depth, scene_depth: (H, W) depth of the fitted ground and of the full scene; they must agree.
    """
    agree = np.abs(scene_depth - ground_depth) < 0.08 * ground_depth
    wanted = labels.indices(GROUND_CLASSES)
    usable = ~removed & np.isfinite(ground_depth)
    if wanted:
        on_ground = np.isin(label, wanted)
        # Labels say it; depth only has to be no contradiction. One pixel of border mixes two things.
        inner = cv2.erode(on_ground.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
        return usable & inner
    return usable & agree


def build_ground_layer(
    ground: Ground,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    label_images: Sequence[NDArray[np.int64]],
    usable: Sequence[NDArray[np.bool_]],
    removed: Sequence[NDArray[np.float64]],
    settings: FillSettings,
    *,
    unit: float,
    scene: tuple[Surfels, Surfels] | None = None,
    solid: Sequence[int] = (),
    plants: Sequence[int] = (),
    sun: tuple[float, float] | None = None,
    texel_m: float = 0.04,
    progress: Progress = no_progress,
) -> GroundLayer:
    """Read the chart, mark where removed objects stood, relight and fill it.

    Args:
        removed: (M, 3) world centres of removed surfels, one array per object.
        scene: surfels of what stays and of what is removed, whose shadows tell where the sun stands; None leaves the sun out.
        solid: labels of what is solid down to the ground; plants: labels of vegetation.
        sun: its azimuth and elevation, degrees; None = looked for.
    """
    chart = read_chart(
        ground, cameras, images, label_images, usable, unit=unit, texel_m=texel_m, progress=progress
    )  # fmt: skip
    footprint = _footprint(chart, removed, unit=unit)
    light = None if scene is None else light_of_scene(
        chart, *scene, unit=unit, footprint=footprint, cameras=cameras,
        solid=solid, plants=plants, given=sun,
    )  # fmt: skip
    filled = fill_chart(chart, footprint, settings, unit=unit, light=light, progress=progress)
    return GroundLayer(
        filled, blur_levels(filled.color), blur_levels(filled.gain), None if light is None else light.sun
    )


def _footprint(chart: StreetChart, removed: Sequence[NDArray[np.float64]], *, unit: float) -> NDArray[np.bool_]:
    """(A, B) texels that removed objects stand on: the hull of each object's low surfels."""
    footprint = np.zeros(chart.source.shape, dtype=np.uint8)
    ground = chart.ground
    for means in removed:
        street = ground.path.to_street(means)
        above = ground.over(street)
        row, column, on_chart = chart.index_of(street)
        low = on_chart & (above < 2.5 * unit) & (above > -0.5 * unit)
        if low.sum() < 3:
            continue
        own = np.zeros_like(footprint)
        own[row[low], column[low]] = 1
        if max(np.ptp(street[low, 0]), np.ptp(street[low, 1])) < 12 * unit:
            # Strays would stretch the hull: only texels with company count.
            dense = cv2.morphologyEx(
                own, cv2.MORPH_CLOSE, np.ones((2 * int(0.3 * unit / chart.texel) + 1,) * 2, np.uint8)
            )
            count, component, stats, _ = cv2.connectedComponentsWithStats(dense, connectivity=8)
            areas = stats[:, cv2.CC_STAT_AREA] * chart.texel**2
            least = max(0.15 * unit**2, 0.25 * areas[1:].max(initial=0.0))
            large = [k for k in range(1, count) if areas[k] > least]
            rows, columns = np.nonzero(np.isin(component, large))
            if len(rows) >= 3:
                hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
                cv2.fillConvexPoly(footprint, hull, 1)
        footprint |= own
    return footprint.astype(bool)

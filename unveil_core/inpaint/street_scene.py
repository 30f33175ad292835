"""What is known of the empty street before anything is invented: its ground, and what goes on behind what was removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Labels, Mask
from unveil_core.drives.drive import Drive
from unveil_core.drives.scale import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.street_chart import StreetChart, blur_levels, read_chart, usable_pixels
from unveil_core.inpaint.facade.facade_chart import FacadeView, invented_facades, read_facade
from unveil_core.inpaint.facade.poles import feet_of_poles
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M, fill_chart
from unveil_core.inpaint.light.scene_light import light_of_scene
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import GROUND_CLASSES, SOLID_CLASSES, UPRIGHT_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_labels
from unveil_core.surfels.surfels import Surfels

__all__ = [
    "Views",
    "build_ground_layer",
    "drive_continued",
    "drive_ground_layer",
    "drive_views",
]


@dataclass(frozen=True, eq=False)
class Views:
    """What each frame shows.

    Attributes:
        images: (H, W, 3) uint8; labels: (H, W) compact; depths: (H, W) of the full scene; removed: (H, W) bool.
    """

    images: Sequence[NDArray[np.uint8]]
    labels: Sequence[NDArray[np.int64]]
    depths: Sequence[NDArray[np.float32]]
    removed: Sequence[NDArray[np.bool_]]


def drive_views(
    drive: Drive, scene: SceneLabels, surfels: Surfels, images: Sequence[NDArray[np.uint8]],
    removed: Sequence[NDArray[np.bool_]],
) -> Views:  # fmt: skip
    """The frames of a drive with what is known of them."""
    labels = [frame_labels(f, scene) for f in drive.frames]
    depths = [render_numpy(surfels, f.camera, near=NEAR_M, far=FAR_M)["depth"] for f in drive.frames]
    return Views(images, labels, depths, removed)


def drive_ground_layer(
    drive: Drive, scene: SceneLabels, ground: Ground, surfels: Surfels, gone: Mask, of_surfel: Labels, views: Views, *,
    shadows: bool = True, sun: tuple[float, float] | None = None, progress: Progress = no_progress,
) -> GroundLayer:  # fmt: skip
    """The ground of the empty street.

    Args:
        ground: the street's.
        surfels: the full scene; gone: (N,) those that are removed; of_surfel: (N,) the object that each belongs to.
        shadows: whether the removed objects' shadows are removed too.
        sun: its azimuth and elevation, degrees; None = looked for.
    """
    cameras = [f.camera for f in drive.frames]
    usable = [
        usable_pixels(ground, camera, label, scene.labels, grow(removed, border_px(camera.width, 1)), depth)
        for camera, label, removed, depth in zip(cameras, views.labels, views.removed, views.depths, strict=True)
    ]
    means = surfels.means.double().numpy()
    of_surfel = np.where(gone, of_surfel, -1)
    removed_objects = [means[of_surfel == i] for i in np.unique(of_surfel) if i >= 0]
    reach = SHADOW_REACH_M if shadows else 0.0
    keep = torch.from_numpy(~gone)
    layer = build_ground_layer(
        ground, cameras, views.images, views.labels, usable, removed_objects, reach,
        scene=(surfels.select(keep), surfels.select(~keep)), solid=scene.labels.indices(SOLID_CLASSES),
        plants=scene.labels.indices(("vegetation",)), sun=sun,
        progress=progress,
    )  # fmt: skip
    return replace(layer, ground_labels=scene.labels.indices(GROUND_CLASSES))


def drive_continued(
    drive: Drive, scene: SceneLabels, remaining: Surfels, layer: GroundLayer, views: Views
) -> tuple[list[Surfels], GroundLayer]:
    """Surfels that complete what was seen in part, facades and the feet of poles; and the ground with these feet.

    Args:
        remaining: the scene without what is removed; layer: its ground.
    """
    ground = layer.chart.ground
    cameras = [f.camera for f in drive.frames]
    found: list[Surfels] = []
    house = scene.labels.index("building")
    if house is not None:
        walls = remaining.select(remaining.labels == house)
        frames = zip(cameras, views.images, views.labels, views.depths, views.removed, strict=True)
        seen = [FacadeView(camera, image, label == house, depth, gone) for camera, image, label, depth, gone in frames]
        for left in (False, True):
            chart = read_facade(ground, walls, seen, left=left)
            facade = None if chart is None else invented_facades(chart, label=house, sh_degree=remaining.sh_degree)
            found += [] if facade is None else [facade]
    kinds = torch.tensor(scene.labels.indices(UPRIGHT_CLASSES), dtype=remaining.labels.dtype)
    standing = remaining.select(torch.isin(remaining.labels, kinds))
    feet = feet_of_poles(standing, ground, cameras, views.depths, views.removed)
    if feet is None:
        return found, layer
    return [*found, feet], replace(layer, feet=feet.means.double().numpy())


def build_ground_layer(
    ground: Ground,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    label_images: Sequence[NDArray[np.int64]],
    usable: Sequence[NDArray[np.bool_]],
    removed: Sequence[NDArray[np.float64]],
    shadow_reach_m: float,
    *,
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
        ground, cameras, images, label_images, usable, texel_m=texel_m, progress=progress
    )  # fmt: skip
    footprint = _footprint(chart, removed)
    light = None if scene is None else light_of_scene(
        chart, *scene, footprint=footprint, cameras=cameras,
        solid=solid, plants=plants, given=sun,
    )  # fmt: skip
    filled = fill_chart(chart, footprint, light=light, shadow_reach_m=shadow_reach_m, progress=progress)
    return GroundLayer(
        filled, blur_levels(filled.color), blur_levels(filled.gain), None if light is None else light.sun
    )


def _footprint(chart: StreetChart, removed: Sequence[NDArray[np.float64]]) -> NDArray[np.bool_]:
    """(A, B) texels that removed objects stand on: the hull of each object's low surfels."""
    footprint = np.zeros(chart.source.shape, dtype=np.uint8)
    ground = chart.ground
    for means in removed:
        street = ground.path.to_street(means)
        above = ground.over(street)
        row, column, on_chart = chart.index_of(street)
        low = on_chart & (above < 2.5) & (above > -0.5)
        if low.sum() < 3:
            continue
        texels = np.zeros_like(footprint)
        texels[row[low], column[low]] = 1
        if max(np.ptp(street[low, 0]), np.ptp(street[low, 1])) < 12.0:
            # Strays would stretch the hull: only texels with company count.
            dense = cv2.morphologyEx(texels, cv2.MORPH_CLOSE, np.ones((2 * int(0.3 / chart.texel) + 1,) * 2, np.uint8))
            count, component, stats, _ = cv2.connectedComponentsWithStats(dense, connectivity=8)
            areas = stats[:, cv2.CC_STAT_AREA] * chart.texel**2
            least = max(0.15, 0.25 * areas[1:].max(initial=0.0))
            large = [k for k in range(1, count) if areas[k] > least]
            rows, columns = np.nonzero(np.isin(component, large))
            if len(rows) >= 3:
                hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
                cv2.fillConvexPoly(footprint, hull, 1)
        footprint |= texels
    return footprint.astype(bool)

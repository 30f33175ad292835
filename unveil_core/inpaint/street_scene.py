"""What is known of the empty street before anything is invented: its ground, and what goes on behind what was removed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.drives.drive import Drive
from unveil_core.drives.scene_range import scene_range
from unveil_core.ground.street import Ground, StreetPath
from unveil_core.inpaint.chart.layer import (
    GROUND_CLASSES,
    GroundLayer,
    build_ground_layer,
    fit_drive_ground,
    ground_usable,
    path_by_lines,
)
from unveil_core.inpaint.facade.facade_chart import invented_fronts, read_facade
from unveil_core.inpaint.facade.poles import feet_of_uprights
from unveil_core.inpaint.fill.chart_fill import FillSettings
from unveil_core.inpaint.frames.seed import render_numpy
from unveil_core.optimize.start import tracks
from unveil_core.pipeline.runner import StageContext
from unveil_core.remove.regions import grow
from unveil_core.semantics.labels import SceneLabels, frame_labels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import load_array

__all__ = ["Views", "drive_continued", "drive_ground", "drive_ground_layer", "drive_views"]

SOLID_CLASSES = ("building", "wall")
"""What reaches down to the ground and lets no light through, though cars may hide its foot."""
UPRIGHT_CLASSES = ("pole", "traffic sign", "traffic light", "vegetation")


def drive_ground(drive: Drive, scene: SceneLabels, left: Surfels, path: StreetPath | None = None) -> Ground | None:
    """The ground under the drive's longest track, from the scene without what is removed; None where it has none.

    Args:
        path: of the street; by default the way that the cameras took.
    """
    track = max(tracks(drive), key=len)
    cameras = [drive.frames[i].camera for i in track]
    return fit_drive_ground(left, scene.labels, cameras, drive.up, unit=scene_range(drive).unit, path=path)


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
    limits = scene_range(drive)
    labels = [frame_labels(f, scene) for f in drive.frames]
    depths = [render_numpy(surfels, f.camera, near=limits.near, far=limits.far)["depth"] for f in drive.frames]
    return Views(images, labels, depths, removed)


def drive_ground_layer(
    context: StageContext, drive: Drive, scene: SceneLabels, surfels: Surfels, gone: NDArray[np.bool_], views: Views
) -> GroundLayer | None:  # fmt: skip
    """The ground of the empty street, or None where the scene has none."""
    limits = scene_range(drive)
    left = surfels.select(torch.from_numpy(~gone))
    ground = drive_ground(drive, scene, left)
    if ground is None:
        return None
    images, labels, depths, removed = views.images, views.labels, views.depths, views.removed
    cameras = [f.camera for f in drive.frames]

    def usable_for(ground: Ground) -> list[NDArray[np.bool_]]:
        usable = []
        for i, camera in enumerate(cameras):
            depth, _ = ground.intersect(camera, camera.rays().reshape(-1, 3))
            shape = (camera.height, camera.width)
            usable.append(ground_usable(labels[i], scene.labels, grow(removed[i], 1), depth.reshape(shape), depths[i]))
        return usable

    path = path_by_lines(ground, cameras, images, labels, usable_for(ground), unit=limits.unit)
    ground = drive_ground(drive, scene, left, path) or ground
    usable = usable_for(ground)
    means = surfels.means.double().numpy()
    of_surfel = np.where(gone, load_array(context.workspace.root / "surfels/instances.npy"), -1)
    removed_objects = [means[of_surfel == i] for i in np.unique(of_surfel) if i >= 0]
    fill = FillSettings(shadow_reach_m=5.0 if context.settings.shadows != "off" else 0.0)
    keep = torch.from_numpy(~gone)
    layer = build_ground_layer(
        ground, [f.camera for f in drive.frames], images, labels, usable, removed_objects, fill,
        unit=limits.unit, scene=(surfels.select(keep), surfels.select(~keep)), solid=scene.labels.indices(SOLID_CLASSES),
        plants=scene.labels.indices(("vegetation",)), sun=context.settings.sun,
        progress=context.progress,
    )  # fmt: skip
    return replace(layer, ground_labels=scene.labels.indices(GROUND_CLASSES))


def drive_continued(
    drive: Drive, scene: SceneLabels, left: Surfels, layer: GroundLayer, views: Views
) -> tuple[list[Surfels], GroundLayer]:
    """Surfels of what nobody saw of things that were seen in part, house fronts and the feet of what stands upright; and the ground
    that knows of these feet.

    Args:
        left: the scene without what is removed; layer: its ground.
    """
    unit, ground = scene_range(drive).unit, layer.chart.ground
    cameras = [f.camera for f in drive.frames]
    found: list[Surfels] = []
    house = scene.labels.index("building")
    if house is not None:
        walls, on_wall = left.select(left.labels == house), [label == house for label in views.labels]
        for is_left in (False, True):
            chart = read_facade(
                ground, walls, cameras, views.images, on_wall, views.depths, views.removed, left=is_left, unit=unit
            )  # fmt: skip
            front = None if chart is None else invented_fronts(chart, label=house, sh_degree=left.sh_degree)
            found += [] if front is None else [front]
    kinds = torch.tensor(scene.labels.indices(UPRIGHT_CLASSES), dtype=left.labels.dtype)
    standing = left.select(torch.isin(left.labels, kinds))
    feet = feet_of_uprights(standing, ground, cameras, views.depths, views.removed, unit=unit)
    if feet is None:
        return found, layer
    return [*found, feet], replace(layer, feet=feet.means.double().numpy())

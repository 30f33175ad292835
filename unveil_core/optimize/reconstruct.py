"""From a drive to the full semantic scene: the start, the schedule, the two stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.drives.drive import Drive
from unveil_core.drives.scale import units_per_metre
from unveil_core.errors import DriveError
from unveil_core.files import read_image
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.density import DensitySettings
from unveil_core.optimize.losses import LossWeights
from unveil_core.optimize.parameters import LearningRates
from unveil_core.optimize.trainer import TrainSettings, train
from unveil_core.optimize.views import TrainingView, training_view
from unveil_core.progress import Progress, no_progress
from unveil_core.raster import render
from unveil_core.semantics.lift import sample_colors, vote_labels
from unveil_core.semantics.segment import SceneLabels, frame_labels
from unveil_core.semantics.visibility import points_in_view
from unveil_core.surfels.initialize import estimate_normals, surfels_from_points, thin_points
from unveil_core.surfels.sky import Sky, fit_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.surfels.sweep import SweepSettings, sweep_points

__all__ = ["PRESETS", "ReconstructSettings", "SceneRange", "reconstruct", "scene_range", "start_scene"]


@dataclass(frozen=True)
class ReconstructSettings:
    """How much work a reconstruction may be.

    Attributes:
        iterations: steps in all; the second stage takes the last ``geometry_share`` of them.
        geometry_share: share of the second stage.
        coarse_share: share of the steps that run at half resolution.
        sh_degree: of the surfels' colour.
        start_spacing_m: finest spacing of the starting surfels, metres.
        start_budget: about how many surfels to start with.
        budget: at most how many surfels density control may reach.
        weights: of the losses, the paper's by default.
        spared: class names that opacity pruning leaves alone (the paper: sky and vegetation).
    """

    iterations: int = 1000
    geometry_share: float = 0.35
    coarse_share: float = 0.3
    sh_degree: int = 1
    start_spacing_m: float = 0.05
    start_budget: int = 60_000
    budget: int = 90_000
    weights: LossWeights = field(default_factory=LossWeights)
    spared: tuple[str, ...] = ("vegetation",)


PRESETS: dict[str, ReconstructSettings] = {
    "draft": ReconstructSettings(iterations=350, sh_degree=0, start_budget=40_000, budget=50_000),
    "standard": ReconstructSettings(),
    "high": ReconstructSettings(iterations=4000, sh_degree=2, start_budget=90_000, budget=200_000, coarse_share=0.2),
}


MEASURED_SHARE, MEASURED_POINTS = 0.02, 5
"""A pixel is measured where so many points lie within this share of the image's width."""


@dataclass(frozen=True)
class SceneRange:
    """Lengths of one scene in its own units: ``unit`` per metre, ``near`` and ``far`` of the distortion's range."""

    unit: float
    near: float
    far: float


def scene_range(drive: Drive) -> SceneRange:
    """0.2 m and 100 m, in the drive's units."""
    unit = units_per_metre(drive)
    return SceneRange(unit, 0.2 * unit, 100.0 * unit)


def tracks(drive: Drive) -> list[list[int]]:
    """Frame indices by camera, in order of travel."""
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    return [[i for i, f in enumerate(drive.frames) if f.camera_name == n] for n in names]


def _measured(
    points: NDArray[np.float64], spacing: NDArray[np.float64], camera: Camera, near: float
) -> NDArray[np.bool_]:
    """(H, W), the pixels around which the view sees measured points close together, as a LiDAR leaves them.

    The lonely points of structure from motion measure no surface.
    """
    seen = points_in_view(points, spacing, camera, near=near)
    count = np.zeros((camera.height, camera.width), np.float32)
    np.add.at(count, (seen.rows, seen.columns), 1.0)
    side = 2 * max(1, round(MEASURED_SHARE * camera.width)) + 1
    around = cv2.boxFilter(count, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    dense: NDArray[np.bool_] = around > MEASURED_POINTS - 0.5
    return dense


def start_scene(
    drive: Drive,
    scene: SceneLabels,
    images: Sequence[NDArray[np.uint8]],
    labels: Sequence[NDArray[np.int64]],
    settings: ReconstructSettings,
    *,
    progress: Progress = no_progress,
) -> Surfels:
    """Surfels from the drive's points and from swept ones, labelled by the views.

    Raises:
        DriveError: no point is seen by any frame.
    """
    limits = scene_range(drive)
    cameras = [f.camera for f in drive.frames]
    sky = scene.labels.index("sky")
    positions = [drive.points.positions]
    _, spacing = estimate_normals(drive.points.positions, np.stack([c.centre for c in cameras]), neighbours=4)
    # An isolated point stands for no more surface than a pixel block of the nearest view would.
    sizes = [np.minimum(spacing, np.median(spacing) * 4)]
    for track in tracks(drive):
        # Where a point was measured, the sweep has nothing to add: what it finds beside it is mostly wrong.
        usable = [~_measured(drive.points.positions, sizes[0], cameras[i], limits.near) for i in track]
        if sky is not None:
            usable = [u & (labels[i] != sky) for u, i in zip(usable, track, strict=True)]
        found, footprint = sweep_points(
            [cameras[i] for i in track], [images[i] for i in track], usable, SweepSettings(),
            near=10 * limits.near, far=limits.far, progress=progress,
        )  # fmt: skip
        if len(found):
            positions.append(found)
            sizes.append(footprint)
    # The drive's own points come first, so that thinning keeps them where both exist; swept ones only where
    # the nearest measured point is farther away than a few pixels.
    if len(positions) > 1:
        measured = cKDTree(positions[0])
        extra, footprint = np.concatenate(positions[1:]), np.concatenate(sizes[1:])
        lonely = measured.query(extra)[0] > 3 * np.maximum(footprint, settings.start_spacing_m * limits.unit)
        positions, sizes = [positions[0], extra[lonely]], [sizes[0], footprint[lonely]]
    points, size = np.concatenate(positions), np.concatenate(sizes)
    cell = np.maximum(size, settings.start_spacing_m * limits.unit)
    keep = thin_points(points, cell)
    while len(keep) > settings.start_budget:
        cell = cell * 1.15
        keep = thin_points(points, cell)
    points = points[keep]
    centres = np.stack([c.centre for c in cameras])
    normal, spacing = estimate_normals(points, centres)
    # What hides others is as large as the thinning left it; lonely strays must not blot out what lies behind them.
    cover = np.minimum(spacing, 0.7 * cell[keep])
    label, agreement = vote_labels(
        points, cover, cameras, lambda v: labels[v], len(scene.labels), near=limits.near, normals=normal
    )
    color, seen = sample_colors(points, cover, cameras, lambda v: images[v], near=limits.near, normals=normal)
    good = seen & (label >= 0) & (label != (-2 if sky is None else sky)) & (agreement > 0.4)
    if not good.any():
        raise DriveError("no point of the drive is seen by any frame", path=drive.root, mend="check poses and points")
    # Spacing of what remains, bounded: a far lonely point must not become a wall.
    spacing = np.clip(spacing[good], 0.3 * cell.min(), 6 * np.median(spacing[good]))
    return surfels_from_points(
        points[good], color[good], label[good], normal[good], spacing, sh_degree=settings.sh_degree, opacity=0.7
    )


def start_sky(drive: Drive, scene: SceneLabels, images, labels, surfels: Surfels, limits: SceneRange) -> Sky:  # type: ignore[no-untyped-def]
    """The sky from pixels labelled sky, or, without labels, from the upper pixels that no surfel covers."""
    sky = scene.labels.index("sky")
    samples: list[tuple[Camera, NDArray[np.uint8], NDArray[np.bool_]]] = []
    for i, frame in enumerate(drive.frames):
        if sky is not None:
            mask = labels[i] == sky
        else:
            with torch.no_grad():
                alpha = render(surfels, frame.camera, ("alpha",), near=limits.near, far=limits.far).alpha
            assert alpha is not None
            above = frame.camera.rays() @ drive.up > 0
            mask = (alpha.numpy() < 0.05) & above
        samples.append((frame.camera, images[i], mask))
    return fit_sky(samples, drive.up)


def reconstruct(
    drive: Drive,
    scene: SceneLabels,
    settings: ReconstructSettings,
    *,
    seed: int = 0,
    progress: Progress = no_progress,
) -> tuple[Surfels, Sky]:
    """Fit the full scene, with everything that is to be removed still in it.

    Args:
        drive: an imported drive.
        scene: its labels.
        settings: see there.
        seed: order of the views and of splits.
        progress: called per step with loss and the number of surfels.
    """
    limits = scene_range(drive)
    images = [read_image(f.image_path) for f in drive.frames]
    labels = [frame_labels(f, scene) for f in drive.frames]
    surfels = start_scene(drive, scene, images, labels, settings, progress=progress)
    sky = start_sky(drive, scene, images, labels, surfels, limits)

    def views(factor: float) -> list[TrainingView]:
        return [
            training_view(f.camera, images[i], labels[i], None, sky, factor=factor) for i, f in enumerate(drive.frames)
        ]

    fine, coarse = views(1.0), views(0.5) if settings.coarse_share > 0 else []
    switch = round(settings.iterations * settings.coarse_share)
    geometry_from = round(settings.iterations * (1 - settings.geometry_share))
    training = TrainSettings(
        iterations=settings.iterations,
        geometry_from=geometry_from,
        weights=settings.weights,
        density=DensitySettings(
            start=round(0.12 * settings.iterations),
            stop=geometry_from,
            every=max(50, settings.iterations // 12),
            budget=settings.budget,
            max_scale=3.0 * limits.unit,
        ),  # fmt: skip
        prune_every=max(50, settings.iterations // 8),
        near=limits.near,
        far=limits.far,
    )
    rates = LearningRates(means=0.004 * limits.unit)
    spared = [k for k, n in enumerate(scene.labels.names) if n in settings.spared]
    return train(
        surfels, sky, lambda i: coarse if i < switch else fine, training, rates,
        label_count=len(scene.labels), sky_label=scene.labels.index("sky"), spared_labels=spared,
        seed=seed, progress=progress,
    )  # fmt: skip

"""Where the optimization starts: surfels from measured and swept points, a sky from the pixels that show it.

The paper starts from LiDAR and SfM points (*3D StreetUnveiler*, section 3.1); here normals, spacing, colours and labels come
from the points and the views too, so that the optimization need not find them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.errors import DriveError
from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Levels
from unveil_core.drives.depth_range import FAR_M, FARTHEST_M, NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import estimate_normals, thin_points
from unveil_core.geometry.images import mask_bits, mask_of_bits
from unveil_core.optimize.adaptation.choices import decibels
from unveil_core.optimize.ground_start import measured_lane, start_ground
from unveil_core.optimize.uncovered import cover_uncovered
from unveil_core.raster.on_device import array, rendered
from unveil_core.semantics.labels import SceneLabels
from unveil_core.semantics.visibility import PointsInView, points_in_view
from unveil_core.semantics.votes import sample_colors, vote_labels
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.outliers import lonely_points
from unveil_core.surfels.sky import Sky, fit_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.surfels.sweep import SweepSettings, sweep_points
from unveil_core.surfels.tangents import tangent_frames

__all__ = ["SKY_ROWS", "StartSettings", "random_scene", "start_scene", "start_sky"]


SKY_ROWS, SKY_GAIN = (8, 16, 32, 64, 128), 0.4


@dataclass(frozen=True)
class StartSettings:
    """Attributes:
    spacing_m: finest spacing of the starting surfels, metres.
    budget: about how many surfels to start with.
    """

    spacing_m: float = 0.05
    budget: int = 60_000


MEASURED_SHARE, MEASURED_POINTS = 0.02, 5
"""A pixel counts as measured if this many points lie within this share of the image's width."""


DETAIL_WINDOW = (7, 7)
FINEST_SHARE = 0.5
"""Of the usual cell, where the images have most detail."""


def _survey(
    points: NDArray[np.float64],
    spacing: NDArray[np.float64],
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    near: float,
) -> tuple[Sequence[NDArray[np.bool_]], NDArray[np.float64]]:
    """What is measured in each view, (H, W) each, and the detail (P,) that the views show around each point.

    Detail is the contrast of the nearby pixels, levels of 255, the mean over the views that see the point, nan without any.
    """
    measured = []  # a bit a pixel: they are of all frames
    total, weight = np.zeros(len(points)), np.zeros(len(points))
    for camera, image in zip(cameras, images, strict=True):
        seen = points_in_view(points, spacing, camera, near=near)
        measured.append(mask_bits(_measured(seen, camera)))
        gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
        mean, square = cv2.blur(gray, DETAIL_WINDOW), cv2.blur(gray * gray, DETAIL_WINDOW)
        contrast = np.sqrt(np.maximum(square - mean * mean, 0))[seen.rows, seen.columns]
        total[seen.index] += contrast / seen.depth
        weight[seen.index] += 1 / seen.depth

    def unpacked(i: int) -> NDArray[np.bool_]:
        return mask_of_bits(measured[i], (cameras[i].height, cameras[i].width))

    return Frames(len(cameras), unpacked), np.where(weight > 0, total / np.maximum(weight, 1e-12), np.nan)


def _cell_share(detail: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) share of the usual cell of thinning: the less, the more detail a point has beyond the median."""
    if np.isnan(detail).all():
        return np.ones(len(detail))
    share = np.clip(np.nanmedian(detail) / np.maximum(detail, 1e-3), FINEST_SHARE, 1.0)
    return np.nan_to_num(share, nan=1.0)


def _measured(seen: PointsInView, camera: Camera) -> NDArray[np.bool_]:
    """(H, W), the pixels around which the view sees measured points close together, as a LiDAR leaves them.

    The lonely points of structure from motion measure no surface.
    """
    pixel = seen.rows * camera.width + seen.columns
    count = np.bincount(pixel, minlength=camera.height * camera.width).astype(np.float32)
    count = count.reshape(camera.height, camera.width)
    side = 2 * max(1, round(MEASURED_SHARE * camera.width)) + 1
    around = cv2.boxFilter(count, -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    dense: NDArray[np.bool_] = around > MEASURED_POINTS - 0.5
    return dense


@dataclass(frozen=True, eq=False)
class SceneStart:
    """What training begins with.

    Attributes:
        surfels: of the scene.
        ground: JSON-able, the share of the lane ahead that is ``measured``, None where none is seen; where another tells the
            ground: what ``told_by``, and the ``height`` of the cameras over it, metres.
    """

    surfels: Surfels
    ground: dict[str, Any]


def start_scene(
    drive: Drive,
    scene: SceneLabels,
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    settings: StartSettings,
    *,
    hidden: Sequence[NDArray[np.bool_]] | None = None,
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> SceneStart:
    """Surfels from the drive's points and from swept ones, labelled by the views.

    Args:
        hidden: (H, W) per frame, pixels that show what does not stand: they give no points, no colours and, by ``labels``,
            no labels; None = no such pixels.
        cache: room for the frames.
    Raises:
        DriveError: no point is seen by any frame.
    """
    cameras = [f.camera for f in drive.frames]
    cache = cache or FrameCache()
    sky = scene.labels.index("sky")

    def unmeasured(i: int) -> NDArray[np.bool_]:
        usable: NDArray[np.bool_] = ~measured[i]
        if sky is not None:
            usable &= labels[i] != sky
        if ground is not None:
            usable &= ~ground.shown[i]
        return usable if hidden is None else usable & ~hidden[i]

    centres = np.stack([c.centre for c in cameras])
    spacing, lonely = lonely_points(drive.points.positions, centres)
    positions, spacing = [drive.points.positions[~lonely]], spacing[~lonely]
    # An isolated point stands for no more surface than a pixel block of the nearest view would.
    sizes = [np.minimum(spacing, np.median(spacing) * 4)]
    measured, detail = _survey(positions[0], sizes[0], cameras, images, NEAR_M)
    of_drive = len(positions[0])
    told: dict[str, Any] = {"measured": measured_lane(drive, measured)}
    ground = start_ground(
        drive,
        scene,
        images,
        labels,
        told["measured"],
        budget=settings.budget,
        hidden=hidden,
        cache=cache,
        progress=progress,
    )
    if ground is not None:
        positions[0] = np.concatenate([positions[0], ground.points])
        sizes[0] = np.concatenate([sizes[0], np.full(len(ground.points), ground.spacing)])
    for track in tracks(drive):
        # Where a point was measured, the sweep has nothing to add: what it finds beside it is mostly wrong.
        found, footprint = sweep_points(
            [cameras[i] for i in track],
            subset(images, track),
            subset(Frames(len(cameras), unmeasured), track),
            SweepSettings(),
            near=10 * NEAR_M,
            far=FARTHEST_M,
            progress=progress,
        )
        if len(found):
            positions.append(found)
            sizes.append(footprint)
    # The drive's own points come first, so that thinning keeps them where both exist; swept ones only where
    # the nearest measured point is farther away than a few pixels.
    if len(positions) > 1:
        known = cKDTree(positions[0])
        extra, footprint = np.concatenate(positions[1:]), np.concatenate(sizes[1:])
        new = known.query(extra)[0] > 3 * np.maximum(footprint, settings.spacing_m)
        positions, sizes = [positions[0], extra[new]], [sizes[0], footprint[new]]
    points, size = np.concatenate(positions), np.concatenate(sizes)
    # A plain surface needs no finer surfels than its points; what has detail gets all points that there are.
    size[:of_drive] *= _cell_share(detail)
    cell = np.maximum(size, settings.spacing_m)
    keep = thin_points(points, cell)
    while len(keep) > settings.budget:
        cell = cell * 1.15
        keep = thin_points(points, cell)
    points, cell = points[keep], cell[keep]
    normal, spacing = estimate_normals(points, centres)
    # What hides others is as large as the thinning left it; lonely strays must not blot out what lies behind them.
    cover = np.minimum(spacing, 0.7 * cell)
    views: Sequence[PointsInView] = cache.frames(
        len(cameras), lambda v: points_in_view(points, cover, cameras[v], near=NEAR_M, normals=normal)
    )
    label, agreement = vote_labels(len(points), views, lambda v: labels[v], len(scene.labels))
    static = views if hidden is None else Frames(len(cameras), lambda v: views[v].outside(hidden[v]))
    color, seen = sample_colors(len(points), static, lambda v: images[v])
    good = seen & (label >= 0) & (label != (-2 if sky is None else sky)) & (agreement > 0.4)
    if not good.any():
        raise DriveError("no point of the drive is seen by any frame", path=drive.root, mend="check poses and points")
    # Spacing of what remains, bounded: a far lonely point must not become a wall.
    spacing = np.clip(spacing[good], 0.3 * cell.min(), 6 * np.median(spacing[good]))
    quats, factors = tangent_frames(points[good], normal[good])
    start = surfels_from_points(
        points[good], color[good], label[good], normal[good], spacing[:, None] * factors, quats=quats, opacity=0.7
    )
    if ground is not None:
        told |= {"told_by": ground.told_by, "height": ground.height}
    return SceneStart(cover_uncovered(start, cameras, images, labels, len(scene.labels), sky, UP, ground), told)


def random_scene(
    drive: Drive, scene: SceneLabels, labels: Sequence[NDArray[np.int64]], count: int, *, seed: int = 0
) -> Surfels:
    """A start that knows the extent of the points and nothing else, for comparison: places, directions and colours at random.

    Only hard labels cannot be: a surfel has the one that most views show where it lies, hidden or not.
    """
    generator = np.random.default_rng(seed)
    low, high = np.percentile(drive.points.positions, (1, 99), axis=0)
    points = generator.uniform(low, high, (count, 3))
    normal = generator.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    spacing = estimate_normals(points, points[:1])[1]
    sky = scene.labels.index("sky")
    views = Frames(
        len(drive.frames), lambda v: points_in_view(points, 1e-6 * spacing, drive.frames[v].camera, near=NEAR_M)
    )
    label, _ = vote_labels(count, views, lambda v: labels[v], len(scene.labels))
    good = (label >= 0) & (label != (-2 if sky is None else sky))
    colors = generator.integers(0, 256, (count, 3)).astype(np.uint8)
    return surfels_from_points(points[good], colors[good], label[good], normal[good], spacing[good], opacity=0.1)


def start_sky(
    drive: Drive,
    scene: SceneLabels,
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    surfels: Surfels | None,
    rows: Sequence[int] = SKY_ROWS,
    hidden: Sequence[NDArray[np.bool_]] | None = None,
    cache: FrameCache | None = None,
) -> tuple[Sky, dict[str, Any]]:
    """The sky from pixels labelled sky, or, without labels, from the upper pixels that no surfel covers.

    Args:
        surfels: of the start; only asked where nothing labels the sky.
        rows: heights of the panorama to choose from, rising.
        hidden: (H, W) per frame, pixels that show what does not stand; None = no such pixels.
        cache: room for the frames.
    Returns:
        the sky, in how many of the ``frames`` it was ``shown``, where none shows it even and grey, and what its size was chosen by:
        a panorama fitted to every second frame is held against the others, and a larger one must explain them better by
        ``SKY_GAIN`` dB.
    """
    sky = scene.labels.index("sky")
    cameras = [f.camera for f in drive.frames]

    def sky_pixels(i: int) -> NDArray[np.bool_]:
        if sky is not None:
            return labels[i] == sky
        assert surfels is not None
        alpha = array(rendered(surfels, cameras[i], ("alpha",), near=NEAR_M, far=FAR_M).alpha)
        mask: NDArray[np.bool_] = (alpha < 0.05) & (cameras[i].rays() @ UP > 0)
        return mask if hidden is None else mask & ~hidden[i]

    masks = (cache or FrameCache()).frames(len(cameras), sky_pixels)
    samples = Frames(len(cameras), lambda i: (cameras[i], images[i], masks[i]))
    chosen, best, tried = rows[0], -np.inf, {}
    for height in rows if len(rows) > 1 and any(m.any() for m in masks[1::2]) else ():
        trial = fit_sky(samples[::2], UP, height=height)
        psnr = decibels(_sky_error(trial, samples[1::2]))
        tried[str(height)] = round(psnr, 3)
        if psnr < best + SKY_GAIN:
            break
        chosen, best = height, psnr
    shown = sum(bool(m.any()) for m in masks)
    choice = {"chosen": chosen, "psnr_of_rows": tried, "shown": shown, "frames": len(cameras)}
    return fit_sky(samples, UP, height=chosen), choice


def _sky_error(sky: Sky, samples: Sequence[tuple[Camera, Levels, NDArray[np.bool_]]]) -> float:
    """Mean squared error of a sky in the pixels that show it, colours in [0, 1]; one frame's errors are held at a time.

    Args:
        samples: camera, image (H, W, 3) and mask (H, W) of some views, of which one at least shows sky.
    """
    sums, count = [], 0
    for camera, image, mask in samples:
        error = np.square(sky.render(camera).numpy()[mask] - image[mask] / 255.0)
        sums.append(float(error.sum()))
        count += error.size
    return math.fsum(sums) / count

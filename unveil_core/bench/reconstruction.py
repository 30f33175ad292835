"""A reconstruction measured against views it has not seen, true labels and the true surface."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.kernels.device import current_device
from unveil_core.base.pictures.decoding import read_instance_image, read_label_image
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.base.progress import Progress, no_progress
from unveil_core.bench.timing import machine
from unveil_core.drives import open_drive
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.evaluate.geometry import depth_points, surface_distances
from unveil_core.evaluate.held_out import evaluate_views, split_drive
from unveil_core.geometry.cloud import thin_points
from unveil_core.geometry.images import grow
from unveil_core.mesh.tsdf import fuse
from unveil_core.mesh.views import depth_views
from unveil_core.optimize.adaptation.choices import CHOICES
from unveil_core.optimize.exposure import fit_exposures
from unveil_core.optimize.presets import PRESETS, ReconstructSettings
from unveil_core.optimize.reconstruct import reconstruct
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.raster import render
from unveil_core.remove.selection import select_removed
from unveil_core.semantics.labels import SceneLabels, choose_labels, frame_labels
from unveil_core.surfels.surfels import Surfels

__all__ = ["LOSSES", "VARIANTS", "bench_reconstruction"]

LOSSES = ("dssim", "semantic", "distortion", "label_distortion", "normal", "opacity")
"""Names that ``without`` takes: the parts of the loss beside L1."""
VARIANTS: dict[str, Callable[[ReconstructSettings], ReconstructSettings]] = {
    "fixed": lambda s: replace(s, given=frozenset(CHOICES)),
    "soft_labels": lambda s: replace(s, soft_labels=True),
    "ellipsoids": lambda s: replace(s, ellipsoids=True),
    "random_start": lambda s: replace(s, random_start=True),
    "no_growth": lambda s: replace(s, budget=0),
    "no_pruning": lambda s: replace(s, prune_opacity=0.0),
    "torch": lambda s: replace(s, kernels="torch"),
}
"""What the reconstruction may be done with or without instead, by name: all steps, surfels and degrees that the limits allow
(no adaptation); trainable labels; 3D Gaussians; surfels thrown into the scene; no density control; no opacity pruning; losses and
Adam as torch does them on a GPU, on the processor."""
VOXEL_M, DEPTH_M, REACH_M, SAMPLE_M = 0.06, 25.0, 35.0, 0.05
CROP_M = 5.0
"""Points farther than this from every true one are left out, as in the paper (section 4)."""
TOO_CLOSE_M = 0.08
FINER = 4
DROP, OPAQUE, SMALLEST_PX = 0.01, 0.99, 12
"""Of alpha, by which it must fall and what it must fall below (*3D StreetUnveiler*, section 3.2): sky and glass are no holes;
and the smallest hole, pixels."""


def _finer(
    depth: NDArray[np.float64], keep: NDArray[np.bool_], factor: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """A depth image of more pixels: inverse depth, which is linear on a plane, between pixels of one surface.

    Ground that only far frames see would else be known at a few points, metres apart.
    """
    inverse = np.where(keep, 1.0 / np.where(keep, depth, 1.0), 0.0)
    # Second differences vanish on a plane, whatever its slope, and do not across the edge of an object.
    bend = np.zeros_like(inverse)
    bend[1:-1] = np.abs(inverse[2:] - 2 * inverse[1:-1] + inverse[:-2])
    bend[:, 1:-1] = np.maximum(bend[:, 1:-1], np.abs(inverse[:, 2:] - 2 * inverse[:, 1:-1] + inverse[:, :-2]))
    smooth = keep & (bend < 0.03 * inverse)
    size = (depth.shape[1] * factor, depth.shape[0] * factor)
    fine = cv2.resize(inverse, size, interpolation=cv2.INTER_LINEAR)
    # Only where all four neighbours are smooth; pixels themselves count in any case.
    whole = cv2.resize(smooth.astype(np.float64), size, interpolation=cv2.INTER_LINEAR) > 0.999
    # Beyond the outer pixels' centres there is nothing to be between.
    edge = factor // 2
    inner = np.zeros(whole.shape, bool)
    inner[edge:-edge, edge:-edge] = True
    return 1.0 / np.where(fine > 0, fine, 1.0), whole & inner & (fine > 0)


def _true_surface(drive: Drive, furthest: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What some frame sees of everything that stays, by the truth's depth images: points (P, 3) and their depths (P,)."""
    assert drive.truth_root is not None
    points, depths = [np.zeros((0, 3))], [np.zeros(0)]
    for frame in drive.frames:
        path = drive.truth_root / "depth" / f"{frame.name}.png"
        if not path.is_file():
            continue
        # As KITTI keeps depth: 256 steps a metre, 0 for none.
        depth = read_instance_image(path).astype(np.float64) / 256
        removed = drive.truth_root / "removed" / f"{frame.name}.png"
        keep = depth > 0
        if removed.is_file():
            mask = read_label_image(removed) > 0
            # Half as many pixels: one counts where none of the finer ones is removed.
            rows, columns = mask.shape[0] // depth.shape[0], mask.shape[1] // depth.shape[1]
            keep &= ~mask.reshape(depth.shape[0], rows, depth.shape[1], columns).any(axis=(1, 3))
        # Of each block of pixels the truth keeps the last one.
        step = frame.camera.width // depth.shape[1]
        camera = frame.camera.resized(depth.shape[1], depth.shape[0])
        shift = 0.5 - 0.5 / step
        camera = replace(camera, cx=camera.cx - shift, cy=camera.cy - shift)
        for image, good in ((depth, keep), _finer(depth, keep, FINER)):
            near = good & (image < furthest)
            points.append(depth_points(camera, image, near))
            depths.append(image[near])
    return np.concatenate(points), np.concatenate(depths)


def _geometry(drive: Drive, scene: SceneLabels, surfels: Surfels, frames: tuple[Frame, ...]) -> dict[str, Any]:
    """The fused mesh of what stays, against the true surface; empty without a truth."""
    if drive.truth_root is None or not (drive.truth_root / "depth").is_dir():
        return {}
    removable = np.array(scene.removable_labels, np.int64)
    without = [np.isin(frame_labels(f, scene), removable) for f in frames]
    views = depth_views(surfels, frames, near=NEAR_M, far=FAR_M, without=without)
    mesh = fuse(views, voxel_size=VOXEL_M, max_depth=DEPTH_M)
    corners = mesh.vertices.astype(np.float64)
    found = corners[thin_points(corners, SAMPLE_M)]
    reference, depth = _true_surface(drive, REACH_M)
    true = reference[depth < DEPTH_M]
    reference, true = (p[thin_points(p, SAMPLE_M)] for p in (reference, true))
    distances = surface_distances(found, true, reference=reference, crop=CROP_M)
    return {
        "chamfer_m": round(distances.chamfer, 4),
        **{f"f_score_{t}": round(distances.f_score(t), 4) for t in (0.05, 0.25)},
        **{f"precision_{t}": round(distances.precision(t), 4) for t in (0.05, 0.25)},
        **{f"recall_{t}": round(distances.recall(t), 4) for t in (0.05, 0.25)},
        "points": [len(found), len(true)],
        "cropped": len(found) - len(distances.to_true),
    }


def unobserved_mask(
    alpha_full: NDArray[np.float32],
    alpha_empty: NDArray[np.float32],
    removed: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Pixels (H, W) that are unobserved by the paper's rule: alpha falls when the objects are taken out, because no view gave
    surfels for what lies behind.

    Args:
        alpha_full, alpha_empty: (H, W) with and without the objects.
        removed: (H, W) where this view shows a removed object, borders included.
    """
    hole = (alpha_full - alpha_empty > DROP) & (alpha_empty < OPAQUE) & removed
    hole = cv2.morphologyEx(hole.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, component, stats, _ = cv2.connectedComponentsWithStats(hole, connectivity=8)
    large = np.zeros(count, dtype=bool)
    large[1:] = stats[1:, cv2.CC_STAT_AREA] >= SMALLEST_PX
    return large[component] & removed


def _unobserved_iou(drive: Drive, scene: SceneLabels, surfels: Surfels, frames: tuple[Frame, ...]) -> dict[str, Any]:
    """The unobserved pixels by the alpha maps, without the removable classes, against the true ones; empty without truth."""
    gone = select_removed(surfels, np.zeros(len(surfels), np.int64), scene, too_close=TOO_CLOSE_M).removed
    remaining = surfels.select(torch.from_numpy(~gone))
    both = either = 0
    for frame in frames:
        path = None if drive.truth_root is None else drive.truth_root / "unseen" / f"{frame.name}.png"
        if path is None or not path.is_file():
            continue
        alpha = []
        for part in (surfels, remaining):
            with torch.no_grad():
                plane = render(part, frame.camera, ("alpha",), near=NEAR_M, far=FAR_M).alpha
            assert plane is not None
            alpha.append(plane.numpy())
        removed = grow(np.isin(frame_labels(frame, scene), scene.removed_labels), 2)
        found, true = unobserved_mask(alpha[0], alpha[1], removed), read_label_image(path) > 127
        both, either = both + int((found & true).sum()), either + int((found | true).sum())
    return {"unobserved_iou": round(both / either, 4)} if either else {}


def _salted(drive: Drive, scene: SceneLabels, share: float, folder: Path, seed: int) -> Drive:
    """The drive with this share of its label pixels replaced by another of its labels each, written to a folder."""
    generator = np.random.default_rng(seed)
    ids, count = np.array(scene.labels.disk_ids), len(scene.labels)
    frames = []
    for frame in drive.frames:
        label = frame_labels(frame, scene)
        other = (label + generator.integers(1, count, label.shape)) % count
        noisy = np.where((generator.random(label.shape) < share) & (label >= 0), other, label)
        path = folder / f"{frame.camera_name}_{frame.name}.png"
        write_image_atomic(path, np.where(noisy >= 0, ids[noisy], 255).astype(np.uint8))
        frames.append(replace(frame, semantic_path=path))
    return replace(drive, frames=tuple(frames))


def bench_reconstruction(
    path: Path,
    *,
    quality: str = "standard",
    every: int = 8,
    without: tuple[str, ...] = (),
    variant: str | None = None,
    salt: float = 0.0,
    seed: int = 0,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Reconstruct a drive without every n-th frame, and measure.

    Args:
        path: a drive, as for ``unveil run``; its images are used as they are (no lens distortion).
        without: parts of the loss that are left out, see ``LOSSES``.
        variant: one of ``VARIANTS``.
        salt: share of the pixels of the training frames' labels that are replaced by any other label.
    Returns:
        seconds, and those of all cores together; surfels; memory; PSNR, SSIM and mIoU of the held-out frames; Chamfer
        distance and F-scores where the drive has a truth with depth.
    """
    unknown = [name for name in without if name not in LOSSES]
    if unknown:
        raise SettingsError(f"Not a loss: {unknown[0]}", mend=f"use {', '.join(LOSSES)}")
    if variant is not None and variant not in VARIANTS:
        raise SettingsError(f"Not a variant: {variant}", mend=f"use {', '.join(VARIANTS)}")
    drive = open_drive(path)
    check_drive(drive)
    drive = localized(drive)
    if any(f.distortion is not None for f in drive.frames):
        raise SettingsError(
            "the drive's images are distorted", mend="import it first and name the workspace's drive folder"
        )
    training, held = split_drive(drive, every)
    scene = choose_labels(drive)
    preset = PRESETS[quality] if variant is None else VARIANTS[variant](PRESETS[quality])
    weights: LossWeights = replace(preset.weights, **dict.fromkeys(without, 0.0))
    before = machine()
    with tempfile.TemporaryDirectory() as folder:
        labelled = _salted(training, scene, salt, Path(folder), seed) if salt else training
        begun, begun_cpu = time.perf_counter(), time.process_time()
        exposures = fit_exposures(labelled, progress=progress)
        done = reconstruct(
            labelled, scene, replace(preset, weights=weights), exposures=exposures, seed=seed, progress=progress
        )
    seconds, cpu_seconds = time.perf_counter() - begun, time.process_time() - begun_cpu
    surfels, sky = done.surfels, done.sky
    return {
        "machine": before,
        "drive": path.name,
        "quality": quality,
        "without": list(without),
        "variant": variant,
        "salt": salt,
        "seed": seed,
        "seconds": round(seconds, 1),
        "cpu_seconds": round(cpu_seconds, 1),
        "surfels": len(surfels),
        "device": current_device().name,
        "peak_memory_mb": peak_memory_mb(),
        "exposure": dict(exposures.figures),
        "held_out": evaluate_views(
            surfels, sky, held, scene, near=NEAR_M, far=FAR_M, align_exposure=not exposures.is_identity
        ),
        "geometry": _geometry(drive, scene, surfels, training.frames)
        | _unobserved_iou(drive, scene, surfels, training.frames),
        "choices": done.choices,
    }

"""Scores of held-out views: their renders against the photographs, and their labels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.drive import Drive, Frame
from unveil_core.evaluate.metrics import psnr_of_mse, squared_error, ssim
from unveil_core.optimize.exposure import affine_between
from unveil_core.raster.on_device import array, rendered
from unveil_core.semantics.labels import SceneLabels, frame_labels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["class_iou", "evaluate_views", "rendered_view", "split_drive"]

SMALLEST_SHARE = 1e-4
"""A class with less than this share of the pixels is reported but not part of the mean."""


def split_drive(drive: Drive, every: int) -> tuple[Drive, list[Frame]]:
    """The drive without every n-th frame of each camera, and those frames; the first and last frame are never held out."""
    seen: dict[str, int] = {}
    held = []
    for frame in drive.frames:
        turn = seen[frame.camera_name] = seen.get(frame.camera_name, -1) + 1
        if turn % every == every // 2:
            held.append(frame)
    last = {f.camera_name: f for f in drive.frames}
    held = [f for f in held if f is not last[f.camera_name]]
    return replace(drive, frames=tuple(f for f in drive.frames if f not in held)), held


def rendered_view(
    surfels: Surfels, sky: Sky, frame: Frame, scene: SceneLabels, *, near: float, far: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(H, W, 3) picture in [0, 1] and (H, W) compact labels, the light that is left through counting as sky."""
    planes = ("rgb", "alpha", "semantics")
    out = rendered(surfels, frame.camera, planes, label_count=len(scene.labels), near=near, far=far)
    assert out.rgb is not None and out.alpha is not None and out.semantics is not None
    behind = sky.render(frame.camera).to(out.rgb.device)
    picture = (out.rgb + (1 - out.alpha)[..., None] * behind).clamp(0, 1)
    weights = out.semantics.clone()
    sky_label = scene.labels.index("sky")
    if sky_label is not None:
        weights[..., sky_label] += 1 - out.alpha
    return array(picture.double()), array(weights.argmax(2))


def class_iou(confusion: NDArray[np.int64], names: tuple[str, ...]) -> dict[str, Any]:
    """Intersection over union per class of a (K, K) confusion matrix, rows true, and their mean."""
    both = np.diag(confusion).astype(np.float64)
    union = confusion.sum(0) + confusion.sum(1) - both
    share = confusion.sum(1) / max(1, confusion.sum())
    iou = {name: round(both[k] / union[k], 4) for k, name in enumerate(names) if union[k]}
    counted = [k for k in range(len(names)) if share[k] >= SMALLEST_SHARE]
    mean = float(np.mean([both[k] / union[k] for k in counted])) if counted else float("nan")
    return {
        "miou": round(mean, 4),
        "iou": iou,
        "left_out": [n for k, n in enumerate(names) if union[k] and k not in counted],
    }


def evaluate_views(
    surfels: Surfels,
    sky: Sky,
    frames: list[Frame],
    scene: SceneLabels,
    *,
    near: float,
    far: float,
    align_exposure: bool = False,
) -> dict[str, Any]:
    """PSNR, SSIM and mIoU over some frames; PSNR is that of the mean squared error over all of them.

    Args:
        align_exposure: for scenes in canonical colours (see ``drives.exposure``): the exposure of a held-out frame
            is unknown, so gain and bias that bring its render nearest to its photograph are applied first.
    """
    count = len(scene.labels)
    confusion = np.zeros((count, count), np.int64)
    errors, similarities = [], []
    for frame in frames:
        picture, labels = rendered_view(surfels, sky, frame, scene, near=near, far=far)
        photograph = read_image(frame.image_path)
        if align_exposure:
            gain, bias = affine_between(picture, photograph)
            picture = np.clip(gain * picture + bias, 0, 1)
        errors.append(float(squared_error(picture, photograph).mean()))
        similarities.append(ssim(picture, photograph))
        true = frame_labels(frame, scene)
        known = true >= 0
        confusion += np.bincount(true[known] * count + labels[known], minlength=count * count).reshape(count, count)
    figures: dict[str, Any] = {
        "frames": [f.name for f in frames],
        "psnr": round(psnr_of_mse(float(np.mean(errors))), 3),
        "psnr_by_frame": [round(psnr_of_mse(e), 3) for e in errors],
        "ssim": round(float(np.mean(similarities)), 4),
        "label_error": round(1 - float(np.trace(confusion)) / max(1, int(confusion.sum())), 5),
    }
    return figures | class_iou(confusion, scene.labels.names)

"""Rows that inpaint the 3D scene by others' ideas: SPIn-NeRF and Infusion, with surfels in the place of their fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress
from unveil_core.base.types import Mask, Picture
from unveil_core.bench.rows.footage import Footage, Splats, deliver, fill_around, look, open_splats
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.depth import complete_depth
from unveil_core.inpaint.frames.seed import seed_pixels
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, ReoptimizeSettings, reoptimize
from unveil_core.raster.picture import render_numpy
from unveil_core.remove.selection import near_removed
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["infusion", "spin_nerf"]


COVERED = 0.9
"""Of a hole's pixels those get new surfels whose alpha is less: half-covered ones show holes as soon as the view comes nearer."""


@dataclass(frozen=True)
class SpinNerfSettings:
    """Attributes:
    steps: as a multiple of the pipeline's re-optimization; four times as many lose 0.7 dB on the sample street: labels
        that contradict each other are better not fitted too well.
    depth_weight: of the depth prior beside L1 and D-SSIM.
    """

    steps: float = 1.0
    depth_weight: float = 0.1


@dataclass(frozen=True)
class InfusionSettings:
    """Attributes:
    every: one frame in so many is inpainted.
    steps: as a multiple of the pipeline's re-optimization; half and twice as many lose 0.8 and 0.6 dB on the sample street.
    """

    every: int = 10
    steps: float = 0.5


def spin_nerf(footage: Footage, progress: Progress, settings: SpinNerfSettings | None = None) -> list[Picture]:
    """Mirzaei et al., *SPIn-NeRF: Multiview Segmentation and Perceptual Inpainting with Neural Radiance Fields* (CVPR 2023).

    Each frame's whole object mask is inpainted by the single-image model, independently, and so is its depth; one scene is
    fitted to all of them together. Their field has no shape of its own to begin with, here surfels are seeded on the inpainted
    depth wherever nothing stands. Their perceptual loss inside the masks, which bears labels that contradict each other, needs a
    network; here it is L1 and D-SSIM. Depth is continued smoothly instead of being painted by the model for colours.
    """
    settings = settings or SpinNerfSettings()
    splats = open_splats(footage)
    labels, depths, seeds = [], [], []
    scene = splats.remaining
    for i, frame in enumerate(footage.drive.frames):
        hole = footage.holes[i]
        labels.append(fill_around(footage.single_image, splats.images[i], hole))
        depth = _depth_around(splats, frame.camera, hole)
        depths.append(np.where(hole, depth, 0.0))
        out = render_numpy(scene, frame.camera, near=NEAR_M, far=FAR_M)
        empty = hole & (out["alpha"] <= COVERED)
        if empty.any():
            seeds.append(_seed(splats, frame.camera, labels[i], depth, empty))
            scene = concatenate([splats.remaining, *seeds])
        progress(i + 1, len(labels), "inpainting each frame")
    preset = REOPTIMIZE_PRESETS[footage.settings.quality]
    preset = replace(
        preset,
        iterations=round(settings.steps * preset.iterations),
        weights=replace(preset.weights, depth=settings.depth_weight),
    )
    targets = [(f.camera, label) for f, label in zip(footage.drive.frames, labels, strict=True)]
    scene = _refitted(footage, splats, scene, targets, preset, depths, progress)
    return deliver(footage, splats, _views(footage, splats, scene))


def infusion(footage: Footage, progress: Progress, settings: InfusionSettings | None = None) -> list[Picture]:
    """Liu et al., *Infusion: Inpainting 3D Gaussians via Learning Depth Completion from Diffusion Prior* (2024).

    One frame in ten is a reference: its whole object mask is inpainted by the single-image model; where the scene without the
    objects has nothing, its depth is completed from what is around, its pixels are unprojected, and the new surfels and those near
    by are fitted to the references for a few steps. Several references are unprojected one after the other, each only what the
    ones before have left empty. Their depth completion is a diffusion model; here inverse depth is continued smoothly. What no
    reference shows stays empty, as with them.
    """
    settings = settings or InfusionSettings()
    splats = open_splats(footage)
    frames, scene = footage.drive.frames, splats.remaining
    seeds: list[Surfels] = []
    targets: list[tuple[Camera, Picture]] = []
    chosen = range(0, len(frames), settings.every)
    for done, i in enumerate(chosen):
        camera, hole = frames[i].camera, footage.holes[i]
        filled = fill_around(footage.single_image, splats.images[i], hole)
        targets.append((camera, filled))
        out = render_numpy(scene, camera, near=NEAR_M, far=FAR_M)
        missing = hole & (out["alpha"] <= COVERED)
        if missing.any():
            known = (out["alpha"] > 0.5) & ~missing
            depth = complete_depth(out["depth"], known, missing, np.full(missing.shape, np.inf))
            seeds.append(_seed(splats, camera, filled, depth, missing))
            scene = concatenate([splats.remaining, *seeds])
        progress(done + 1, len(chosen), "inpainting the references")
    if seeds:
        preset = REOPTIMIZE_PRESETS[footage.settings.quality]
        preset = replace(preset, iterations=round(settings.steps * preset.iterations))
        scene = _refitted(footage, splats, scene, targets, preset, None, progress)
    return deliver(footage, splats, _views(footage, splats, scene))


def _refitted(
    footage: Footage,
    splats: Splats,
    scene: Surfels,
    targets: Sequence[tuple[Camera, Picture]],
    settings: ReoptimizeSettings,
    depths: Sequence[NDArray[np.float64]] | None,
    progress: Progress,
) -> Surfels:
    """The scene fitted to targets: what is new, and what is near the removed objects. That beats moving the new ones alone by
    2 dB, and moving everything by 0.5 dB (Infusion on the sample street)."""
    near = near_removed(splats.full, splats.gone, settings.near_m)[~splats.gone]
    movable = np.concatenate([near, np.ones(len(scene) - len(near), dtype=bool)])
    return reoptimize(
        scene,
        movable,
        splats.sky,
        targets,
        settings,
        near=NEAR_M,
        far=FAR_M,
        label_count=len(splats.labels.labels),
        depths=depths,
        seed=footage.settings.seed,
        progress=progress,
    )


def _depth_around(splats: Splats, camera: Camera, hole: Mask) -> NDArray[np.float64]:
    """(H, W) depth of the full scene, continued into the whole mask from around it."""
    out = render_numpy(splats.full, camera, near=NEAR_M, far=FAR_M)
    return complete_depth(out["depth"], out["alpha"] > 0.5, hole, np.full(hole.shape, np.inf))


def _seed(splats: Splats, camera: Camera, color: Picture, depth: NDArray[np.float64], mask: Mask) -> Surfels:
    """A surfel per pixel of a mask. Labels play no part in what these rows optimize."""
    label = np.zeros(mask.shape, np.int64)
    return seed_pixels(camera, color, depth, label, mask, sh_degree=splats.remaining.sh_degree)


def _views(footage: Footage, splats: Splats, scene: Surfels) -> list[Picture]:
    return [look(scene, splats.sky, f.camera)[0] for f in footage.drive.frames]

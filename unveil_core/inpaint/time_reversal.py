"""Inpainting along the drive, in reversed time: the last frame first, each unobserved place invented once, then carried to earlier
frames.

*3D StreetUnveiler*, section 3.3. A forward drive sees a place last from nearest, so going back in time meets it first at
its best resolution. What is invented becomes surfels on the completed depth; an earlier frame renders them and invents only
what is still empty. The ground is not invented here: it comes from the street chart, the same for all frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.by_reference import Carrier, ReferenceInpainter
from unveil_core.inpaint.ground_layer import GroundLayer
from unveil_core.inpaint.single_image import SingleImageInpainter, fill_around
from unveil_core.inpaint.transfer import complete_depth, render_numpy, seed_pixels
from unveil_core.progress import Progress, no_progress
from unveil_core.raster import render
from unveil_core.remove.regions import grow
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["FrameTask", "Painted", "paint_along"]


SOLID = 0.6
"""A pixel of the empty scene with more alpha than this shows a surface."""
RING_PX = 14
"""How far around the mask the photograph's own ground is compared with the chart."""
FINE_TEXELS = 4.0
"""A pixel that covers more of the chart along the street starts to be taken from it."""
BORDER_PX = 2
KNEE_SHARE = 0.28
"""Height of a knee as a share of the camera's height over the ground."""


@dataclass(frozen=True, eq=False)
class FrameTask:
    """One frame to clean.

    Attributes:
        camera: its camera; image: (H, W, 3) uint8 as photographed.
        removed: (H, W) bool, pixels of removed objects with their borders.
        unobserved: (H, W) bool, of them those that nobody saw.
    """

    camera: Camera
    image: NDArray[np.uint8]
    removed: NDArray[np.bool_]
    unobserved: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Painted:
    """A cleaned frame.

    Attributes:
        image: (H, W, 3) uint8: the photograph outside, the empty street inside the removed region.
        ground: (H, W) bool, pixels inside that come from the street chart.
        invented: (H, W) bool, pixels that this frame invented itself.
        shadow: (H, W) bool, pixels outside ``removed`` from which a removed object's shadow was taken.
    """

    image: NDArray[np.uint8]
    ground: NDArray[np.bool_]
    invented: NDArray[np.bool_]
    shadow: NDArray[np.bool_]


def paint_along(
    tasks: Sequence[FrameTask],
    left: Surfels,
    sky: Sky,
    layer: GroundLayer | None,
    single_image: SingleImageInpainter,
    *,
    label_count: int,
    near: float,
    far: float,
    order: str = "reverse",
    keyframe_px: int = 40,
    reference: ReferenceInpainter | None = None,
    progress: Progress = no_progress,
) -> tuple[list[Painted], Surfels | None]:
    """Clean all frames, one after another.

    Args:
        tasks: frames in order of time.
        left: the scene without the removed surfels.
        sky: its sky.
        layer: the ground, or None where the scene has none.
        single_image: invents what nobody saw and is not ground.
        label_count: K; near, far: world units.
        order: "reverse", the paper's; "forward", first frame first, or "independent", each frame for itself, for comparison.
        keyframe_px: a frame that must invent fewer pixels than this does so for itself only, without surfels.
        reference: paints what a frame before in the order has invented, by that frame; the surfels alone carry it by default.
    Returns:
        one :class:`Painted` per task, in their order, and the surfels of what was invented beside the ground.
    """
    painted: list[Painted | None] = [None] * len(tasks)
    seeds: list[Surfels] = []
    scene = left
    carrier = Carrier(reference) if reference is not None and order != "independent" else None
    turns = range(len(tasks))
    for done, index in enumerate(turns if order == "forward" else reversed(turns)):
        task = tasks[index]
        if order == "independent":
            scene = left
        out = render_numpy(scene, task.camera, near=near, far=far)
        background = sky.render(task.camera).numpy()
        # A half-covered pixel in the removed region lacks surfels; it is no window to the sky.
        solid = out["alpha"] > SOLID
        share = np.where(solid, np.maximum(out["alpha"], SOLID), 1.0)[..., None]
        fill = np.where(solid[..., None], out["rgb"] / share, out["rgb"] + (1 - out["alpha"])[..., None] * background)
        ground = np.zeros_like(task.removed)
        shadow = np.zeros_like(task.removed)
        gain = np.ones_like(fill)
        original = task.image.astype(np.float32) / 255
        ceiling = np.full(task.removed.shape, np.inf)
        if layer is not None:
            ring = grow(task.removed, RING_PX) & ~grow(task.removed, 2)
            look = layer.look(task.camera, task.removed | ring | grow(layer.shadow_pixels(task.camera), BORDER_PX))
            ceiling = look.depth
            # Lower than a knee above the ground nothing is left that stands on the street: what renders there is the
            # underside of what went. Along a ray, height grows linearly from the ground point to the camera.
            in_front = (out["alpha"] > 0.5) & (out["depth"] < (1 - KNEE_SHARE) * look.depth)
            ground = look.covered & ~in_front & task.removed
            plain = ring & look.covered & ~in_front & ~look.shadow & _shows_ground(look.depth, out)
            fill[ground] = look.color[ground] + _tint(original, look.color, plain)
            on_ground = look.replaced | _shows_ground(look.depth, out)
            # A pixel's misplacement, and the penumbra, leave a dark rim around what the chart calls shadow.
            shadow = grow(look.shadow, BORDER_PX) & look.covered & ~in_front & ~task.removed & on_ground
            gain[shadow] = look.gain[shadow]
            over = shadow & look.replaced
            original[over] = look.color[over]
            gain[over] = 1.0  # the chart shows it lit already
        relit = np.clip(original * gain, 0, 1)
        if layer is not None and shadow.any():
            # A pixel far off mixes shadow and light along the street; the chart, read from nearby, does not.
            distant = np.clip((look.extent[shadow] - FINE_TEXELS) / FINE_TEXELS, 0, 1)[:, None]
            held = _held(relit[shadow], look.color[shadow])
            relit[shadow] = held * (1 - distant) + look.color[shadow] * distant
        image = np.where(task.removed[..., None], fill, relit)
        image8 = np.clip(np.round(image * 255), 0, 255).astype(np.uint8)
        # Where surfels carried from a later frame cover the hole, it is no hole any more.
        below = task.camera.rays() @ layer.chart.ground.path.axes[2] < 0 if layer is not None else task.unobserved
        # The mask's border, beyond the object's own pixels, shows what lies beside them.
        unseen = grow(task.unobserved, 3) & task.removed
        empty = (unseen | (task.removed & below)) & ~ground & ~solid
        depth = None
        rest = empty
        if carrier is not None:
            depth = complete_depth(out["depth"], out["alpha"] > 0.5, empty, ceiling)
            # What surfels carry here from another frame is a hole as well, to be painted by that frame.
            bare = render_numpy(left, task.camera, near=near, far=far)["alpha"] > SOLID if seeds else solid
            hole = (unseen | (task.removed & below)) & ~ground & ~bare
            image8, carried = carrier.paint(task.camera, image8, hole, depth)
            rest = empty & ~carried
        if rest.any():
            image8 = fill_around(single_image, image8, rest)
        if int(empty.sum()) >= keyframe_px:
            if depth is None:
                depth = complete_depth(out["depth"], out["alpha"] > 0.5, empty, ceiling)
            label = _nearest_label(scene, task.camera, empty, label_count, near, far)
            seeds.append(seed_pixels(task.camera, image8, depth, label, empty, sh_degree=left.sh_degree))
            scene = concatenate([left, *seeds])
            if carrier is not None:
                carrier.remember(task.camera, image8, depth)
        painted[index] = Painted(image8, ground, empty, shadow)
        progress(done + 1, len(tasks), "inpainting" if order != "reverse" else "inpainting, last frame first")
    return [p for p in painted if p is not None], concatenate(seeds) if seeds else None


def _tint(original: NDArray[np.float32], chart: NDArray[np.float32], plain: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(3,) what has to be added to the chart's colours to meet this photograph's beside its holes: exposure and white
    balance change from frame to frame. One value a frame; local differences are shade, which must not be dragged in."""
    if plain.sum() < 30:
        return np.zeros(3, dtype=np.float32)
    tint: NDArray[np.float32] = np.median((original - chart)[plain], axis=0).clip(-0.15, 0.15).astype(np.float32)
    # Less than this is shade and texture, not exposure.
    return tint if float(np.abs(tint).max()) > 0.05 else np.zeros(3, dtype=np.float32)


def _held(relit: NDArray[np.float32], chart: NDArray[np.float32]) -> NDArray[np.float32]:
    """Relit colours (N, 3), kept near the chart's: along a shadow's border a pixel's misplacement would brighten what is
    lit already, or leave what is dark."""
    level, relit_level = chart.mean(axis=1, keepdims=True), relit.mean(axis=1, keepdims=True)
    share = np.clip(relit_level, 0, 1.08 * level + 0.02) / np.maximum(relit_level, 1e-3)
    held: NDArray[np.float32] = np.where(relit_level < 0.9 * level, chart, relit * share).astype(np.float32)
    return held


def _shows_ground(ground_depth: NDArray[np.float64], out: dict[str, NDArray[np.float32]]) -> NDArray[np.bool_]:
    """Pixels where the scene itself shows the ground: nothing relights a wall behind it."""
    return np.isfinite(ground_depth) & (np.abs(out["depth"] - ground_depth) < 0.2 * ground_depth)


def _nearest_label(
    scene: Surfels, camera: Camera, mask: NDArray[np.bool_], label_count: int, near: float, far: float
) -> NDArray[np.int64]:
    """(H, W) the rendered label, continued into ``mask`` from the nearest pixel outside."""
    with torch.no_grad():
        out = render(scene, camera, ("alpha", "semantics"), label_count=label_count, near=near, far=far)
    assert out.semantics is not None and out.alpha is not None
    label = out.semantics.argmax(dim=2).numpy()
    unknown = grow(mask, 1) | (out.alpha.numpy() < 0.5)
    if unknown.all():
        return np.zeros(mask.shape, dtype=np.int64)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return label[nearest[0], nearest[1]].astype(np.int64)

"""Inpainting along the drive, in reversed time: keyframes, last to first, invent each unobserved place once, for all frames.

*3D StreetUnveiler*, section 3.3. A forward drive sees a place last from nearest, so going back in time meets it first at
its best resolution. What is invented becomes surfels on the completed depth; all other frames render them and invent only
what is still empty. The ground is not invented here: it comes from the street chart, the same for all frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from unveil_core.base.progress import Progress, no_progress
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import area_px, border_px, grow, within
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.frames.by_reference import Carrier, ReferenceInpainter
from unveil_core.inpaint.frames.holes import SOLID, Behind, FrameTask, hole_in_frame, look_behind, missing_depth
from unveil_core.inpaint.frames.keyframes import Plan
from unveil_core.inpaint.frames.seed import seed_pixels
from unveil_core.inpaint.single_image.registry import SingleImageInpainter, fill_around
from unveil_core.raster import render
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Painted", "paint_along", "tint"]


RING_PX = 14
"""How far around the mask the photograph's own ground is compared with the chart, pixels at 384, in proportion in wider images."""
LEAST_RING_PX = 30
"""Fewer pixels of it, at 384x256, say nothing."""
TINT = 0.05
"""A photograph may differ so much from the chart by shade and texture alone; from there on it counts as exposure, in full at
twice as much. Levels from 0 to 1."""
FINE_TEXELS = 4.0
"""A pixel that covers more of the chart along the street starts to be taken from it."""
STEEP = 0.1
"""Where a gain changes by a larger share within a border's width, the border of a shadow lies."""


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
    plan: Plan | None,
    label_count: int,
    near: float,
    far: float,
    least_px: int = 40,
    reference: ReferenceInpainter | None = None,
    progress: Progress = no_progress,
) -> tuple[list[Painted], Surfels | None]:
    """Clean all frames: keyframes invent, in the order of their plan; then all others take that over.

    Args:
        tasks: frames.
        left: the scene without the removed surfels.
        sky: its sky.
        layer: the ground, or None where the scene has none.
        single_image: invents what nobody saw and is not ground.
        plan: which frames invent for all others; None = each frame for itself, for comparison.
        label_count: K; near, far: metres.
        least_px: a frame that is no keyframe puts no fewer invented pixels than this into the scene; at 384x256, in
            proportion in larger images.
        reference: paints what another frame has invented, by that frame; the surfels alone carry it by default.
    Returns:
        one :class:`Painted` per task, in their order, and the surfels of what was invented beside the ground.
    """
    carrier = Carrier(reference) if reference is not None and plan is not None else None
    view = _View(left, sky, layer, single_image, carrier, label_count, near, far)
    painted: list[Painted | None] = [None] * len(tasks)
    seeds: list[Surfels] = []
    if plan is None:
        for done, index in enumerate(reversed(range(len(tasks)))):
            painted[index], own = view.paint(tasks[index], left, least_px=least_px)
            seeds += own
            progress(done + 1, len(tasks), "inpainting")
        return [p for p in painted if p is not None], concatenate(seeds) if seeds else None
    scene = left
    total = len(plan.keyframes) + len(tasks)
    for done, key in enumerate(plan.keyframes):
        painted[key.frame], own = view.paint(tasks[key.frame], scene, key.leaves, least_px=1)
        if own:
            seeds += own
            scene = concatenate([left, *seeds])
        progress(done + 1, total, "inpainting keyframes")
    whole = {k.frame for k in plan.keyframes if not k.leaves.any()}
    for done, index in enumerate(plan.turns):
        first = painted[index]
        if index not in whole or first is None:
            # What no keyframe shows is little, unless the user chose them; then it, too, is invented once.
            again, own = view.paint(tasks[index], scene, least_px=least_px)
            painted[index] = again if first is None else _over(first, again)
            if own:
                seeds += own
                scene = concatenate([left, *seeds])
        progress(len(plan.keyframes) + done + 1, total, "inpainting")
    return [p for p in painted if p is not None], concatenate(seeds) if seeds else None


def _over(first: Painted, again: Painted) -> Painted:
    """A keyframe that left places to others: what it invented itself, over what it takes from them."""
    own = first.invented
    return replace(again, image=np.where(own[..., None], first.image, again.image), invented=own | again.invented)


@dataclass(frozen=True, eq=False)
class _View:
    """What stays the same from frame to frame, see :func:`paint_along`."""

    left: Surfels
    sky: Sky
    layer: GroundLayer | None
    single_image: SingleImageInpainter
    carrier: Carrier | None
    label_count: int
    near: float
    far: float

    def paint(
        self, task: FrameTask, scene: Surfels, leaves: NDArray[np.bool_] | None = None, *, least_px: int
    ) -> tuple[Painted, list[Surfels]]:
        """Clean one frame.

        Args:
            scene: without the removed, with what was invented so far.
            leaves: (H, W) pixels of the hole that are to be invented by another frame.
            least_px: invented pixels become surfels if they are so many, see :func:`paint_along`.
        Returns:
            the frame, and the surfels of what it invented.
        """
        image, shadow, behind = self._known(task, scene)
        empty = hole_in_frame(task, behind)
        own = empty if leaves is None else empty & ~leaves
        seeds: list[Surfels] = []
        depth = None
        rest = empty
        if self.carrier is not None:
            depth = missing_depth(behind, empty)
            # What surfels carry here from another frame is a hole as well, to be painted by that frame.
            image, carried = self.carrier.paint(task.camera, image, self._bare_hole(task), depth)
            rest = empty & ~carried
        if own.any():
            image = fill_around(self.single_image, image, rest)
            if int(own.sum()) >= area_px(own.shape, least_px):
                depth = missing_depth(behind, empty) if depth is None else depth
                label = _nearest_label(scene, task.camera, empty, self.label_count, self.near, self.far)
                seeds = [seed_pixels(task.camera, image, depth, label, own, sh_degree=self.left.sh_degree)]
                if self.carrier is not None:
                    self.carrier.remember(task.camera, image, depth)
        return Painted(image, behind.ground, own, shadow), seeds

    def _bare_hole(self, task: FrameTask) -> NDArray[np.bool_]:
        """(H, W) the hole as it is before anything is invented."""
        return hole_in_frame(task, look_behind(task, self.left, self.layer, None, near=self.near, far=self.far))

    def _known(self, task: FrameTask, scene: Surfels) -> tuple[NDArray[np.uint8], NDArray[np.bool_], Behind]:
        """The frame with what the scene and the chart know (H, W, 3) uint8, the shadows taken from it, what lies behind."""
        layer = self.layer
        border = border_px(task.camera.width)
        ring = within(task.removed, RING_PX * max(1.0, task.camera.width / 384)) & ~grow(task.removed, border)
        around = None if layer is None else ring | grow(layer.shadow_pixels(task.camera), border)
        behind = look_behind(task, scene, layer, around, near=self.near, far=self.far)
        out, solid, ground = behind.out, behind.solid, behind.ground
        background = self.sky.render(task.camera).numpy()
        share = np.where(solid, np.maximum(out["alpha"], SOLID), 1.0)[..., None]
        fill = np.where(solid[..., None], out["rgb"] / share, out["rgb"] + (1 - out["alpha"])[..., None] * background)
        shadow = np.zeros_like(task.removed)
        gain = np.ones_like(fill)
        original = task.image.astype(np.float32) / 255
        look = behind.look
        if look is not None:
            plain = ring & look.covered & ~behind.in_front & ~look.shadow & _shows_ground(look.depth, out)
            fill[ground] = look.color[ground] + tint(original, look.color, plain)
            on_ground = look.replaced | _shows_ground(look.depth, out)
            # A pixel's misplacement, and the penumbra, leave a dark rim around what the chart calls shadow.
            shadow = grow(look.shadow, border) & look.covered & ~behind.in_front & ~task.removed & on_ground
            if task.stands is not None:
                shadow &= ~task.stands  # the foot of a car that stays lies hardly before the ground
            gain[shadow] = look.gain[shadow]
            over = shadow & look.replaced
            original[over] = look.color[over]
            gain[over] = 1.0  # the chart shows it lit already
        relit = np.clip(original * gain, 0, 1)
        if look is not None and shadow.any():
            # A pixel far off mixes shadow and light along the street; the chart, read from nearby, does not.
            distant = np.clip((look.extent[shadow] - FINE_TEXELS) / FINE_TEXELS, 0, 1)
            # Nor does it show the penumbra, which no two views have in the same pixel: relit, it would be an outline.
            distant = np.maximum(distant, _steep(look.gain, border)[shadow])[:, None]
            held = _held(relit[shadow], look.color[shadow])
            relit[shadow] = held * (1 - distant) + look.color[shadow] * distant
        image = np.where(task.removed[..., None], fill, relit)
        return np.clip(np.round(image * 255), 0, 255).astype(np.uint8), shadow, behind


def tint(original: NDArray[np.float32], chart: NDArray[np.float32], plain: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(3,) what has to be added to the chart's colours to meet this photograph's beside its holes: exposure and white
    balance change from frame to frame. One value a frame; local differences are shade, which must not be dragged in."""
    if plain.sum() < area_px(plain.shape, LEAST_RING_PX):
        return np.zeros(3, dtype=np.float32)
    tint: NDArray[np.float32] = np.median((original - chart)[plain], axis=0).clip(-0.15, 0.15).astype(np.float32)
    # By degrees: where it was all or nothing, frames on either side of the limit would flicker.
    share = np.clip((np.abs(tint).max() - TINT) / TINT, 0, 1)
    return (share * tint).astype(np.float32)


def _steep(gain: NDArray[np.float32], border: int) -> NDArray[np.float32]:
    """(H, W) 0 to 1, how far the gain (H, W, 3) changes within ``border`` pixels."""
    level = gain.mean(axis=2)
    kernel = np.ones((2 * border + 1,) * 2, np.uint8)
    span = cv2.dilate(level, kernel) / cv2.erode(level, kernel) - 1
    steep: NDArray[np.float32] = cv2.GaussianBlur(np.clip((span - STEEP) / STEEP, 0, 1), (0, 0), 0.7)
    return steep


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

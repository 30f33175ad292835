"""Inpainting in reversed time: keyframes, last to first, invent each unobserved place once, and surfels carry it to all frames.

*3D StreetUnveiler*, section 3.3. A forward drive sees a place last from nearest, so going back in time starts with its best
resolution. What is invented becomes surfels on the completed depth; all other frames render them and invent only what is still
empty. The ground is not invented here: it comes from the chart, the same for all frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from unveil_core.base.mechanisms import on
from unveil_core.base.parallel import each
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.srgb import linear_light, relight
from unveil_core.base.types import Levels
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import area_px, border_px, grow, scale_from_384, within
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.frames.by_reference import ReferenceInpainter, ReferencePropagator
from unveil_core.inpaint.frames.holes import (
    CARRIED_M,
    SOLID,
    BackgroundLayers,
    FrameTask,
    background_layers,
    hole_in_frame,
    missing_depth,
)
from unveil_core.inpaint.frames.keyframes import Plan
from unveil_core.inpaint.frames.layered_fill import fill_in_layers
from unveil_core.inpaint.frames.local_light import in_local_light
from unveil_core.inpaint.frames.seed import seed_pixels
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.inpaint.single_image.onnx_models import OnnxSingleImage
from unveil_core.inpaint.single_image.registry import SingleImageInpainter, exemplar, fill_around
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Painted", "RemainingScene", "propagate_inpainting"]

T = TypeVar("T")

RING_PX = 14
"""Width of the ring around the mask in which the photograph's ground is compared with the chart, pixels at 384, in proportion in
wider images. Chosen on the two sample streets."""
LEAST_SEEDS_PX = 40
"""Fewest invented pixels of a frame that is no keyframe that become surfels, at 384x256. Chosen on the two sample streets."""
FINE_TEXELS = 4.0
"""Length of a pixel's footprint on the ground, texels (0.16 m), from which on relit pixels are taken from the chart, wholly at
twice as much: they mix shadow and light. Chosen on the two sample streets."""
STEEP = 0.23
"""Relative change of the gain within a border's width that makes the border of a shadow. Chosen on the two sample streets."""

DARKER, BRIGHTER, MORE = 0.79, 1.25, 0.003
"""Light of relit pixels, as a share of the chart's, below which they are the chart's own; and the most that they may have, as such
a share and what noise may add to it: a tenth of a code on either side."""
ORIGIN_OF_TEXEL = np.array([ORIGINAL, SEEN_ELSEWHERE, RELIT, CONTINUED], dtype=np.uint8)
"""What a chart's OUTSIDE, OBSERVED, RELIT and INVENTED are in ``inpaint.origin``."""


@dataclass(frozen=True, eq=False)
class Painted:
    """A cleaned frame.

    Attributes:
        image: (H, W, 3) levels of 255, not rounded: the photograph outside, the empty street inside the removed region.
        origin: (H, W) uint8, see ``inpaint.origin``; SEEN_ELSEWHERE for all that surfels show, whatever theirs is.
        invented: (H, W) bool, pixels that this frame invented itself.
        shadow: (H, W) bool, pixels outside ``removed`` from which a removed object's shadow was taken.
    """

    image: Levels
    origin: NDArray[np.uint8]
    invented: NDArray[np.bool_]
    shadow: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class RemainingScene:
    """The scene without the removed objects, before anything is invented frame by frame.

    Attributes:
        surfels: what remains; sky: behind it.
        ground: the filled ground, None where the scene has none.
        label_count: number of labels K.
    """

    surfels: Surfels
    sky: Sky
    ground: GroundLayer | None
    label_count: int


def propagate_inpainting(
    tasks: Sequence[FrameTask],
    scene: RemainingScene,
    single_image: SingleImageInpainter,
    write: Callable[[int, Painted], None],
    *,
    plan: Plan | None,
    reference: ReferenceInpainter | None = None,
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Surfels | None:
    """Clean all frames: keyframes invent, in the order of their plan, and all others take that over.

    Args:
        tasks: frames.
        scene: without the removed objects.
        single_image: invents what nobody saw and is not ground.
        write: gets each frame's index and result, once, when it is done.
        plan: which frames invent for all others; None = each frame for itself, for comparison.
        kept: what each frame invented, so that an interrupted call is continued by the next.
        reference: inpaints what another frame has invented, with that frame as its reference; by default only surfels carry it.
    Returns:
        the surfels of what was invented beside the ground, None where nothing was.
    """
    references = ReferencePropagator(reference) if reference is not None and plan is not None else None
    painter = _Painter(scene, single_image, references)
    # The frames that a network may refer to are not kept.
    kept = Kept() if kept is None or references is not None else kept
    seeds: list[Surfels] = []

    def finish(index: int, paint: Callable[[], tuple[Painted, list[Surfels]]]) -> list[Surfels]:
        """Paint and write a frame, unless that was done before; returns what it invented."""

        def make() -> dict[str, NDArray[Any]]:
            painted, new = paint()
            write(index, painted)
            return _with_seeds({}, new)

        return _seeds_in(kept.once(f"{index:06d}", make))

    if plan is None:
        for done, index in enumerate(reversed(range(len(tasks)))):
            seeds += finish(index, partial(painter.paint, tasks[index], scene.surfels, least_px=LEAST_SEEDS_PX))
            progress(done + 1, len(tasks), "inpainting")
        return concatenate(seeds) if seeds else None
    deferring: dict[int, Painted] = {}
    finished: set[int] = set()
    surfels = scene.surfels
    total = len(plan.keyframes) + len(tasks)
    for done, key in enumerate(plan.keyframes):
        paint = partial(painter.paint, tasks[key.frame], surfels, key.deferred, least_px=1)
        if key.deferred.any():
            deferring[key.frame], new = _kept_whole(kept, f"{key.frame:06d}_deferring", paint)
        else:
            new = finish(key.frame, paint)
            finished.add(key.frame)
        if new:
            seeds += new
            surfels = concatenate([scene.surfels, *seeds])
        progress(done + 1, total, "inpainting keyframes")
    rest = [index for index in plan.visit_order if index not in finished]
    # Networks take memory for each picture at work, and use all cores for one.
    together = references is None and not isinstance(single_image, OnnxSingleImage)
    several = together
    while rest:
        known = partial(painter.paint, surfels=surfels, least_px=LEAST_SEEDS_PX)

        def begin(index: int, known: Callable[..., Any] = known) -> tuple[Painted, list[Surfels]] | None:
            return None if kept.has(f"{index:06d}") else known(tasks[index])

        # What no keyframe shows is little, unless the user chose them; then it, too, is invented once. So most frames do not depend
        # on those before them. Where one does invent, those that were begun after it are begun anew.
        for index, begun in zip(rest, each(begin, rest if several else rest[:1]), strict=False):
            paint = partial(known, tasks[index]) if begun is None else partial(_same, begun)
            first = deferring.pop(index, None)
            new = finish(index, paint if first is None else partial(_painted_over, first, paint))
            rest = rest[1:]
            progress(total - len(rest), total, "inpainting")
            several = together and not new
            if new:
                seeds += new
                surfels = concatenate([scene.surfels, *seeds])
                break
    return concatenate(seeds) if seeds else None


def _same(value: T) -> T:
    return value


def _with_seeds(arrays: dict[str, NDArray[Any]], seeds: list[Surfels]) -> dict[str, NDArray[Any]]:
    """Arrays, and those of what a frame invented."""
    found = {name: array for part in seeds for name, array in part.arrays().items()}
    return {**arrays, **found, "count": np.array(len(seeds))}


def _seeds_in(arrays: dict[str, NDArray[Any]]) -> list[Surfels]:
    return [Surfels.from_arrays(arrays)] if arrays["count"] else []


def _kept_whole(
    kept: Kept, name: str, paint: Callable[[], tuple[Painted, list[Surfels]]]
) -> tuple[Painted, list[Surfels]]:
    """A frame that is not finished yet, with what it invented."""

    def make() -> dict[str, NDArray[Any]]:
        painted, new = paint()
        return _with_seeds({f.name: getattr(painted, f.name) for f in fields(Painted)}, new)

    found = kept.once(name, make)
    return Painted(**{f.name: found[f.name] for f in fields(Painted)}), _seeds_in(found)


def _painted_over(first: Painted, paint: Callable[[], tuple[Painted, list[Surfels]]]) -> tuple[Painted, list[Surfels]]:
    again, new = paint()
    return _over(first, again), new


def _over(first: Painted, again: Painted) -> Painted:
    """A keyframe that deferred places to others: what it invented itself, over what it takes from them."""
    image = np.where(first.invented[..., None], first.image, again.image)
    origin = np.where(first.invented, INVENTED, again.origin).astype(np.uint8)
    return replace(again, image=image, origin=origin, invented=first.invented | again.invented)


@dataclass(frozen=True, eq=False)
class _Painter:
    """What stays the same from frame to frame, see :func:`propagate_inpainting`."""

    scene: RemainingScene
    single_image: SingleImageInpainter
    references: ReferencePropagator | None

    def paint(
        self, task: FrameTask, surfels: Surfels, deferred: NDArray[np.bool_] | None = None, *, least_px: int
    ) -> tuple[Painted, list[Surfels]]:
        """Clean one frame.

        Args:
            surfels: the remaining scene, with what was invented so far.
            deferred: (H, W) pixels of the hole that are to be invented by another frame.
            least_px: invented pixels become surfels if they are so many at 384x256, in proportion in larger images.
        Returns:
            the frame, and the surfels of what it invented.
        """
        image, shadow, background, origin = self._known(task, surfels)
        empty = hole_in_frame(task, background)
        invented = empty if deferred is None else empty & ~deferred
        seeds: list[Surfels] = []
        depth = None
        unpainted = empty
        if self.references is not None:
            depth = missing_depth(task, background, empty)
            # What surfels carry here from another frame is a hole as well, to be painted by that frame.
            image, by_reference = self.references.paint(task.camera, image, self._bare_hole(task), depth)
            origin[by_reference] = INVENTED
            unpainted = empty & ~by_reference
        # A deferred pixel is painted, too, until its own keyframe's surfels are put over it.
        origin[empty] = INVENTED
        if invented.any():
            depth = missing_depth(task, background, empty) if depth is None else depth
            image = self._invent(task, image, unpainted, background, depth)
            carried = invented & (depth <= CARRIED_M)
            if int(carried.sum()) >= area_px(carried.shape, least_px):
                label = _nearest_label(surfels, task.camera, empty, self.scene.label_count)
                sh_degree = self.scene.surfels.sh_degree
                seeds = [seed_pixels(task.camera, image, depth, label, carried, sh_degree=sh_degree)]
                if self.references is not None:
                    self.references.add(task.camera, image, depth)
        return Painted(image, origin, invented, shadow), seeds

    def _invent(
        self,
        task: FrameTask,
        image: Levels,
        hole: NDArray[np.bool_],
        background: BackgroundLayers,
        depth: NDArray[np.float64],
    ) -> Levels:
        """The frame with a hole filled: in layers where labels and a street tell them; a chosen inpainter fills it as a whole."""
        if (
            not on("layered_fill")
            or self.single_image is not exemplar
            or background.chart is None
            or task.ground is None
        ):
            return fill_around(self.single_image, image, hole)
        ground = task.ground | background.from_chart
        beside = ~(ground | task.removed)
        low = background.below_horizon
        return fill_in_layers(image, hole, depth, ground=ground, beside=beside, below_horizon=low)

    def _bare_hole(self, task: FrameTask) -> NDArray[np.bool_]:
        """(H, W) the hole as it is before anything is invented."""
        return hole_in_frame(task, background_layers(task, self.scene.surfels, self.scene.ground))

    def _known(
        self, task: FrameTask, surfels: Surfels
    ) -> tuple[Levels, NDArray[np.bool_], BackgroundLayers, NDArray[np.uint8]]:
        """The frame (H, W, 3) filled as far as scene and chart know it, the pixels relit (H, W), the background, and where
        each pixel has its colour from (H, W)."""
        layer = self.scene.ground
        border = border_px(task.camera.width)
        ring = within(task.removed, RING_PX * scale_from_384(task.camera.width)) & ~grow(task.removed, border)
        around = None if layer is None else ring | grow(layer.shadow_pixels(task.camera), border)
        background = background_layers(task, surfels, layer, around)
        out, solid, from_chart = background.rendered, background.solid, background.from_chart
        sky = self.scene.sky.render(task.camera).numpy()
        share = np.where(solid, np.maximum(out["alpha"], SOLID), 1.0)[..., None]
        fill = np.where(solid[..., None], out["rgb"] / share, out["rgb"] + (1 - out["alpha"])[..., None] * sky)
        shadow = np.zeros_like(task.removed)
        gain = np.ones_like(fill)
        original = task.image.astype(np.float32) / 255
        origin = np.where(task.removed, SEEN_ELSEWHERE, ORIGINAL).astype(np.uint8)
        ground = background.chart
        if ground is not None:
            origin[from_chart] = ORIGIN_OF_TEXEL[ground.source[from_chart]]
            plain = ring & ground.covered & ~background.in_front & ~ground.shadow & _shows_ground(ground.depth, out)
            plain &= True if task.ground is None else task.ground
            if on("local_light"):
                ground = replace(ground, color=in_local_light(task.image, ground.color, ground.covered, plain))
            fill[from_chart] = ground.color[from_chart]
            on_ground = ground.replaced | _shows_ground(ground.depth, out)
            # A pixel's misplacement, and the penumbra, leave a dark rim around what the chart calls shadow.
            shadow = grow(ground.shadow, border) & ground.covered & ~background.in_front & ~task.removed & on_ground
            # What lies before ground that no frame shows is mixed with the object right beside it; else it is something that stands
            # there, and stays.
            shadow &= ~ground.unseen | within(task.removed, 2 * border)
            if task.kept is not None:
                shadow &= ~task.kept  # the foot of a car that stays lies hardly before the ground
            gain[shadow] = ground.gain[shadow]
            over = shadow & ground.replaced
            original[over] = ground.color[over]
            gain[over] = 1.0  # the chart shows it lit already
            origin[shadow] = np.where(over[shadow], CONTINUED, RELIT)
        relit = original.copy()
        relit[shadow] = relight(original[shadow], gain[shadow])
        if ground is not None and shadow.any() and on("distant_from_chart"):
            # A pixel far off mixes shadow and light along the street; the chart, read from nearby, does not.
            distant = np.clip((ground.extent[shadow] - FINE_TEXELS) / FINE_TEXELS, 0, 1)
            # Nor does it show the penumbra, which no two views have in the same pixel: relit, it would be an outline.
            distant = np.maximum(distant, _steep(ground.gain, border)[shadow])[:, None]
            held = _held(relit[shadow], ground.color[shadow])  # type: ignore[arg-type]
            relit[shadow] = held * (1 - distant) + ground.color[shadow] * distant
        image = np.where(task.removed[..., None], fill, relit)
        return (255 * image).astype(np.float32), shadow, background, origin


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
    level, relit_level = (linear_light(color).mean(axis=1, keepdims=True) for color in (chart, relit))
    share = np.clip(relit_level, 0, BRIGHTER * level + MORE) / np.maximum(relit_level, 1e-6)
    held: NDArray[np.float32] = np.where(relit_level < DARKER * level, chart, relight(relit, share)).astype(np.float32)
    return held


def _shows_ground(ground_depth: NDArray[np.float64], out: dict[str, NDArray[np.float32]]) -> NDArray[np.bool_]:
    """Pixels where the scene itself shows the ground: nothing relights a wall behind it."""
    return np.isfinite(ground_depth) & (np.abs(out["depth"] - ground_depth) < 0.2 * ground_depth)


def _nearest_label(scene: Surfels, camera: Camera, mask: NDArray[np.bool_], label_count: int) -> NDArray[np.int64]:
    """(H, W) the rendered label, continued into ``mask`` from the nearest pixel outside."""
    scene = near_camera(scene, camera)
    out = rendered(scene, camera, ("alpha", "semantics"), label_count=label_count, near=NEAR_M, far=FAR_M)
    assert out.semantics is not None
    label = array(out.semantics.argmax(dim=2))
    unknown = grow(mask, 1) | (array(out.alpha) < 0.5)
    if unknown.all():
        return np.zeros(mask.shape, dtype=np.int64)
    nearest = distance_transform_edt(unknown, return_distances=False, return_indices=True)
    return label[nearest[0], nearest[1]].astype(np.int64)

"""An object of a few clicks in all frames: its points are carried there, and what the frames show mends the points. Where they do
not tell its shape its outline is followed instead."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive
from unveil_core.marking.asked.prompts import Prompts
from unveil_core.marking.following import followed
from unveil_core.marking.outline import Outliner
from unveil_core.marking.seeds import seeds_of
from unveil_core.marking.space.clustering import first_points
from unveil_core.marking.space.scene_points import ScenePoints

__all__ = ["carried"]

FEWEST_POINTS = 25
"""Fewer points on an object do not tell its shape."""
WITHIN = 0.9
"""Of what a person says is the object's, so much lies within the outline of its points where these tell its shape. Photographs show
no point on plain paint and panes."""


def carried(
    drive: Drive,
    image: Callable[[int], NDArray[np.uint8]],
    points: ScenePoints,
    prompts: Prompts,
    outline: Outliner,
    progress: Progress = no_progress,
) -> Sequence[Mask]:
    """(H, W) per frame, the pixels of an object.

    Args:
        drive: imported; points: of its scene.
        image: gives the photograph (H, W, 3) of a frame, by its index.
        prompts: what the person says of the object.
        outline: gives the pixels (H, W) of an object in a frame, by its index, by what geometry and the person say of it there.
    """
    own = first_points(drive, points, prompts)
    told = _tell_its_shape(drive, points, own, prompts)
    if not points.measured or not told:
        count = iter(range(1, len(drive.frames) * (1 + len(prompts.frames))))

        def one_more() -> None:
            progress(min(next(count), len(drive.frames)), len(drive.frames), f"outlining {prompts.name}")

        return followed(drive, image, points, prompts, outline, own if told else None, one_more)
    found = []
    for v, frame in enumerate(drive.frames):
        seeds = seeds_of(frame.camera, points, own, points.views[v]) if own.any() else None
        found.append(outline(v, seeds, prompts.frames.get(v)))
        progress(v + 1, len(drive.frames), f"outlining {prompts.name}")
    return found


def _tell_its_shape(drive: Drive, points: ScenePoints, own: Mask, prompts: Prompts) -> bool:
    """Whether points (P,) of an object lie all over it, as far as a person says where it is."""
    if own.sum() < FEWEST_POINTS:
        return False
    said = known = 0
    for v, prompt in prompts.frames.items():
        camera = drive.frames[v].camera
        pixels = prompt.own((camera.height, camera.width))
        seeds = seeds_of(camera, points, own, points.views[v])
        said += int(pixels.sum())
        if seeds is not None:
            known += int(pixels[seeds.window][seeds.likely | seeds.sure].sum())
    return known >= WITHIN * said

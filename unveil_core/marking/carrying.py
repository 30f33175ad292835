"""An object of a few clicks in all frames: its points are carried there, and what the frames show mends the points."""

from __future__ import annotations

from collections.abc import Sequence

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive
from unveil_core.marking.asked.prompts import Prompts
from unveil_core.marking.outline import Outliner
from unveil_core.marking.seeds import seeds_of
from unveil_core.marking.space.clustering import first_points
from unveil_core.marking.space.scene_points import ScenePoints
from unveil_core.marking.standing import carried_standing

__all__ = ["carried"]

FEWEST_POINTS = 25
"""Fewer points on an object do not tell its shape."""


def carried(
    drive: Drive,
    points: ScenePoints,
    prompts: Prompts,
    outline: Outliner,
    progress: Progress = no_progress,
) -> Sequence[Mask]:
    """(H, W) per frame, the pixels of an object.

    Args:
        drive: imported; points: of its scene.
        prompts: what the person says of the object.
        outline: gives the pixels (H, W) of an object in a frame, by its index, by what geometry and the person say of it there.
    """
    own = first_points(drive, points, prompts)
    if own.sum() < FEWEST_POINTS:
        return carried_standing(drive, points, prompts, outline, own)
    found = []
    for v, frame in enumerate(drive.frames):
        seeds = seeds_of(frame.camera, points, own, points.views[v]) if own.any() else None
        found.append(outline(v, seeds, prompts.frames.get(v)))
        progress(v + 1, len(drive.frames), f"outlining {prompts.name}")
    return found

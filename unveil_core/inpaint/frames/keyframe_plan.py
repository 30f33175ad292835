"""The keyframes of a drive: those that the user names, and the record of the plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.parallel import each
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept, facts_array, facts_of
from unveil_core.drives.drive import Frame, instants
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import mask_bits, mask_of_bits
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.frames.holes import FrameTask, Hole, open_hole
from unveil_core.inpaint.frames.keyframes import Keyframe, Plan, plan_keyframes
from unveil_core.surfels.surfels import Surfels

__all__ = ["plan_drive", "plan_json", "plans_json"]


def plan_drive(
    frames: Sequence[Frame],
    tasks: Sequence[FrameTask],
    remaining: Surfels,
    layer: GroundLayer | None,
    *,
    order: str,
    names: Sequence[int] | None = None,
    cache: FrameCache,
    scratch: Path,
    progress: Progress = no_progress,
) -> Plan | None:
    """The keyframes of a drive, see :func:`unveil_core.inpaint.frames.keyframes.plan_keyframes`.

    Args:
        frames, tasks: as many, in the same order.
        remaining: the scene without the removed; layer: its ground, or None.
        order: "reverse", "forward", or "independent", which has no plan.
        names: indices of the user's keyframes; None = chosen here.
        cache: room for the frames; scratch: folder for their holes.
    """
    if order == "independent":
        return None

    def find(i: int) -> tuple[NDArray[Any], ...]:
        hole = open_hole(tasks[i], remaining, layer)
        return mask_bits(hole.mask), hole.depth

    stored = cache.stored(scratch, len(tasks), find)
    for done, _ in enumerate(each(stored.__getitem__, range(len(tasks)))):
        progress(done + 1, len(tasks), "choosing keyframes")
    holes = Frames(len(tasks), lambda i: _hole(frames[i].camera, *stored[i]))
    kept = Kept(scratch)

    def make() -> dict[str, NDArray[Any]]:
        return _plan_arrays(plan_keyframes(holes, instants(frames), order=order, given=names, kept=kept))

    return _plan_of(kept.once("plan", make), [frame.camera for frame in frames])


def _plan_arrays(plan: Plan) -> dict[str, NDArray[Any]]:
    facts = {
        "keyframes": [(k.frame, k.area, k.pixels) for k in plan.keyframes],
        "visit_order": plan.visit_order,
    }
    deferred = {f"deferred.{k.frame}": mask_bits(k.deferred) for k in plan.keyframes}
    return {"facts": facts_array(facts), "remaining": plan.remaining, **deferred}


def _plan_of(arrays: Mapping[str, NDArray[Any]], cameras: Sequence[Camera]) -> Plan:
    """Inverse of :func:`_plan_arrays`; ``cameras``: of all frames."""
    facts = facts_of(arrays["facts"])
    keyframes = [
        Keyframe(i, area, pixels, mask_of_bits(arrays[f"deferred.{i}"], (cameras[i].height, cameras[i].width)))
        for i, area, pixels in facts["keyframes"]
    ]
    return Plan(tuple(keyframes), tuple(facts["visit_order"]), arrays["remaining"])


def _hole(camera: Camera, mask: NDArray[np.uint8], depth: NDArray[np.float64]) -> Hole:
    """A hole as it was stored: its pixels as bits, and their depth."""
    return Hole(camera, mask_of_bits(mask, (camera.height, camera.width)), depth)


def plan_json(plan: Plan, frames: Sequence[Frame]) -> dict[str, object]:
    """A plan's keyframes by name in the order in which they invent, and what each newly showed.

    Args:
        frames: those that were planned.
    """
    return {
        "keyframes": [
            {
                "camera": frames[k.frame].camera_name,
                "frame": frames[k.frame].name,
                "newly_shown_m2": round(k.area, 3),
                "newly_shown_px": k.pixels,
                "deferred_to_sharper_px": int(k.deferred.sum()),
            }
            for k in plan.keyframes
        ],
        "remaining_px": int(plan.remaining.sum()),
    }


def plans_json(plans: Sequence[dict[str, Any]], *, order: str, given: bool) -> dict[str, object]:
    """The plans of all blocks (see :func:`plan_json`), in the order in which they were cleaned, as one."""
    return {
        "order": order,
        "chosen": "given" if given else "auto",
        "keyframes": [keyframe for plan in plans for keyframe in plan["keyframes"]],
        "remaining_px": sum(plan["remaining_px"] for plan in plans) if plans else None,
    }

"""The empty street of a drive: the ground first, then what stands beside it, then what is left, frame by frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.street import Ground
from unveil_core.inpaint.by_stretch import FilledStreet, StreetFill
from unveil_core.inpaint.cleaning import Cleaning, How, Room
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene
from unveil_core.inpaint.light.sun import given_sun
from unveil_core.inpaint.origin import CONTINUED, INVENTED
from unveil_core.inpaint.renewed_ground import renew_ground
from unveil_core.inpaint.street_scene import Given
from unveil_core.inpaint.stretches import Stretch, cut_street
from unveil_core.inpaint.upright import Completed, complete_upright
from unveil_core.surfels.scene_edit import SceneEdit
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Emptied", "empty_the_street"]


@dataclass(frozen=True, eq=False)
class Emptied:
    """What became of a drive.

    Attributes:
        edit: of its scene; filled: its street, None where there is none.
        completed: what stands beside the street, without its surfels, None likewise.
        keyframes: as they are recorded.
    """

    edit: SceneEdit
    filled: FilledStreet | None
    completed: Completed | None
    keyframes: dict[str, object]


def empty_the_street(
    given: Given, ground: Ground | None, how: How, room: Room, write: Callable[[int, Painted], None]
) -> Emptied:
    """Fill what the removed objects of a drive hid.

    Args:
        given: what is known of the drive; ground: its street's, None where all is to be invented in the images.
        how: what the user decides; room: where work is kept.
        write: takes each frame's number and what was painted, once.
    """
    drive, edit, surfels = given.drive, given.edit, given.removal.surfels
    blocks = cut_into_blocks(drive)
    filled: FilledStreet | None = None
    completed: Completed | None = None
    stretches: list[Stretch] = []
    parts: list[Surfels] = []
    added: list[Surfels] = []
    if ground is not None:
        cameras = [f.camera for f in drive.frames]
        stretches = cut_street(ground, blocks, cameras, surfels.means.double().numpy()[edit.removed])
        kept = room.kept.within("street")
        street = StreetFill(
            drive,
            given.scene,
            ground,
            given.removal,
            given.views,
            stretches,
            cache=room.cache,
            kept=kept,
            progress=room.progress,
        )
        sun = street.find_sun() if how.sun is None else given_sun(*how.sun)
        filled = street.fill(sun, shadows=how.shadows)
        renewed = renew_ground(filled, spacing_m=how.spacing_m)
        edit, added = replace(edit, displaced=renewed.displaced, relit=renewed.relit), renewed.added
    remaining = edit.apply(surfels)
    if filled is not None:
        completed = complete_upright(filled.street, remaining)
        displaced = edit.displaced.copy()
        displaced[np.flatnonzero(edit.stays)[completed.displaced]] = True
        edit = replace(edit, displaced=displaced)
        remaining = remaining.select(torch.from_numpy(~completed.displaced))
        parts += [] if completed.walls is None else [completed.walls]
    # What follows from the seen part of a house is known before anything is invented.
    counts = [len(part) for part in (remaining, *parts)]
    known = RemainingScene(concatenate([remaining, *parts]), given.sky, None, len(given.scene.labels))
    del remaining
    # The scene of a long drive is not held twice: what completes it is from now on a view of it.
    parts = known.surfels.split(counts)[1:]
    completed = None if completed is None else replace(completed, walls=None)
    curtains = None if completed is None else completed.curtains
    seeds, keyframes = Cleaning(given, known, filled, curtains, how, room, write).run(blocks, stretches)
    origins = [CONTINUED] * len(parts) + [INVENTED] * (seeds is not None) + [CONTINUED] * len(added)
    parts += [*([] if seeds is None else [seeds]), *added]
    if parts:
        origin = np.concatenate([np.full(len(p), o, np.uint8) for p, o in zip(parts, origins, strict=True)])
        edit = replace(edit, added=concatenate(parts), origin=origin)
    return Emptied(edit, filled, completed, keyframes)

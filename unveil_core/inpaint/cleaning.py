"""The frames of a drive cleaned block by block, the last one first: what a block invents, those before it see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.progress import Progress, part_of
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives.selecting import named_frames
from unveil_core.ground.blocks import Block, Blocks
from unveil_core.inpaint.by_stretch import FilledStreet
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.keyframe_plan import plan_drive, plan_json, plans_json
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.inpaint.street_scene import Given
from unveil_core.inpaint.stretches import Stretch
from unveil_core.inpaint.upright import sky_behind
from unveil_core.raster.near_camera import near_cameras
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Cleaning", "How", "Room"]


@dataclass(frozen=True)
class How:
    """What a user decides of inpainting; see ``RunSettings`` for the first four.

    Attributes:
        inpainter, order, keyframes: likewise; reference: file of the network that paints by a reference, None = none.
        sun: azimuth and elevation that were given, degrees; None = it is looked for. shadows: whether these are removed.
        spacing_m: distance of new surfels of the ground, metres.
    """

    inpainter: str
    order: str
    keyframes: tuple[str, ...]
    reference: Path | None
    sun: tuple[float, float] | None
    shadows: bool
    spacing_m: float


@dataclass(frozen=True, eq=False)
class Room:
    """Where work is kept: frames in memory, results for the next attempt, folders by name; and who is told of progress."""

    cache: FrameCache
    kept: Kept
    scratch: Callable[[str], Path]
    progress: Progress


@dataclass(frozen=True, eq=False)
class Cleaning:
    """Attributes:
    given: what is known of the drive; known: the scene before anything is invented, without its ground.
    filled: the street, None where there is none; curtains: surfels over which the sky goes on, None where none does.
    write: takes a frame's number and what was painted, once.
    """

    given: Given
    known: RemainingScene
    filled: FilledStreet | None
    curtains: Surfels | None
    how: How
    room: Room
    write: Callable[[int, Painted], None]

    def run(self, blocks: Blocks, stretches: Sequence[Stretch]) -> tuple[Surfels | None, dict[str, object]]:
        """Clean and write all frames; returns the surfels of what was invented, and the keyframes as they are recorded."""
        seeds: list[Surfels] = []
        plans: list[dict[str, Any]] = []
        for done, block in enumerate(reversed(blocks.blocks)):
            stretch = stretches[block.number] if stretches else None
            progress = part_of(self.room.progress, done, len(blocks.blocks))
            plan, new = self._clean(block, self._known(block, stretch, seeds), progress)
            plans += [] if plan is None else [plan]
            seeds += [] if new is None else [new]
        record = plans_json(plans, order=self.how.order, given=bool(self.how.keyframes))
        return (concatenate(seeds) if seeds else None), record

    def _known(self, block: Block, stretch: Stretch | None, seeds: list[Surfels]) -> RemainingScene:
        """What is known of the scene before a block is cleaned, as far as its frames see; only one block's ground is held at a
        time."""
        cameras = [self.given.drive.frames[i].camera for i in block.own]
        surfels = concatenate([near_cameras(part, cameras) for part in (self.known.surfels, *seeds)])
        ground = None
        if stretch is not None and self.filled is not None:
            ground = GroundLayer(self.filled.seen_from(stretch), self.given.scene.labels.indices(GROUND_CLASSES))
        return replace(self.known, surfels=surfels, ground=ground)

    def _clean(
        self, block: Block, known: RemainingScene, progress: Progress
    ) -> tuple[dict[str, Any] | None, Surfels | None]:
        """Clean a block's frames; returns the record of its keyframes, and the surfels of what was invented."""
        given, room, how = self.given, self.room, self.how
        frames = [given.drive.frames[i] for i in block.own]
        tasks = self._tasks(block)
        plan = plan_drive(
            frames,
            tasks,
            known.surfels,
            known.ground,
            order=how.order,
            names=self._named(block),
            cache=room.cache,
            scratch=room.scratch(f"holes/{block.name}"),
            progress=progress,
        )
        seeds = propagate_inpainting(
            tasks,
            known,
            inpainter(how.inpainter),
            lambda k, painted: self.write(block.own[k], painted),
            plan=plan,
            reference=None if how.reference is None else load_reference(how.reference),
            kept=room.kept.within(f"frames/{block.name}"),
            progress=progress,
        )
        return (None if plan is None else plan_json(plan, frames)), seeds

    def _tasks(self, block: Block) -> Sequence[FrameTask]:
        given, views, cache = self.given, self.given.views, self.room.cache
        cameras = [f.camera for f in given.drive.frames]
        sky = sky_behind(self.curtains, [cameras[i] for i in block.own], cache)
        on_ground = given.scene.labels.indices(GROUND_CLASSES)

        def task(k: int) -> FrameTask:
            i = block.own[k]
            shown = ~views.removed[i]
            return FrameTask(
                cameras[i],
                views.images[i],
                views.removed[i],
                given.unobserved[i],
                np.isin(views.labels[i], given.scene.removable_labels) & shown,
                sky=None if sky is None else sky[k],
                ground=np.isin(views.labels[i], on_ground) & shown,
                light=None if self.filled is None else self.filled.street.light_in(i),
            )

        return Frames(len(block.own), task)

    def _named(self, block: Block) -> tuple[int, ...] | None:
        """The user's keyframes among a block's frames; None where they are chosen here."""
        names = self.how.keyframes
        if not names:
            return None
        every = named_frames(self.given.drive.frames, names)
        return tuple(block.own.index(i) for i in every if i in block.own)

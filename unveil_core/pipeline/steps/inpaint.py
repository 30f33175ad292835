"""Stage ``inpaint``: what the removed objects hid, filled in every frame and as new surfels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.base.progress import Progress, part_of
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.selecting import named_frames
from unveil_core.ground.blocks import Block, Blocks, cut_into_blocks
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.by_stretch import StreetFill
from unveil_core.inpaint.chart.files import save_chart
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M
from unveil_core.inpaint.frames.free_space import FreeSpace
from unveil_core.inpaint.frames.holes import FrameTask
from unveil_core.inpaint.frames.keyframe_plan import plan_drive, plan_json, plans_json
from unveil_core.inpaint.frames.keyframes import Plan
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.inpaint.light.sun import Sun, given_sun
from unveil_core.inpaint.light.view_light import ViewLight
from unveil_core.inpaint.origin import CONTINUED, INVENTED
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.inpaint.street_scene import Removal, Views, drive_views
from unveil_core.inpaint.stretches import Stretch, cut_street
from unveil_core.inpaint.upright import Completed, complete_upright, sky_behind
from unveil_core.optimize.adaptation.colour_degree import seen_from_anywhere
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.raster.near_camera import near_cameras
from unveil_core.remove.reaching import Shortened
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels, concatenate
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import frame_file, load_array, load_mask, load_selection, save_array, save_mask
from unveil_core.workspace.movers import read_moving

__all__ = ["inpaint_with", "run"]

LEAST_FACING = 0.5
"""Share of the surfels of houses above which these are said to be parallel to the street: half of walls that stand in any direction
face it. Only the record depends on it. Of 17 drawn and real streets 15 have 0.52 to 0.92; two that show more of gables than of
facades have 0.27 and 0.49."""


def run(context: StageContext) -> Facts:
    """inpainted/ in canonical colours and inpaint/origins/, where its pixels come from; inpaint/keyframes.json, inpaint/chart.npz,
    masks/shadows; surfels/seeds.ply and surfels/seed_origins.npy; and of full.ply's surfels those that they
    replace and those that lost a shadow: surfels/displaced.npy, surfels/relit.npy. Returns where the sun was found, and what was
    assumed."""
    return inpaint_with(context)


def inpaint_with(context: StageContext, *, charts: bool = True) -> Facts:
    """The stage (see :func:`run`).

    Args:
        charts: False leaves out what is known of the street before anything is invented: then everything that nobody saw is
            invented in the images, as in the paper.
    """
    given = _read(context)
    drive, scene, surfels, gone = given.drive, given.scene, given.removal.surfels, given.removal.gone
    cameras = [f.camera for f in drive.frames]
    blocks = cut_into_blocks(drive)
    street = read_ground(context.workspace.ground_npz).street if charts else None
    fill, sun = None, None
    stretches: list[Stretch] = []
    tested: list[Assumption] = []
    ground: list[Surfels] = []
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    if street is not None:
        stretches = cut_street(street, blocks, cameras, surfels.means.double().numpy()[gone])
        fill = StreetFill(
            drive,
            scene,
            street,
            given.removal,
            given.views,
            stretches,
            cache=context.cache,
            kept=context.kept.within("street"),
            progress=context.progress,
        )
        shadows = context.settings.shadows != "off"
        sun = fill.find_sun() if context.settings.sun is None else given_sun(*context.settings.sun)
        fill.fill(sun, shadows=shadows)
        tested += [_sun_assumed(sun, given=context.settings.sun is not None)] if shadows else []
        tested += [_even_light_assumed(fill.light)]
        displaced, relit, ground = _renew_ground(context, given, fill)
    stays = np.flatnonzero(~(gone | displaced))
    remaining = given.shortened.of(surfels).select(torch.from_numpy(stays))
    completed = None if fill is None else complete_upright(fill, remaining)
    if completed is not None:
        displaced[stays[completed.displaced]] = True
        remaining = remaining.select(torch.from_numpy(~completed.displaced))
        tested += _facades_assumed(completed, named=scene.labels.index("building") is not None)
    parts = [] if completed is None or completed.walls is None else [completed.walls]
    # What follows from the seen part of a house is known before anything is invented.
    counts = [len(part) for part in (remaining, *parts)]
    known = RemainingScene(concatenate([remaining, *parts]), given.sky, None, len(scene.labels))
    del remaining
    # The scene of a long drive is not held twice: what completes it is from now on a view of it.
    parts = known.surfels.split(counts)[1:]
    completed = None if completed is None else replace(completed, walls=None)
    seeds = _Cleaning(context, given, known, fill, completed).run(blocks, stretches)
    invented = range(len(parts), len(parts) + (seeds is not None))
    parts += [] if seeds is None else [seeds]
    parts += ground
    origins = [np.full(len(p), INVENTED if k in invented else CONTINUED, np.uint8) for k, p in enumerate(parts)]
    save_array(np.concatenate([np.zeros(0, np.uint8), *origins]), context.output("surfels/seed_origins.npy"))
    seeds = concatenate(parts) if parts else surfels.select(torch.zeros(len(surfels), dtype=torch.bool))
    write_surfels(seeds, context.output("surfels/seeds.ply"), to_world=drive.to_world)
    save_array(displaced.astype(np.uint8), context.output("surfels/displaced.npy"))
    save_array(relit.astype(np.uint8), context.output("surfels/relit.npy"))
    save_chart(None if fill is None else fill.sources(), context.output("inpaint/chart.npz"))
    return {"sun": _sun_recorded(sun, given=context.settings.sun is not None), **assumed(tested)}


def _renew_ground(context: StageContext, given: _Given, fill: StreetFill) -> tuple[Mask, Mask, list[Surfels]]:
    """(N,) surfels of the ground that new ones replace, (N,) those that lost a shadow, and the new ones of each stretch."""
    surfels, gone = given.removal.surfels, given.removal.gone
    spacing = REOPTIMIZE_PRESETS[context.settings.quality].ground_spacing_m
    label = given.scene.labels.index("road") or 0
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    new = []
    for count, stretch in enumerate(fill.stretches, start=1):

        def make(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
            chart, near = fill.own(stretch), fill.near(stretch)
            local = surfels.select(torch.from_numpy(near))
            places = local.means.double().numpy()[gone[near]]
            anew = new_ground(chart, places, fill.cameras_of(stretch), fill.of_frames(stretch, given.views.removed))
            level = 0.0 if fill.light is None else fill.light.level
            seeds = seed_ground(
                chart, anew, spacing=spacing, sh_degree=surfels.sh_degree, default_label=label, level=level
            )
            old = displaced_by(chart, anew, local, given.scene.labels.indices(GROUND_CLASSES))
            return {**seeds.arrays(), "displaced": near[old], "relit": near[ground_relit(chart, local)]}

        made = context.kept.within(f"street/{stretch.name}").once("renewed", make)
        displaced[made["displaced"]] = True
        relit[made["relit"]] = True
        new.append(Surfels.from_arrays(made))
        context.progress(count, len(fill.stretches), "renewing the ground")
    return displaced & ~gone, relit, new


def _sun_recorded(sun: Sun | None, *, given: bool) -> dict[str, float | bool] | None:
    """The sun's entry in workspace.json: its direction, and how well that explains the dark ground or that it was given."""
    if sun is None:
        return None
    direction = {"azimuth_deg": round(sun.azimuth, 3), "elevation_deg": round(sun.elevation, 3)}
    return {**direction, "given": True} if given else {**direction, "score": round(sun.score, 3)}


def _sun_assumed(sun: Sun | None, *, given: bool) -> Assumption:
    """What is assumed of the sun.

    Args:
        given: whether its direction was given: then it is not tested.
    """
    found = "no direction from which shadows would lie where it is dark, and take light away"
    if sun is not None:
        found = f"azimuth {sun.azimuth:.0f}, elevation {sun.elevation:.0f} degrees"
        found += ", as given, not tested" if given else ""
    instead = f"what is dark within {SHADOW_REACH_M:g} m of a removed object counts as its shadow"
    instead += ", as far as it is darker there than around footprints planted elsewhere, and ends there"
    return Assumption("the sun shines", sun is not None, found, instead)


def _even_light_assumed(light: ViewLight | None) -> Assumption:
    """What is assumed of how bright the ground looks from near and far.

    Args:
        light: by view; None where it is even.
    """
    found = "nothing else is borne out by ground that was held out"
    if light is not None:
        darkest, brightest = light.range
        found = f"it looks {darkest:.2f} to {brightest:.2f} times as bright, by the place in the picture"
        found += f"; looks of the same ground differ by {light.error_without:.0%}, by {light.error:.0%} without that"
    instead = "the chart holds the ground without that light, and each frame gets its own back"
    return Assumption("the ground looks as bright from near and far", light is None, found, instead)


def _facades_assumed(completed: Completed, *, named: bool) -> list[Assumption]:
    """What is assumed of houses.

    Args:
        named: whether some label means houses.
    """
    stand = f"on {completed.sides} of 2 sides, completed on {completed.mended}" if named else "no label means buildings"
    found = [
        Assumption(
            "facades stand along the street",
            completed.sides > 0,
            stand,
            "what was not seen of them is filled frame by frame",
        )
    ]
    if completed.facing is not None:
        found.append(
            Assumption(
                "walls of houses are parallel to the street",
                completed.facing > LEAST_FACING,
                f"{completed.facing:.0%} of what is seen of them is, to 45 degrees",
                "noted, nothing is switched off: what was not seen of other walls is filled frame by frame, however many they are",
            )
        )
    return found


@dataclass(frozen=True, eq=False)
class _Given:
    """What the stage reads: the drive, the chosen labels, what is removed, the frames, and what nobody saw of each.

    Attributes:
        shortened: surfels of the full scene that lost what reached behind removed objects.
        shaded: (H, W) bool per frame, shadows of moving objects; unobserved: (H, W) bool per frame.
    """

    drive: Drive
    scene: SceneLabels
    removal: Removal
    shortened: Shortened
    sky: Sky
    views: Views
    shaded: Sequence[Mask]
    unobserved: Sequence[Mask]


def _read(context: StageContext) -> _Given:
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    scene = load_selection(workspace)
    cameras = [f.camera for f in drive.frames]
    surfels = seen_from_anywhere(read_surfels(workspace.surfels_full), cameras, context.settings.sh_degree)
    gone = load_array(workspace.root / "surfels/removed.npy").astype(bool)
    instances = load_array(workspace.root / "surfels/instances.npy")
    removal = Removal(surfels, gone, instances, context.settings.shadows_that_stay)
    exposures = read_exposures(workspace.exposure_json)
    frames, cache = drive.frames, context.cache
    images = cache.frames(len(frames), lambda i: exposures.read(frames[i]))
    objects, unobserved = (
        cache.frames(len(frames), partial(_mask, frames, workspace.root / f"masks/{name}"))
        for name in ("removed", "unobserved")
    )
    shaded = read_moving(workspace.root).shadows(drive, objects, context.settings.shadows)
    removed = cache.frames(len(frames), lambda i: objects[i] | shaded[i])
    views = drive_views(drive, scene, surfels, images, removed, cache, context.scratch("depths"))
    short = Shortened.from_table(load_array(workspace.root / "surfels/shortened.npy"))
    return _Given(drive, scene, removal, short, load_sky(workspace.root / "surfels/sky.npz"), views, shaded, unobserved)


def _mask(frames: Sequence[Frame], folder: Path, i: int) -> Mask:
    return load_mask(frame_file(folder, frames[i]))


@dataclass(frozen=True, eq=False)
class _Cleaning:
    """The frames cleaned block by block, the last one first: what a block invents, those before it see.

    Attributes:
        known: the scene before anything is invented, without its ground.
        fill: of the street, and what completes it; None where there is no street.
    """

    context: StageContext
    given: _Given
    known: RemainingScene
    fill: StreetFill | None
    completed: Completed | None

    def run(self, blocks: Blocks, stretches: Sequence[Stretch]) -> Surfels | None:
        """Clean and write all frames, and record the keyframes; returns the surfels of what was invented."""
        seeds: list[Surfels] = []
        plans: list[dict[str, Any]] = []
        for done, block in enumerate(reversed(blocks.blocks)):
            stretch = stretches[block.number] if stretches else None
            progress = part_of(self.context.progress, done, len(blocks.blocks))
            plan, new = self._clean(block, self._known(block, stretch, seeds), progress)
            frames = [self.given.drive.frames[i] for i in block.own]
            plans += [] if plan is None else [plan_json(plan, frames)]
            seeds += [] if new is None else [new]
        settings = self.context.settings
        record = plans_json(plans, order=settings.order, given=bool(settings.keyframes))
        write_json_atomic(self.context.output("inpaint/keyframes.json"), record)
        return concatenate(seeds) if seeds else None

    def _known(self, block: Block, stretch: Stretch | None, seeds: list[Surfels]) -> RemainingScene:
        """What is known of the scene before a block is cleaned, as far as its frames see; only one block's ground is held at a
        time."""
        cameras = [self.given.drive.frames[i].camera for i in block.own]
        surfels = concatenate([near_cameras(part, cameras) for part in (self.known.surfels, *seeds)])
        return replace(self.known, surfels=surfels, ground=None if stretch is None else self._layer(stretch))

    def _layer(self, stretch: Stretch) -> GroundLayer:
        assert self.fill is not None and self.completed is not None
        return GroundLayer(
            self.fill.seen_from(stretch),
            ground_labels=self.given.scene.labels.indices(GROUND_CLASSES),
        )

    def _clean(self, block: Block, known: RemainingScene, progress: Progress) -> tuple[Plan | None, Surfels | None]:
        context, given, views, settings = self.context, self.given, self.given.views, self.context.settings
        frames = [given.drive.frames[i] for i in block.own]
        cameras = [f.camera for f in frames]
        sky = None if self.completed is None else sky_behind(self.completed.curtains, cameras, context.cache)
        on_ground = given.scene.labels.indices(GROUND_CLASSES)
        every = given.drive.frames
        free = FreeSpace([f.camera for f in every], context.cache.frames(len(every), self._reached))

        def task(k: int) -> FrameTask:
            i = block.own[k]
            kept = np.isin(views.labels[i], given.scene.removable_labels) & ~views.removed[i]
            over = None if sky is None else sky[k]
            ground = np.isin(views.labels[i], on_ground) & ~views.removed[i]
            return FrameTask(
                cameras[k],
                views.images[i],
                views.removed[i],
                given.unobserved[i],
                kept,
                sky=over,
                free=free,
                ground=ground,
                light=None if self.fill is None else self.fill.light_in(i),
            )

        def write(k: int, result: Painted) -> None:
            frame = frames[k]
            write_image_atomic(frame_file(context.output("inpainted"), frame), result.image)
            write_image_atomic(frame_file(context.output("inpaint/origins"), frame), result.origin)
            shadow = result.shadow | given.shaded[block.own[k]]
            save_mask(shadow, frame_file(context.output("masks/shadows"), frame))

        tasks = Frames(len(frames), task)
        plan = plan_drive(
            frames,
            tasks,
            known.surfels,
            known.ground,
            order=settings.order,
            names=self._named(block),
            cache=context.cache,
            scratch=context.scratch(f"holes/{block.name}"),
            progress=progress,
        )
        network = settings.networks.get("reference_inpainter")
        seeds = propagate_inpainting(
            tasks,
            known,
            inpainter(settings.inpainter),
            write,
            plan=plan,
            reference=None if network is None else load_reference(network),
            kept=context.kept.within(f"frames/{block.name}"),
            progress=progress,
        )
        return plan, seeds

    def _reached(self, i: int) -> NDArray[np.float32]:
        """(H, W) depth of what a frame shows, removed or not; inf where that is the sky, or nothing."""
        views, depth = self.given.views, self.given.views.depths[i]
        sky = np.isin(views.labels[i], self.given.scene.labels.indices(("sky",)))
        return np.where(sky | (depth <= 0), np.inf, depth).astype(np.float32)

    def _named(self, block: Block) -> tuple[int, ...] | None:
        """The user's keyframes among a block's frames; None where they are chosen here."""
        names = self.context.settings.keyframes
        if not names:
            return None
        every = named_frames(self.given.drive.frames, names)
        return tuple(block.own.index(i) for i in every if i in block.own)

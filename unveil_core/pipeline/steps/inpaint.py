"""Stage ``inpaint``: what the removed objects hid, filled in every frame and as new surfels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Frame
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import save_chart
from unveil_core.inpaint.cleaning import How, Room
from unveil_core.inpaint.emptied import empty_the_street
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M
from unveil_core.inpaint.frames.propagate import Painted
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.light.view_light import ViewLight
from unveil_core.inpaint.street_scene import Given, Removal, drive_views
from unveil_core.inpaint.upright import Completed
from unveil_core.optimize.adaptation.colour_degree import seen_from_anywhere
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit, write_edit
from unveil_core.surfels.sky import load_sky
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import frame_file, load_array, load_mask, load_selection, save_mask
from unveil_core.workspace.movers import read_moving

__all__ = ["inpaint_with", "run"]

LEAST_FACING = 0.5
"""Share of the surfels of houses above which these are said to be parallel to the street: half of walls that stand in any direction
face it. Only the record depends on it. Of 17 drawn and real streets 15 have 0.52 to 0.92; two that show more of gables than of
facades have 0.27 and 0.49."""


def run(context: StageContext) -> Facts:
    """inpainted/ in canonical colours and inpaint/origins/, where its pixels come from; inpaint/keyframes.json,
    inpaint/chart.npz, masks/shadows; and all that becomes of the scene: surfels/edit.npz. Returns where the sun was found, and
    what was assumed."""
    return inpaint_with(context)


def inpaint_with(context: StageContext, *, charts: bool = True) -> Facts:
    """The stage (see :func:`run`).

    Args:
        charts: False leaves out what is known of the street before anything is invented: then everything that nobody saw is
            invented in the images, as in the paper.
    """
    given, settings, output = _read(context), context.settings, context.output
    frames, exposures = given.drive.frames, read_exposures(context.workspace.exposure_json)
    how = How(
        settings.inpainter,
        settings.order,
        settings.keyframes,
        settings.networks.get("reference_inpainter"),
        settings.sun,
        settings.shadows != "off",
        REOPTIMIZE_PRESETS[settings.quality].ground_spacing_m,
    )

    def write(i: int, painted: Painted) -> None:
        write_image_atomic(frame_file(output("inpainted"), frames[i]), exposures.packed(painted.image))
        write_image_atomic(frame_file(output("inpaint/origins"), frames[i]), painted.origin)
        save_mask(painted.shadow | given.shaded[i], frame_file(output("masks/shadows"), frames[i]))

    ground = read_ground(context.workspace.ground_npz).street if charts else None
    room = Room(context.cache, context.kept, context.scratch, context.progress)
    emptied = empty_the_street(given, ground, how, room, write)
    filled, completed = emptied.filled, emptied.completed
    write_edit(emptied.edit, output("surfels/edit.npz"))
    write_json_atomic(output("inpaint/keyframes.json"), emptied.keyframes)
    save_chart(None if filled is None else filled.sources(), output("inpaint/chart.npz"))
    if filled is None or completed is None:
        return {"sun": None, **assumed([])}
    tested = [_sun_assumed(filled.sun, given=how.sun is not None)] if how.shadows else []
    tested += [_even_light_assumed(filled.street.light)]
    tested += _facades_assumed(completed, named=given.scene.labels.index("building") is not None)
    return {"sun": _sun_recorded(filled.sun, given=how.sun is not None), **assumed(tested)}


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


def _read(context: StageContext) -> Given:
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    scene = load_selection(workspace)
    cameras = [f.camera for f in drive.frames]
    surfels = seen_from_anywhere(read_surfels(workspace.surfels_full), cameras, context.settings.sh_degree)
    edit = read_edit(workspace.root / "surfels/removal.npz", len(surfels))
    instances = load_array(workspace.root / "surfels/instances.npy")
    removal = Removal(surfels, edit.removed, instances, context.settings.shadows_that_stay)
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
    return Given(drive, scene, removal, edit, load_sky(workspace.root / "surfels/sky.npz"), views, shaded, unobserved)


def _mask(frames: Sequence[Frame], folder: Path, i: int) -> Mask:
    return load_mask(frame_file(folder, frames[i]))

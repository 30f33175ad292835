"""Stage ``reoptimize``: the scene optimized again near removed objects; renders and clean frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.base.mechanisms import on
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_levels
from unveil_core.base.pictures.levels import as_bytes, as_words, colors_of
from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.corrections.files import corrections_of
from unveil_core.corrections.frames import Corrections
from unveil_core.delivery.carried import Photographs, carried_over
from unveil_core.delivery.views import EmptyDepth
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.frames.compose import compose_frame, in_the_light_of, optimized_pixels, sky_below
from unveil_core.inpaint.origin import INVENTED, ORIGINAL, SEEN_ELSEWHERE
from unveil_core.inpaint.single_image.registry import fill_around, inpainter
from unveil_core.optimize.adaptation.colour_degree import seen_from_anywhere
from unveil_core.optimize.in_blocks import BlockwiseReoptimization
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS
from unveil_core.pipeline.source_digest import code_digest
from unveil_core.pipeline.stage import StageContext
from unveil_core.provenance.certainty import CEILINGS, ORIGINAL_LEVEL, certainty_levels, expected_right
from unveil_core.provenance.of_workspace import looks_of, provenance_of
from unveil_core.raster.picture import levels_seen
from unveil_core.remove.selection import near_removed
from unveil_core.surfels.initialize import repainted
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.scene_edit import read_edit
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import scene_depth
from unveil_core.workspace.files import frame_file, load_labels, load_mask, save_depth
from unveil_core.workspace.movers import read_moving

__all__ = ["run", "run_block"]


def run(context: StageContext) -> None:
    """surfels/empty.ply; renders/ and clean/, each in its own photograph's exposure; depths/ of the empty scene; provenance/ and
    certainty/ of clean/."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    sky = load_sky(workspace.root / "surfels/sky.npz")
    exposures = read_exposures(workspace.exposure_json)
    frames, cache = drive.frames, context.cache
    scene = _scene(context, drive)
    corrections = _corrections(context, drive, scene[0])
    clean = _inpainted(context, drive, corrections)
    work = _work(context, drive, scene, clean, sky, corrections)
    empty = work.whole() if on("reoptimization") else work.surfels
    write_surfels(empty, context.output("surfels/empty.ply"), to_world=drive.to_world)
    work.parts.tidy()
    del work, scene  # the scene as it was
    moving = read_moving(workspace.root)
    looks = looks_of(workspace.root, frames, empty, cache, context.scratch("origins"))
    photographs = Photographs(looks.views, looks.pictures, read_ground(workspace.ground_npz).street)

    def draw(i: int) -> None:
        frame = frames[i]
        finished = frame_file(context.output("clean"), frame)
        if finished.is_file():
            return  # written by an attempt that was interrupted
        picture = levels_seen(empty, sky, frame.camera, near=NEAR_M, far=FAR_M)
        seen = exposures.delivered(frame, picture)
        write_image_atomic(frame_file(context.output("renders"), frame), as_bytes(seen))
        removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
        shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame))
        photograph = read_levels(frame.image_path)
        # Around dynamic objects nothing was optimized, and below the horizon is no sky: there the filled frame is shown.
        bare = sky_below(frame.camera, looks.views.frames[i].depth)
        optimized = optimized_pixels(removed, moving.pixels(frame), bare)
        street = np.where(optimized[..., None], in_the_light_of(picture, clean[i], optimized), clean[i])
        elsewhere = removed & (looks.origins[i] == SEEN_ELSEWHERE)
        street = carried_over(photographs, i, street, picture, elsewhere)
        composed = compose_frame(photograph, exposures.delivered(frame, street), removed | shadows)
        delivered = as_bytes(composed) if photograph.dtype == np.uint8 else as_words(composed)
        write_image_atomic(finished, delivered if corrections is None else corrections.work_size(i, delivered))

    for done, _ in enumerate(each(draw, range(len(frames)))):
        context.progress(done + 1, len(frames), "drawing the empty street")
    # What an attempt that was interrupted has told stays: the certainty of a frame is the last that is written of it.
    left = [i for i, f in enumerate(frames) if not frame_file(context.output("certainty"), f).is_file()]
    told = provenance_of(workspace.root, context.partial, frames, looks, cache, left)
    for done, (i, known) in enumerate(zip(left, told, strict=True), start=len(frames) - len(left)):
        changed = known.origin != ORIGINAL
        certainty = np.full(changed.shape, ORIGINAL_LEVEL, dtype=np.uint8)
        certainty[changed] = certainty_levels(expected_right(known.origin[changed], known.doubts))
        origin = known.origin
        if corrections is not None:
            mended = corrections.at_work(i)[1] > 0.5
            origin = np.where(mended, INVENTED, origin).astype(np.uint8)
            most = certainty_levels(np.array([CEILINGS[INVENTED]], np.float32))[0]  # nobody saw what a person painted
            certainty[mended] = np.minimum(certainty[mended], most)
        save_depth(looks.views.frames[i].depth, frame_file(context.output("depths"), known.frame))
        write_image_atomic(frame_file(context.output("provenance"), known.frame), origin)
        write_image_atomic(frame_file(context.output("certainty"), known.frame), certainty)
        context.progress(done + 1, len(frames), "telling where pixels come from")


def _inpainted(context: StageContext, drive: Drive, corrections: Corrections | None) -> Sequence[Levels]:
    """(H, W, 3) per frame, levels of 255 in canonical colours: what the scene is fitted to, corrected where a person did that."""
    folder, frames = context.workspace.root / "inpainted", drive.frames
    exposures = read_exposures(context.workspace.exposure_json)

    def read(i: int) -> Levels:
        inpainted = exposures.read_packed(frame_file(folder, frames[i]))
        if corrections is None or not corrections.touches(i):
            return inpainted
        seen = corrections.work_size(i, colors_of(exposures.delivered(frames[i], inpainted)))
        return exposures.of(frames[i]).canonical(255 * seen)

    return context.cache.frames(len(frames), read)


def _corrections(context: StageContext, drive: Drive, scene: Surfels) -> Corrections | None:
    """What a person mended, None where there is nothing.

    Args:
        scene: as it is before it is optimized again: it carries that.
    """
    listed = corrections_of(context.settings.corrections)
    if not listed:
        return None
    root, frames = context.workspace.root, drive.frames
    exposures = read_exposures(context.workspace.exposure_json)
    cameras = [f.camera for f in frames]
    depths = context.cache.stored(context.scratch("street"), len(frames), lambda i: (scene_depth(scene, cameras[i]),))
    views = Frames(len(frames), lambda i: EmptyDepth(cameras[i], depths[i][0]))

    def invent(i: int, mask: Mask) -> Float32:
        inpainted = exposures.delivered(frames[i], exposures.read_packed(frame_file(root / "inpainted", frames[i])))
        return colors_of(fill_around(inpainter(context.settings.inpainter), inpainted, mask))

    lights = [exposures.of(f) for f in frames]
    return Corrections(listed, frames, lights, views, invent, context.cache)


def _scene(context: StageContext, drive: Drive) -> tuple[Surfels, Mask, Mask]:
    """The empty scene as it is before it is optimized again, and (N,) which of its surfels may change, and lost a shadow."""
    workspace = context.workspace
    cameras = [f.camera for f in drive.frames]
    full = seen_from_anywhere(read_surfels(workspace.surfels_full), cameras, context.settings.sh_degree)
    edit = read_edit(workspace.root / "surfels/edit.npz", len(full))
    near = near_removed(full, edit.removed, REOPTIMIZE_PRESETS[context.settings.quality].near_m)
    near[edit.shortened.index] = True  # what is left of them has to show what they all showed
    added = np.ones(len(edit.origin), dtype=bool)
    return edit.apply(full), edit.carried(near | edit.relit, added), edit.carried(edit.relit, ~added)


def _work(
    context: StageContext,
    drive: Drive,
    scene: tuple[Surfels, Mask, Mask],
    clean: Sequence[Levels],
    sky: Sky,
    corrections: Corrections | None,
) -> BlockwiseReoptimization:
    blocks = cut_into_blocks(drive)
    surfels, movable, relit = scene
    if corrections is not None:  # what was painted is where it starts from
        color, cover = corrections.of_points(surfels.means.double().numpy())
        surfels, mended = repainted(surfels, color, cover > 0), cover > 0
        movable, relit = movable | mended, relit & ~mended
    return BlockwiseReoptimization(
        surfels,
        movable,
        relit,
        sky,
        Frames(len(clean), lambda i: (drive.frames[i].camera, clean[i])),
        REOPTIMIZE_PRESETS[context.settings.quality],
        blocks,
        len(load_labels(context.workspace).labels),
        context.settings.seed,
        context.cache,
        context.parts(len(blocks.blocks)),
        code_digest(run),
        context.progress,
    )


def run_block(context: StageContext, number: int) -> None:
    """One block of the drive, kept for the stage."""
    drive = read_imported(context.workspace.drive_dir, points=False)
    sky = load_sky(context.workspace.root / "surfels/sky.npz")
    scene = _scene(context, drive)
    corrections = _corrections(context, drive, scene[0])
    work = _work(context, drive, scene, _inpainted(context, drive, corrections), sky, corrections)
    work.block(work.blocks.blocks[number])

"""Stage ``deliver``: clean frames at the size, lens and bit depth of the footage, with its profile and what its camera noted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.base.output.copies import copied_png
from unveil_core.base.pictures.decoding import read_image, read_metadata
from unveil_core.base.types import Mask
from unveil_core.corrections.files import corrections_of
from unveil_core.corrections.frames import Corrections
from unveil_core.delivery.detail import grain_of
from unveil_core.delivery.full_size import CleanFrame, FullSize, as_color, full_size_frame
from unveil_core.delivery.lens import write_st_maps
from unveil_core.delivery.plates import plate_file, write_clean_plate
from unveil_core.delivery.shifts import GroundShifts, find_shifts
from unveil_core.delivery.views import EmptyView, EmptyViews, depth_of
from unveil_core.drives.drive import Drive, Footage, Frame, tracks
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.photographs import levels, read_footage
from unveil_core.geometry.images import mask_bits, mask_of_bits
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import read_chart_sources
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, RELIT
from unveil_core.pipeline.stage import StageContext
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import frame_file, load_mask
from unveil_core.workspace.movers import Moving, no_street, read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["run"]


def run(context: StageContext) -> None:
    """frames/, and st_maps/ of the cameras whose footage has a lens."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    folder = context.output("frames")
    lenses = context.output("st_maps")
    lenses.mkdir(parents=True, exist_ok=True)  # an attempt that was interrupted made it
    given = _full_size(context, drive) if any(f.footage is not None for f in drive.frames) else None
    corrections = None if given is None else _corrections(context, drive, given)
    for i, frame in enumerate(drive.frames):
        clean = frame_file(workspace.root / "clean", frame)
        delivered = frame_file(folder, frame)
        if delivered.is_file():
            pass  # by an attempt that was interrupted
        elif frame.footage is None or given is None:
            copied_png(clean, delivered, read_metadata(frame.image_path))
        else:
            removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
            shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame)) & ~removed
            own = CleanFrame(frame.footage, read_image(frame.image_path), read_image(clean), removed, shadows)
            before = given.footage(i)
            picture = full_size_frame(own, i, given, before)
            picture = picture if corrections is None else corrections.full_size(i, picture)
            if frame.footage.plate is not None:  # the PNG beside it comes last, and tells that both are there
                write_clean_plate(frame.footage, before, picture, plate_file(delivered, frame.footage))
                picture = levels(picture)
            write_image_atomic(delivered, picture, metadata=read_metadata(frame.footage.path))
        context.progress(len(drive.frames) + i + 1, 2 * len(drive.frames), "delivering")
    for track in tracks(drive):
        first = drive.frames[track[0]]
        if first.footage is not None and first.footage.distortion is not None:
            write_st_maps(first.footage, first.camera, lenses / first.camera_name)


def _corrections(context: StageContext, drive: Drive, given: FullSize) -> Corrections | None:
    """What a person mended, None where there is nothing; what was invented anew is in the clean frames already."""
    listed = corrections_of(context.settings.corrections)
    if not listed:
        return None
    folder, frames = context.workspace.root / "clean", drive.frames

    def invented(i: int, mask: Mask) -> NDArray[np.uint8]:
        return read_image(frame_file(folder, frames[i]))

    return Corrections(listed, frames, given.exposures, given.views.frames, invented, context.cache)


def _full_size(context: StageContext, drive: Drive) -> FullSize:
    workspace = context.workspace
    surfels = read_surfels(workspace.root / "surfels/empty.ply")
    frames, moving = drive.frames, read_moving(workspace.root)

    def look(i: int) -> tuple[NDArray[Any], ...]:
        depth, barred = _seen(workspace, surfels, frames[i], moving)
        return depth, mask_bits(barred)

    def view(i: int) -> EmptyView:
        depth, bits = stored[i]
        return EmptyView(frames[i].camera, depth, mask_of_bits(bits, depth.shape))

    stored = context.cache.stored(context.scratch("views"), len(frames), look)
    for done, _ in enumerate(stored):
        context.progress(done + 1, 2 * len(frames), "looking at the empty street")
    ground = read_ground(workspace.ground_npz).street
    footage = [f.footage or Footage(f.image_path, f.camera) for f in frames]
    pictures = context.cache.frames(len(frames), lambda i: read_footage(footage[i]))
    grains: dict[float, Sequence[NDArray[np.float32]]] = {}

    def grain(i: int, sigma: float) -> NDArray[np.float32]:
        if sigma not in grains:
            grains[sigma] = context.cache.frames(len(frames), lambda k: grain_of(as_color(pictures[k]), sigma))
        return grains[sigma][i]

    exposures = read_exposures(workspace.exposure_json)
    return FullSize(
        EmptyViews([f.camera for f in frames], Frames(len(frames), view)),
        pictures.__getitem__,
        footage,
        [exposures.of(f) for f in frames],
        grain,
        ground,
        _shifts(workspace),
    )


def _seen(
    workspace: Workspace, surfels: Surfels, frame: Frame, moving: Moving
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(H, W) depth of the empty scene in a frame, 0 for none, and the pixels (H, W) that show no street."""
    return depth_of(surfels, frame.camera), no_street(workspace.root, frame, moving)


def _shifts(workspace: Workspace) -> GroundShifts | None:
    chart = read_chart_sources(workspace.root / "inpaint/chart.npz")
    if chart is None:
        return None
    made = (chart.source == INVENTED) | (chart.source == RELIT)
    observed = chart.source == OBSERVED
    return find_shifts(observed, made, chart.label, s_start=chart.s_start, t_start=chart.t_start, texel=chart.texel)

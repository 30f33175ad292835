"""Stage ``deliver``: clean frames at the size, lens and bit depth of the footage, with its profile and what its camera noted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.output.copies import copied_png
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_levels, read_metadata
from unveil_core.base.pictures.levels import colors_of
from unveil_core.base.types import Float32, Mask
from unveil_core.corrections.files import corrections_of
from unveil_core.corrections.frames import Corrections
from unveil_core.delivery.detail import grain_of
from unveil_core.delivery.full_size import CleanFrame, FullSize, full_size_frame, reduced
from unveil_core.delivery.lens import write_st_maps
from unveil_core.delivery.plates import plate_file, write_clean_plate
from unveil_core.delivery.shifts import GroundShifts, find_shifts
from unveil_core.delivery.views import EmptyView, EmptyViews
from unveil_core.drives.drive import Drive, Footage, tracks
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.photographs import levels, read_footage
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import read_chart_sources
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, RELIT
from unveil_core.pipeline.stage import StageContext
from unveil_core.workspace.files import frame_file, load_depth, load_mask
from unveil_core.workspace.movers import no_street, read_moving
from unveil_core.workspace.workspace import Workspace

__all__ = ["run"]

BYTES_A_PIXEL = 80
"""Memory of a frame that is being delivered, for each pixel of the footage: where half of them are removed."""


def run(context: StageContext) -> None:
    """frames/, and st_maps/ of the cameras whose footage has a lens."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    folder = context.output("frames")
    lenses = context.output("st_maps")
    lenses.mkdir(parents=True, exist_ok=True)  # an attempt that was interrupted made it
    given = _full_size(context, drive) if any(f.footage is not None for f in drive.frames) else None
    corrections = None if given is None else _corrections(context, drive, given)
    # All but those of an attempt that was interrupted.
    left = [i for i, f in enumerate(drive.frames) if not frame_file(folder, f).is_file()]
    finished = each(lambda i: _deliver(context, drive, i, given, corrections), left, most=_at_a_time(context, drive))
    for done, _ in enumerate(finished, start=len(drive.frames) - len(left)):
        context.progress(done + 1, len(drive.frames), "delivering")
    for track in tracks(drive):
        first = drive.frames[track[0]]
        if first.footage is not None and first.footage.distortion is not None:
            write_st_maps(first.footage, first.camera, lenses / first.camera_name)


def _at_a_time(context: StageContext, drive: Drive) -> int:
    """How many frames may be at work at once: in a quarter of the room for frames."""
    pixels = max((f.footage.camera.width * f.footage.camera.height for f in drive.frames if f.footage), default=1)
    return max(1, context.cache.most // 4 // (pixels * BYTES_A_PIXEL))


def _deliver(
    context: StageContext, drive: Drive, i: int, given: FullSize | None, corrections: Corrections | None
) -> None:
    """Write one frame."""
    workspace, frame = context.workspace, drive.frames[i]
    clean = frame_file(workspace.root / "clean", frame)
    delivered = frame_file(context.output("frames"), frame)
    if frame.footage is None or given is None:
        copied_png(clean, delivered, read_metadata(frame.image_path))
        return
    removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
    shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame)) & ~removed
    own = CleanFrame(frame.footage, read_levels(frame.image_path), read_levels(clean), removed, shadows)
    before = given.footage(i)
    picture = full_size_frame(own, i, given, before)
    picture = picture if corrections is None else corrections.full_size(i, picture)
    if frame.footage.plate is not None:  # the PNG beside it comes last, and tells that both are there
        write_clean_plate(frame.footage, before, picture, plate_file(delivered, frame.footage))
        picture = levels(picture)
    write_image_atomic(delivered, picture, metadata=read_metadata(frame.footage.path))


def _corrections(context: StageContext, drive: Drive, given: FullSize) -> Corrections | None:
    """What a person mended, None where there is nothing; what was invented anew is in the clean frames already."""
    listed = corrections_of(context.settings.corrections)
    if not listed:
        return None
    folder, frames = context.workspace.root / "clean", drive.frames

    def invented(i: int, mask: Mask) -> Float32:
        return colors_of(read_levels(frame_file(folder, frames[i])))

    return Corrections(listed, frames, given.exposures, given.views.frames, invented, context.cache)


def _full_size(context: StageContext, drive: Drive) -> FullSize:
    workspace, frames = context.workspace, drive.frames
    moving = read_moving(workspace.root)

    def view(i: int) -> EmptyView:
        camera = frames[i].camera
        depth = load_depth(frame_file(workspace.root / "depths", frames[i]), (camera.width, camera.height))
        return EmptyView(camera, depth, no_street(workspace.root, frames[i], moving))

    ground = read_ground(workspace.ground_npz).street
    footage = [f.footage or Footage(f.image_path, f.camera) for f in frames]
    pictures = context.cache.frames(len(frames), lambda i: read_footage(footage[i]))
    coarse = context.cache.frames(len(frames), lambda i: reduced(pictures[i], footage[i], frames[i].camera))
    grains: dict[float, Sequence[NDArray[np.float32]]] = {}

    def grain(i: int, sigma: float) -> NDArray[np.float32]:
        if sigma not in grains:
            grains.setdefault(sigma, context.cache.frames(len(frames), lambda k: grain_of(pictures[k], sigma)))
        return grains[sigma][i]

    exposures = read_exposures(workspace.exposure_json)
    return FullSize(
        EmptyViews([f.camera for f in frames], context.cache.frames(len(frames), view)),
        pictures.__getitem__,
        coarse.__getitem__,
        footage,
        [exposures.of(f) for f in frames],
        grain,
        ground,
        _shifts(workspace),
    )


def _shifts(workspace: Workspace) -> GroundShifts | None:
    chart = read_chart_sources(workspace.root / "inpaint/chart.npz")
    if chart is None:
        return None
    made = (chart.source == INVENTED) | (chart.source == RELIT)
    observed = chart.source == OBSERVED
    return find_shifts(observed, made, chart.label, s_start=chart.s_start, t_start=chart.t_start, texel=chart.texel)

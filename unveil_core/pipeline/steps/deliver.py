"""Stage ``deliver``: clean frames at the size, lens and bit depth of the footage."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import link_or_copy, read_image, write_image_atomic
from unveil_core.delivery.detail import grain_of
from unveil_core.delivery.full_size import CleanFrame, FullSize, as_color, full_size_frame
from unveil_core.delivery.lens import write_st_maps
from unveil_core.delivery.shifts import GroundShifts, find_shifts
from unveil_core.delivery.views import EmptyView
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, Footage, Frame, tracks
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.photographs import read_footage
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.files import read_ground
from unveil_core.inpaint.chart.files import read_chart_sources
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, RELIT
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.raster.picture import render_numpy
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import frame_file, load_mask
from unveil_core.workspace.movers import ego_pixels
from unveil_core.workspace.workspace import Workspace

__all__ = ["STAGE"]

CACHE_BYTES = 256 * 2**20
"""Of footage that is held decoded: about forty frames of 1920x1080; more are decoded again."""
SOLID = 0.5
"""Alpha of the empty scene above which a pixel shows a surface."""


def run(context: StageContext) -> None:
    """frames/, and st_maps/ of the cameras whose footage has a lens."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    folder = context.output("frames")
    lenses = context.output("st_maps")
    lenses.mkdir(parents=True)
    given = _full_size(context, drive) if any(f.footage is not None for f in drive.frames) else None
    for i, frame in enumerate(drive.frames):
        clean = frame_file(workspace.root / "clean", frame)
        delivered = frame_file(folder, frame)
        if frame.footage is None or given is None:
            link_or_copy(clean, delivered)
        else:
            removed = load_mask(frame_file(workspace.root / "masks/removed", frame))
            shadows = load_mask(frame_file(workspace.root / "masks/shadows", frame)) & ~removed
            own = CleanFrame(frame.footage, read_image(frame.image_path), read_image(clean), removed, shadows)
            write_image_atomic(delivered, full_size_frame(own, i, given, given.footage(i)))
        context.progress(len(drive.frames) + i + 1, 2 * len(drive.frames), "delivering")
    for track in tracks(drive):
        first = drive.frames[track[0]]
        if first.footage is not None and first.footage.distortion is not None:
            write_st_maps(first.footage, first.camera, lenses / first.camera_name)


def _full_size(context: StageContext, drive: Drive) -> FullSize:
    workspace = context.workspace
    surfels = read_surfels(workspace.root / "surfels/empty.ply")
    views = []
    for done, frame in enumerate(drive.frames):
        views.append(_view(workspace, surfels, frame))
        context.progress(done + 1, 2 * len(drive.frames), "looking at the empty street")
    ground = read_ground(workspace.ground_npz).street
    footage = [f.footage or Footage(f.image_path, f.camera) for f in drive.frames]
    pictures = _kept(lambda i: read_footage(footage[i]), CACHE_BYTES)
    grain = _kept(lambda key: grain_of(as_color(pictures(key[0])), key[1]), CACHE_BYTES)
    exposures = read_exposures(workspace.exposure_json)
    return FullSize(
        views,
        pictures,
        footage,
        [exposures.of(f) for f in drive.frames],
        lambda i, sigma: grain((i, sigma)),
        ground,
        _shifts(workspace),
    )


def _view(workspace: Workspace, surfels: Surfels, frame: Frame) -> EmptyView:
    rendered = render_numpy(surfels, frame.camera, near=NEAR_M, far=FAR_M)
    goes = load_mask(frame_file(workspace.root / "masks/removed", frame))
    goes |= load_mask(frame_file(workspace.root / "masks/shadows", frame)) | ego_pixels(frame)
    depth = np.where(rendered["alpha"] > SOLID, rendered["depth"], 0).astype(np.float32)
    return EmptyView(frame.camera, depth, grow(goes, border_px(frame.camera.width)))


def _shifts(workspace: Workspace) -> GroundShifts | None:
    chart = read_chart_sources(workspace.root / "inpaint/chart.npz")
    if chart is None:
        return None
    made = (chart.source == INVENTED) | (chart.source == RELIT)
    observed = chart.source == OBSERVED
    return find_shifts(observed, made, chart.label, s_start=chart.s_start, t_start=chart.t_start, texel=chart.texel)


def _kept(read: Callable[[Any], NDArray[Any]], most: int) -> Callable[[Any], NDArray[Any]]:
    """Pictures by key; those that were used last stay, up to ``most`` bytes."""
    held: OrderedDict[Any, NDArray[Any]] = OrderedDict()

    def get(key: Any) -> NDArray[Any]:
        if key not in held:
            held[key] = read(key)
        held.move_to_end(key)
        while len(held) > 1 and sum(p.nbytes for p in held.values()) > most:
            held.popitem(last=False)
        return held[key]

    return get


STAGE = Stage(
    "deliver",
    run,
    inputs=(
        "drive",
        "clean",
        "surfels/empty.ply",
        "surfels/exposure.json",
        "ground",
        "inpaint/chart.npz",
        "masks/removed",
        "masks/shadows",
    ),
    outputs=("frames", "st_maps"),
)

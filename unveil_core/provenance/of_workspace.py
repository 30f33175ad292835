"""The provenance of a workspace's clean frames: all that it follows from is read from files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_label_image, read_levels
from unveil_core.base.pictures.levels import rounded_like
from unveil_core.base.types import Float32, Levels
from unveil_core.delivery.views import EmptyView, EmptyViews
from unveil_core.drives.drive import Frame
from unveil_core.drives.exposure import Exposures, read_exposures
from unveil_core.geometry.images import mask_bits, mask_of_bits, smoothed
from unveil_core.inpaint.frames.compose import optimized_pixels, sky_below
from unveil_core.inpaint.origin import ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.provenance.doubts import find_doubts
from unveil_core.provenance.leftovers import RemovedPlaces, leftovers_of
from unveil_core.provenance.origins import frame_origins, marked_by, rendered_origins
from unveil_core.provenance.witnesses import Witnesses, seen_by
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import frame_file, load_mask
from unveil_core.workspace.movers import Moving, no_street, read_moving

__all__ = ["EmptyLooks", "FrameProvenance", "looks_of", "provenance_of", "surfel_origins"]

EDIT = "surfels/edit.npz"


@dataclass(frozen=True, eq=False)
class EmptyLooks:
    """What the frames of a workspace show of the empty scene.

    Attributes:
        views: its depth in them, and in which pixels the photograph is no witness of it.
        origins: (H, W) uint8 where the pixels of their clean frames come from, see ``inpaint.origin``.
        pictures: (H, W, 3) levels of 255, their photographs, in canonical colours.
    """

    views: EmptyViews
    origins: Sequence[NDArray[np.uint8]]
    pictures: Sequence[Levels]


@dataclass(frozen=True, eq=False)
class FrameProvenance:
    """Where a clean frame comes from.

    Attributes:
        frame: whose it is.
        origin: (H, W) uint8, see ``inpaint.origin``.
        doubts: (P, D) of the pixels that are not ORIGINAL, see ``doubts``.
    """

    frame: Frame
    origin: NDArray[np.uint8]
    doubts: Float32


def looks_of(root: Path, frames: Sequence[Frame], surfels: Surfels, cache: FrameCache, scratch: Path) -> EmptyLooks:
    """What all frames show, rendered when it is asked for.

    Args:
        root: the workspace; surfels: its empty scene.
        cache: room for the frames; scratch: folder for what is rendered of them.
    Raises:
        WorkspaceError: its surfels are not those that the workspace says.
    """
    marked = marked_by(surfels, surfel_origins(root, len(surfels)))
    exposures, moving = read_exposures(root / "surfels/exposure.json"), read_moving(root)

    def look(i: int) -> tuple[NDArray[Any], ...]:
        shown, depth = rendered_origins(marked, frames[i].camera)
        return _origin_of(root, frames[i], shown, depth, moving), mask_bits(no_street(root, frames[i], moving)), depth

    stored = cache.stored(scratch, len(frames), look)

    def view(i: int) -> EmptyView:
        _, barred, depth = stored[i]
        return EmptyView(frames[i].camera, depth, mask_of_bits(barred, depth.shape))

    return EmptyLooks(
        EmptyViews([f.camera for f in frames], Frames(len(frames), view)),
        Frames(len(frames), lambda i: stored[i][0]),
        cache.frames(len(frames), lambda i: exposures.read(frames[i])),
    )


def provenance_of(
    root: Path,
    made: Path,
    frames: Sequence[Frame],
    looks: EmptyLooks,
    cache: FrameCache,
    wanted: Sequence[int] | None = None,
) -> Iterator[FrameProvenance]:
    """The provenance of all frames, in their order.

    Args:
        root: the workspace; made: folder of ``clean/`` and ``renders/``, which may not be there yet.
        looks: what the frames show of its empty scene; cache: room for them.
        wanted: indices of the frames that are asked for; None = all.
    """
    exposures = read_exposures(root / "surfels/exposure.json")
    pictures = cache.frames(len(frames), lambda i: rounded_like(smoothed(looks.pictures[i]), looks.pictures[i]))
    places = _removed_places(root)
    witnesses = Witnesses(looks.views, pictures)

    def told(i: int) -> FrameProvenance:
        frame, origin = frames[i], looks.origins[i]
        return FrameProvenance(frame, origin, _doubts_of(root, made, frame, origin, witnesses, i, exposures, places))

    yield from each(told, range(len(frames)) if wanted is None else wanted)


def surfel_origins(root: Path, count: int) -> NDArray[np.uint8]:
    """(M,) where the colours of the empty scene's surfels come from, see ``inpaint.origin``.

    Args:
        root: the workspace; count: M, that its empty scene has.
    Raises:
        WorkspaceError: the workspace tells of another number.
    """
    edit = read_edit(root / EDIT)
    origins = edit.carried(np.where(edit.relit, RELIT, SEEN_ELSEWHERE).astype(np.uint8), edit.origin)
    if len(origins) != count:
        raise WorkspaceError(
            f"has {count} surfels, {len(origins)} are expected",
            path=root / "surfels/empty.ply",
            mend="run `unveil inpaint` and `unveil reoptimize` again",
        )
    return origins


def _removed_places(root: Path) -> RemovedPlaces:
    """Where the removed objects of a workspace stood."""
    places = read_surfels(root / "surfels/full.ply").means.double().numpy()
    return RemovedPlaces(places[read_edit(root / EDIT, len(places)).removed])


def _origin_of(root: Path, frame: Frame, shown: NDArray[np.uint8], depth: Float32, moving: Moving) -> NDArray[np.uint8]:
    """(H, W) origins of a clean frame; ``shown`` (H, W) and ``depth`` (H, W): of the empty scene in it."""
    removed, shadows, unobserved = (
        load_mask(frame_file(root / "masks" / name, frame)) for name in ("removed", "shadows", "unobserved")
    )
    inpainted = read_label_image(frame_file(root / "inpaint/origins", frame))
    optimized = optimized_pixels(removed, moving.pixels(frame), sky_below(frame.camera, depth))
    return frame_origins(shown, inpainted, optimized, (removed | shadows) & ~optimized, unobserved)


def _doubts_of(
    root: Path,
    made: Path,
    frame: Frame,
    origin: NDArray[np.uint8],
    witnesses: Witnesses,
    own: int,
    exposures: Exposures,
    places: RemovedPlaces,
) -> Float32:
    changed = origin != ORIGINAL
    exposure = exposures.of(frame)
    clean, rendered = (exposure.canonical(read_levels(frame_file(made / name, frame))) for name in ("clean", "renders"))
    inpainted = exposures.read_packed(frame_file(root / "inpainted", frame))
    photograph, depth = exposures.read(frame), witnesses.views.frames[own].depth
    return find_doubts(
        clean,
        photograph,
        (rendered, inpainted),
        changed,
        origin == RELIT,
        depth,
        seen_by(witnesses, own, changed),
        leftovers_of(clean, photograph, changed, depth, frame.camera, places),
    )

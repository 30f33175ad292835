"""The input of a row of the pipeline's benchmark, and helpers that the rows share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures, read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow
from unveil_core.inpaint.frames.by_reference import ReferenceInpainter
from unveil_core.inpaint.frames.compose import compose_frame
from unveil_core.inpaint.single_image.registry import SingleImageInpainter, fill_around
from unveil_core.pipeline.settings import RunSettings
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit
from unveil_core.surfels.sky import Sky, load_sky
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import frame_file, load_mask, load_selection
from unveil_core.workspace.workspace import Workspace

__all__ = [
    "Footage",
    "Splats",
    "deliver",
    "fill_around",
    "look",
    "open_footage",
    "open_splats",
    "to_bytes",
]

SOLID = 0.6
"""A pixel with more alpha than this shows a surface; the pipeline's own threshold."""


HOLE_SHARE = 1 / 64
"""Of the image's width: so much farther than its mask an object's blurred border and its darkness on the ground reach. As context
they would be continued into the hole; without them every single-image method gains (1 dB and more on the sample street)."""


@dataclass(frozen=True, eq=False)
class Footage:
    """The drive as every row sees it.

    Attributes:
        workspace: in which everything until ``remove`` is done; not to be changed.
        drive: as imported; source: the path that the user gave.
        photographs: (H, W, 3) uint8 of each frame.
        removed: (H, W) whole mask of the removed objects in each frame, borders included.
        holes: (H, W) the same, grown by ``HOLE_SHARE``: what the baselines fill.
        settings: quality, seed and single-image inpainter.
        single_image: the configured inpainter; reference: the network of reference-based inpainting, or None.
    """

    workspace: Workspace
    drive: Drive
    source: Path
    photographs: tuple[Picture, ...]
    removed: tuple[Mask, ...]
    holes: tuple[Mask, ...]
    settings: RunSettings
    single_image: SingleImageInpainter
    reference: ReferenceInpainter | None = None


@dataclass(frozen=True, eq=False)
class Splats:
    """The reconstructed scene that the rows in 3D share.

    Attributes:
        full: everything; gone: (N,) bool, what is removed of it; remaining: the others.
        sky, labels, exposures: of the scene.
        images: (H, W, 3) uint8 of each frame, in the scene's own colours.
    """

    full: Surfels
    gone: NDArray[np.bool_]
    remaining: Surfels
    sky: Sky
    labels: SceneLabels
    exposures: Exposures
    images: tuple[Picture, ...]


def open_footage(
    workspace: Workspace,
    source: Path,
    settings: RunSettings,
    single_image: SingleImageInpainter,
    reference: ReferenceInpainter | None = None,
) -> Footage:
    """Read the frames and masks of a workspace."""
    drive = read_imported(workspace.drive_dir, points=False)
    removed = tuple(load_mask(frame_file(workspace.root / "masks/removed", f)) for f in drive.frames)
    return Footage(
        workspace,
        drive,
        source,
        tuple(read_image(f.image_path) for f in drive.frames),
        removed,
        tuple(grow(mask, round(HOLE_SHARE * mask.shape[1])) for mask in removed),
        settings,
        single_image,
        reference,
    )


def open_splats(footage: Footage) -> Splats:
    """Read the reconstructed scene of a workspace."""
    workspace, frames = footage.workspace, footage.drive.frames
    full = read_surfels(workspace.surfels_full)
    gone = read_edit(workspace.root / "surfels/removal.npz", len(full)).removed
    exposures = read_exposures(workspace.exposure_json)
    images = tuple(as_bytes(exposures.of(f).canonical(p)) for f, p in zip(frames, footage.photographs, strict=True))
    return Splats(
        full,
        gone,
        full.select(torch.from_numpy(~gone)),
        load_sky(workspace.root / "surfels/sky.npz"),
        load_selection(workspace),
        exposures,
        images,
    )


def deliver(footage: Footage, splats: Splats | None, clean: Sequence[Picture]) -> list[Picture]:
    """Put clean pictures (H, W, 3), in the scene's colours if ``splats`` is given, into the photographs' masks: the same
    seam for every row."""
    delivered = []
    for frame, photograph, picture, removed in zip(
        footage.drive.frames, footage.photographs, clean, footage.removed, strict=True
    ):
        street = picture if splats is None else splats.exposures.delivered(frame, picture)
        delivered.append(as_bytes(compose_frame(photograph, street, removed)))
    return delivered


def to_bytes(picture: NDArray[np.floating]) -> Picture:
    """A picture (H, W, 3) in [0, 1] as uint8."""
    return np.clip(np.round(picture * 255), 0, 255).astype(np.uint8)


def look(scene: Surfels, sky: Sky, camera: Camera) -> tuple[Picture, dict[str, NDArray[np.float32]]]:
    """A view (H, W, 3) uint8 of a scene before its sky, and its planes (see :func:`render_numpy`).

    A surface that is only half covered takes its colour from what covers it, not from the sky, as in the pipeline itself.
    """
    out = render_numpy(scene, camera, near=NEAR_M, far=FAR_M)
    solid = (out["alpha"] > SOLID)[..., None]
    covered = out["rgb"] / np.maximum(out["alpha"], SOLID)[..., None]
    open_ = out["rgb"] + (1 - out["alpha"])[..., None] * sky.render(camera).numpy()
    return to_bytes(np.where(solid, covered, open_)), out

"""The mesh of the empty street and its levels of detail, with texture atlases painted from the clean frames at their full size.

Each level has a quarter of the triangles of the one before, and pages of half the side.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.base.progress import part_of
from unveil_core.base.types import Float32, Float64
from unveil_core.delivery.full_size import as_color, in_exposure
from unveil_core.delivery.lens import footage_positions
from unveil_core.drives.drive import Frame
from unveil_core.drives.exposure import IDENTITY
from unveil_core.exports.job import Job
from unveil_core.mesh import decimate
from unveil_core.mesh.texture import TexturedMesh, TextureView, paint, unwrap
from unveil_core.workspace.movers import ego_pixels

__all__ = ["Level", "encoded", "page_mesh", "texel_m", "texture_view", "textured_levels"]

TEXTURED_TRIANGLES = 200_000
"""Of the finest level where no number is asked for: it shows no more with more, and less fits the memory of a viewer."""
MOST_PAGES = 4
"""Of the finest level: 64 megapixels of the usual side, a texel of 1 cm for 120 m of street."""
NEAR_M = 8.0
"""Distance at which a texel is as large as a pixel of the footage: that of the next lane and of the kerb."""
JPEG_QUALITY = 95


@dataclass(frozen=True, eq=False)
class Level:
    """A level of detail.

    Attributes:
        name: of its files, without a suffix: ``empty``, ``empty_lod1`` ...
        textured: the mesh.
    """

    name: str
    textured: TexturedMesh

    def told(self, file: str) -> dict[str, Any]:
        """What export.json tells of it."""
        sides = [[int(i.shape[1]), int(i.shape[0])] for i in self.textured.images]
        texel = round(self.textured.atlas.texel, 5)
        return {"file": file, "triangles": len(self.textured.mesh.faces), "texel_m": texel, "pages": sides}


def textured_levels(job: Job) -> list[Level]:
    """The mesh and its levels of detail, finest first; made once for all formats of a job.

    Raises:
        SettingsError: too few triangles. WorkspaceError: a stage that this needs has not run.
    """
    if "textured" not in job.made:
        job.made["textured"] = list(_levels(job))
    levels: list[Level] = job.made["textured"]
    return levels


def _levels(job: Job) -> Iterator[Level]:
    frames = job.drive.frames
    for frame in frames:
        job.delivered(frame)  # what is missing is told before minutes of work

    mesh = job.mesh if job.triangles is not None else decimate(job.mesh, TEXTURED_TRIANGLES)
    texel, finest, cameras = texel_m(frames), len(mesh.faces), [f.camera for f in frames]
    views = Frames(len(frames), lambda i: texture_view(job, frames[i]))
    for level in range(job.levels + 1):
        told = part_of(job.progress, level, job.levels + 1)
        if level:
            mesh = decimate(mesh, max(finest >> 2 * level, 4))
        told(0, 1, f"unwrapping {len(mesh.faces):,} triangles")
        atlas = unwrap(mesh, job.texture_px >> level, texel * 2**level, MOST_PAGES)
        painted = paint(mesh, atlas, cameras, views, progress=told)
        yield Level(job.state + (f"_lod{level}" if level else ""), painted)


def texel_m(frames: Sequence[Frame]) -> float:
    """Edge of a texel of the finest level, metres: a pixel of the footage at :data:`NEAR_M`."""
    focal = [f.camera.fx if f.footage is None else f.footage.camera.fx for f in frames]
    return NEAR_M / float(np.median(focal))


def texture_view(job: Job, frame: Frame) -> TextureView:
    """The clean frame at full size, in the scene's canonical colours."""
    color = as_color(read_image_as_it_is(job.delivered(frame)))
    own = job.exposures.of(frame)
    canonical = in_exposure(color.reshape(-1, 3), own, IDENTITY).reshape(color.shape)
    return TextureView(frame.camera, np.clip(canonical, 0, 1), _locate(frame), ~ego_pixels(frame))


def _locate(frame: Frame) -> Callable[[Float64], Float64]:
    footage = frame.footage

    def positions(points: Float64) -> Float64:
        return frame.camera.project(points)[0] if footage is None else footage_positions(footage, points)[0]

    return positions


def page_mesh(textured: TexturedMesh, number: int) -> tuple[NDArray[np.int32], Float32, NDArray[np.int32]]:
    """What one page shows, as formats want it that have one index a corner.

    Returns:
        the mesh's vertex of each row (R,), its texture coordinates (R, 2) with v up, and triangles (T, 3) of rows.
    """
    atlas = textured.atlas
    rows, triangles = np.unique(atlas.corners[atlas.pages == number], return_inverse=True)
    return atlas.vertices[rows], atlas.coordinates[rows], triangles.reshape(-1, 3).astype(np.int32)


def encoded(image: NDArray[np.uint8], suffix: str) -> bytes:
    """A page as ``.png`` or ``.jpg``, sRGB."""
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if suffix == ".jpg" else []
    done, content = cv2.imencode(suffix, np.ascontiguousarray(image[..., ::-1]), options)
    if not done:
        raise SettingsError("a page of the texture cannot be written", mend="give a smaller --texture")
    return bytes(content)

"""Pictures of a mesh without a graphics card: vertex colours or a texture, and a little light from the camera."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.mesh.hits import Hits, hit_triangles
from unveil_core.mesh.mesh import Mesh
from unveil_core.mesh.texture.atlas import TexturedMesh

__all__ = ["render_mesh_picture", "render_textured_picture"]

BACKGROUND = (236, 238, 241)


def render_mesh_picture(
    mesh: Mesh,
    camera: Camera,
    size: tuple[int, int] | None = None,
    *,
    background: tuple[int, int, int] = BACKGROUND,
    headlight: float = 0.35,
    samples: int = 2,
) -> NDArray[np.uint8]:
    """Draw a mesh with its vertex colours.

    Args:
        mesh: in the camera's frame of reference.
        camera: the view; triangles that reach behind it are left out.
        size: (width, height) of the picture; the camera's own by default.
        background: sRGB where there is no surface.
        headlight: 0 for the colours as they are, 1 for full shading by the angle to the camera.
        samples: supersampling along each axis.
    Returns:
        (H, W, 3) uint8 sRGB.
    """
    fine = _supersampled(camera, size, samples)
    hits = hit_triangles(mesh, fine)
    return _shaded(mesh, fine, hits, hits.values(mesh.faces, mesh.colors), background, headlight, samples)


def render_textured_picture(
    textured: TexturedMesh,
    camera: Camera,
    size: tuple[int, int] | None = None,
    *,
    background: tuple[int, int, int] = BACKGROUND,
    headlight: float = 0.0,
    samples: int = 2,
) -> NDArray[np.uint8]:
    """Draw a mesh with its texture, see :func:`render_mesh_picture`."""
    fine = _supersampled(camera, size, samples)
    hits = hit_triangles(textured.mesh, fine)
    atlas = textured.atlas
    place = hits.values(atlas.corners, atlas.coordinates)
    page = atlas.pages[np.maximum(hits.face, 0)]
    colors = np.zeros((fine.height, fine.width, 3), np.float32)
    for number, image in enumerate(textured.images):
        # Image row 0 is at the top, the texture's v = 0 at the bottom; cv2 counts from pixel centres.
        columns = place[..., 0] * image.shape[1] - 0.5
        rows = (1 - place[..., 1]) * image.shape[0] - 0.5
        found = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        colors[page == number] = found[page == number]
    return _shaded(textured.mesh, fine, hits, colors, background, headlight, samples)


def _supersampled(camera: Camera, size: tuple[int, int] | None, samples: int) -> Camera:
    width, height = size if size is not None else (camera.width, camera.height)
    return camera.resized(width * samples, height * samples)


def _shaded(
    mesh: Mesh,
    camera: Camera,
    hits: Hits,
    colors: NDArray[np.float32],
    background: tuple[int, int, int],
    headlight: float,
    samples: int,
) -> NDArray[np.uint8]:
    """The picture of colours (H, W, 3), lit, in front of the background, brought down to its size."""
    picture = np.where((hits.face >= 0)[..., None], colors, np.array(background, np.float32))
    if headlight and len(mesh.faces):
        centre = mesh.vertices[mesh.faces].astype(np.float64).mean(axis=1) - camera.centre
        facing = np.abs((mesh.face_normals() * centre).sum(axis=1))
        facing /= np.maximum(np.linalg.norm(centre, axis=1), 1e-12)
        shade = ((1 - headlight) + headlight * facing).astype(np.float32)
        picture *= np.where(hits.face >= 0, shade[np.maximum(hits.face, 0)], 1)[..., None]
    if samples > 1:
        size = (camera.width // samples, camera.height // samples)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)

"""Pictures of a mesh without a graphics card: a z-buffer, vertex colours, a little light from the camera."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT, in_parallel
from unveil_core.geometry.camera import Camera
from unveil_core.mesh.mesh import Mesh

__all__ = ["render_mesh_picture"]

BACKGROUND = (236, 238, 241)
NEAREST = 0.05
BANDS = 8


def render_mesh_picture(
    mesh: Mesh,
    camera: Camera,
    size: tuple[int, int] | None = None,
    *,
    background: tuple[int, int, int] = BACKGROUND,
    headlight: float = 0.35,
    samples: int = 2,
) -> NDArray[np.uint8]:
    """Draw a mesh.

    Args:
        mesh: in the camera's frame of reference.
        camera: the view; triangles that reach behind it are left out.
        size: (width, height) of the picture; the camera's own by default.
        background: sRGB where there is no surface.
        headlight: 0 for the vertex colours as they are, 1 for full shading by the angle to the camera.
        samples: supersampling along each axis.
    Returns:
        (H, W, 3) uint8 sRGB.
    """
    width, height = size if size is not None else (camera.width, camera.height)
    fine = camera.resized(width * samples, height * samples)
    local = mesh.vertices.astype(np.float64) @ fine.world_to_camera[:3, :3].T + fine.world_to_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = local[:, 0] / local[:, 2] * fine.fx + fine.cx
        rows = local[:, 1] / local[:, 2] * fine.fy + fine.cy
    screen = np.stack([columns, rows, local[:, 2]], axis=1)
    centre = local[mesh.faces].mean(axis=1) if len(mesh.faces) else np.zeros((0, 3))
    normal = mesh.face_normals() @ fine.world_to_camera[:3, :3].T
    facing = np.abs((normal * centre).sum(axis=1)) / np.maximum(np.linalg.norm(centre, axis=1), 1e-12)
    shade = (1 - headlight) + headlight * facing
    picture = np.empty((fine.height, fine.width, 3), dtype=np.float32)
    picture[:] = background
    # Every pixel belongs to one band of rows.
    in_parallel(_draw, BANDS, 1, screen, mesh.faces, mesh.colors.astype(np.float32), shade, picture)
    if samples > 1:
        picture = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


@njit(**EXACT)
def _draw(start, stop, screen, faces, colors, shade, picture):
    """Draw the bands of rows from ``start`` to ``stop``, each with a z-buffer of its own."""
    height, width = picture.shape[:2]
    for band in range(start, stop):
        top, bottom = height * band // BANDS, height * (band + 1) // BANDS
        inverse = np.zeros((bottom - top, width), np.float32)
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            za, zb, zc = screen[a, 2], screen[b, 2], screen[c, 2]
            if za < NEAREST or zb < NEAREST or zc < NEAREST:
                continue
            ya, yb, yc = screen[a, 1], screen[b, 1], screen[c, 1]
            y0 = max(top, int(np.ceil(max(min(ya, yb, yc), -1.0) - 0.5)))
            y1 = min(bottom - 1, int(np.floor(min(max(ya, yb, yc), height + 1.0) - 0.5)))
            if y1 < y0:
                continue
            xa, xb, xc = screen[a, 0], screen[b, 0], screen[c, 0]
            x0 = max(0, int(np.ceil(max(min(xa, xb, xc), -1.0) - 0.5)))
            x1 = min(width - 1, int(np.floor(min(max(xa, xb, xc), width + 1.0) - 0.5)))
            area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
            if x1 < x0 or abs(area) < 1e-12:
                continue
            for y in range(y0, y1 + 1):
                py = y + 0.5
                for x in range(x0, x1 + 1):
                    px = x + 0.5
                    wa = ((xb - px) * (yc - py) - (xc - px) * (yb - py)) / area
                    wb = ((xc - px) * (ya - py) - (xa - px) * (yc - py)) / area
                    wc = 1 - wa - wb
                    if wa < -1e-9 or wb < -1e-9 or wc < -1e-9:
                        continue
                    # Colours are linear on the surface, that is in position over depth on the screen.
                    ia, ib, ic = wa / za, wb / zb, wc / zc
                    total = ia + ib + ic
                    if total <= inverse[y - top, x]:
                        continue
                    inverse[y - top, x] = total
                    for k in range(3):
                        value = (ia * colors[a, k] + ib * colors[b, k] + ic * colors[c, k]) / total
                        picture[y, x, k] = value * shade[f]

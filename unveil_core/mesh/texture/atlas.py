"""Where each triangle of a mesh lies in a texture: charts without overlap, packed on pages, by the library xatlas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.mesh.mesh import Mesh

__all__ = ["Atlas", "TexturedMesh", "unwrap"]

PADDING_PX = 4
"""Between charts, for filters and the first levels of smaller copies."""
USED = 0.4
"""Share of a page that the charts of a street cover, about."""
TILE_TRIANGLES = 8_000
"""That are unwrapped together: charts end at the border of such a tile."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """Texture coordinates of a mesh.

    Attributes:
        coordinates: (T, 2) float32, u to the right and v up, in [0, 1] of a page.
        corners: (F, 3) int32, rows of ``coordinates`` of each triangle's corners.
        vertices: (T,) int32, the vertex of the mesh that each row belongs to.
        pages: (F,) int32, the page of each triangle.
        sides: width and height of each page, pixels.
        texel: edge of a texel on the surface, metres.
    """

    coordinates: NDArray[np.float32]
    corners: NDArray[np.int32]
    vertices: NDArray[np.int32]
    pages: NDArray[np.int32]
    sides: Sequence[tuple[int, int]]
    texel: float


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """A mesh with its texture.

    Attributes:
        mesh: with vertex colours, too.
        atlas: its texture coordinates.
        images: of each page, (H, W, 3) uint8 sRGB.
    """

    mesh: Mesh
    atlas: Atlas
    images: Sequence[NDArray[np.uint8]]


def unwrap(mesh: Mesh, side: int, texel: float, most_pages: int) -> Atlas:
    """Unwrap a mesh.

    Args:
        mesh: at least one triangle.
        side: of a page, pixels.
        texel: edge of a texel on the surface, metres; larger where the pages would not suffice.
        most_pages: at most.
    """
    import xatlas  # of the extra "exports"

    texel = max(texel, float(np.sqrt(mesh.area / (USED * most_pages * side * side))))
    tiles = _tiles(mesh)
    while True:
        found = xatlas.Atlas()
        parts = []
        for own in tiles:
            used, local = np.unique(mesh.faces[own], return_inverse=True)
            found.add_mesh(mesh.vertices[used], local.reshape(-1, 3).astype(np.uint32))
            parts.append(used)
        options = xatlas.PackOptions()
        options.resolution, options.texels_per_unit, options.padding = side, 1 / texel, PADDING_PX
        found.generate(xatlas.ChartOptions(), options)
        if found.atlas_count <= most_pages:
            break
        texel *= float(np.sqrt(found.atlas_count / most_pages)) * 1.05
    corners, pages = np.empty((len(mesh.faces), 3), np.int32), np.empty(len(mesh.faces), np.int32)
    vertices, coordinates, first = [], [], 0
    for number, (own, used) in enumerate(zip(tiles, parts, strict=True)):
        old, rows, places = found.get_mesh(number)
        page, _ = found.get_mesh_vertex_assignment(number)
        corners[own] = rows.astype(np.int64) + first
        # Triangles without an area lie on no page of xatlas's; anywhere will do.
        pages[own] = np.maximum(page.astype(np.int32)[rows[:, 0]], 0)
        vertices.append(used[old])
        coordinates.append(places)
        first += len(old)
    # Pages end where the last chart does.
    full, pixels = np.array([found.width, found.height]), np.concatenate(coordinates) * (found.width, found.height)
    size = np.minimum(np.ceil(pixels.max(axis=0)).astype(int) + PADDING_PX, full)
    sides = [(int(size[0]), int(size[1]))] * max(int(found.atlas_count), 1)
    uv = (pixels / size).astype(np.float32)
    return Atlas(uv, corners, np.concatenate(vertices).astype(np.int32), pages, sides, texel)


def _tiles(mesh: Mesh) -> list[NDArray[np.int64]]:
    """The triangles in groups of neighbours, for the time to unwrap grows with the square of a group."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    groups, done = [np.arange(len(mesh.faces))], []
    while groups:
        own = groups.pop()
        if len(own) <= TILE_TRIANGLES:
            done.append(own)
            continue
        axis = int(np.argmax(np.ptp(centres[own], axis=0)))
        order = own[np.argsort(centres[own, axis], kind="stable")]
        groups += [np.sort(order[len(order) // 2 :]), np.sort(order[: len(order) // 2])]
    return done

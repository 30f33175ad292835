"""Textures painted from posed pictures: each texel takes its colour from the pictures that show it best.

As in Waechter, Moehrle and Goesele, *Let there be color!* (2014), a picture counts by how many of its pixels see the
surface, and less where it disagrees with what most pictures say. Here the vertex colours, which were fused of all pictures, say
that: a pole that the mesh lacks is then not painted on the wall behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import sample_at
from unveil_core.geometry.reach import cameras_near, centres_of
from unveil_core.mesh.hits import hit_triangles, interpolated, rasterize
from unveil_core.mesh.mesh import Mesh
from unveil_core.mesh.texture.atlas import PADDING_PX, Atlas, TexturedMesh

__all__ = ["TextureView", "paint"]

FARTHEST_M = 100.0
"""From a camera that a surface is painted at most; no mesh reaches farther."""
SHARPNESS = 4
"""Power of a picture's resolution in its weight: the best picture counts most by far, equal ones are mixed, so there is no seam."""
DISAGREEMENT = 0.15
"""Difference from the vertex colour, of 1, at which a picture counts a third."""
LEAST_TRUST = 1e-3
FLATTEST = 0.1
"""Cosine between the view and the normal below which a picture does not count: it is smeared along the surface there."""
BORDER = 0.04
"""Share of a picture's width over which its weight rises from its border: its frame must not be seen."""
SLACK = 0.005
"""Share of the distance that a texel may lie behind the surface of its pixel."""
SILHOUETTE = 0.9
"""Of a distance: a surface in a neighbouring pixel that is nearer hides what lies there."""


@dataclass(frozen=True, eq=False)
class TextureView:
    """One posed picture.

    Attributes:
        camera: a pinhole with its pose, for which the mesh is drawn to find what is hidden.
        picture: (H, W, 3) float32 in [0, 1], sRGB, of any size and lens.
        locate: from points (N, 3) to their positions in ``picture`` (N, 2), pixels.
        usable: (H, W) bool of the camera's size, where the picture shows the street; None for everywhere.
    """

    camera: Camera
    picture: Float32
    locate: Callable[[Float64], Float64]
    usable: Mask | None = None


@dataclass(eq=False)
class _Texels:
    """The texels of a page that lie in a triangle.

    Attributes:
        index: (N,) in the page; face: (N,); points, normals: (N, 3); plain: (N, 3) colour of the vertices in [0, 1].
        total: (N, 3) weighted colours; weight: (N,).
    """

    index: NDArray[np.int64]
    face: NDArray[np.int32]
    points: Float32
    normals: Float32
    plain: Float32
    total: Float32
    weight: Float32


def paint(
    mesh: Mesh,
    atlas: Atlas,
    cameras: Sequence[Camera],
    views: Sequence[TextureView],
    *,
    progress: Progress = no_progress,
) -> TexturedMesh:
    """Paint the pages of an atlas; where no picture shows a surface, it has the colours of the vertices.

    Args:
        mesh: with vertex colours; atlas: of it.
        cameras: of the views; views: asked for one at a time, once for each page.
        progress: counts pages and views.
    """
    images = []
    for number, side in enumerate(atlas.sides):
        told = part_of(progress, number, len(atlas.sides))
        images.append(_page(mesh, atlas, number, side, cameras, views, told))
    return TexturedMesh(mesh, atlas, images)


def _page(
    mesh: Mesh,
    atlas: Atlas,
    number: int,
    side: tuple[int, int],
    cameras: Sequence[Camera],
    views: Sequence[TextureView],
    progress: Progress,
) -> NDArray[np.uint8]:
    texels = _texels(mesh, atlas, number, side)
    near = cameras_near(centres_of(cameras), texels.points.astype(np.float64), FARTHEST_M)
    for done, i in enumerate(near.tolist()):
        _add(mesh, texels, views[i])
        progress(done + 1, len(near), "painting the texture")
    page = np.zeros((side[1] * side[0], 3), np.float32)
    seen = texels.weight > 0
    colors = texels.plain
    colors[seen] = texels.total[seen] / texels.weight[seen, None]
    page[texels.index] = colors
    inside = np.zeros(side[1] * side[0], bool)
    inside[texels.index] = True
    return _padded(page.reshape(side[1], side[0], 3), inside.reshape(side[1], side[0]))


def _texels(mesh: Mesh, atlas: Atlas, number: int, side: tuple[int, int]) -> _Texels:
    own = np.flatnonzero(atlas.pages == number)
    width, height = side
    flat = np.ones((len(atlas.coordinates), 3))
    flat[:, 0], flat[:, 1] = atlas.coordinates[:, 0] * width, (1 - atlas.coordinates[:, 1]) * height
    hits = rasterize(flat, atlas.corners[own], (height, width))
    index = np.flatnonzero(hits.face.ravel() >= 0)
    face = own[hits.face.ravel()[index]].astype(np.int32)
    corners, weights = mesh.faces[face], hits.weights.reshape(-1, 2)[index]
    count = len(index)
    return _Texels(
        index,
        face,
        interpolated(corners, weights, mesh.vertices),
        mesh.face_normals()[face],
        interpolated(corners, weights, mesh.colors) / np.float32(255),
        np.zeros((count, 3), np.float32),
        np.zeros(count, np.float32),
    )


def _add(mesh: Mesh, texels: _Texels, view: TextureView) -> None:
    """Add what a picture shows of the texels."""
    camera = view.camera
    # Whole triangles are ruled out first: a page has millions of texels, and a picture shows some of them.
    pixels, depth = camera.project(mesh.vertices.astype(np.float64))
    there = (camera.in_picture(pixels, depth) & (depth < FARTHEST_M))[mesh.faces].any(axis=1)
    hits = hit_triangles(mesh, camera)
    # also those whose corners all lie outside
    there[hits.face[hits.face >= 0]] = True  # type: ignore[index]
    some = np.flatnonzero(there[texels.face])  # type: ignore[index]
    points = texels.points[some].astype(np.float64)
    pixels, depth = camera.project(points)
    inside = camera.in_picture(pixels, depth) & (depth < FARTHEST_M)
    some, points, pixels, depth = some[inside], points[inside], pixels[inside], depth[inside]
    ray = points - camera.centre
    cosine = np.abs((ray * texels.normals[some]).sum(axis=1)) / np.maximum(np.linalg.norm(ray, axis=1), 1e-9)
    column, row = np.minimum(pixels.astype(np.int64), [camera.width - 1, camera.height - 1]).T
    inverse = hits.inverse_depth
    pixel = depth / camera.fx / np.maximum(cosine, FLATTEST)  # metres of depth that one pixel more or less makes
    shown = (cosine > FLATTEST) & (inverse[row, column] * (depth - SLACK * depth - pixel) < 1)
    # Beside a silhouette a picture, whose pixels are not the mesh's, may show either side.
    beside = cv2.dilate(inverse, np.ones((3, 3), np.uint8))[row, column]
    shown &= beside * (SILHOUETTE * depth - 2 * pixel) < 1
    if view.usable is not None:
        shown &= view.usable[row, column]
    some, points, pixels, depth, cosine = some[shown], points[shown], pixels[shown], depth[shown], cosine[shown]
    if not len(some):
        return
    found = sample_at(view.picture, view.locate(points))
    edge = np.minimum(pixels, [camera.width, camera.height] - pixels).min(axis=1) / (BORDER * camera.width)
    apart = np.abs(found - texels.plain[some]).mean(axis=1)
    trust = np.maximum(np.exp(-np.square(apart / DISAGREEMENT)), LEAST_TRUST)
    weight = (cosine / np.square(depth)) ** SHARPNESS * np.clip(edge, 1e-3, 1) * trust
    weight = np.maximum(weight, 1e-20).astype(np.float32)
    texels.total[some] += weight[:, None] * found
    texels.weight[some] += weight


def _padded(page: Float32, inside: Mask) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a page, its charts continued over their borders, and their mean colour between them."""
    known, mean = inside.copy(), page[inside].mean(axis=0) if inside.any() else np.zeros(3, np.float32)
    for _ in range(PADDING_PX):
        count = cv2.boxFilter(known.astype(np.float32), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        around = cv2.boxFilter(page, -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        new = ~known & (count > 0.5)
        page[new] = around[new] / count[new, None]
        known |= new
    page[~known] = mean
    painted: NDArray[np.uint8] = np.clip(np.round(page * 255), 0, 255).astype(np.uint8)
    return painted

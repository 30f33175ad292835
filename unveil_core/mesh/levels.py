"""One mesh from fine to coarse: voxels double with the distance that depth is taken from.

A pixel's footprint grows with its distance, and what is far from the whole drive is seen from afar alone. Each coarser level
fuses the same views to a larger distance, and gives only what the finer ones do not have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.kernels.compiled import njit
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.geometry.camera import Camera
from unveil_core.mesh.join import joined
from unveil_core.mesh.mesh import Mesh, drop_small_components, keep_faces
from unveil_core.mesh.tsdf import AROUND, DepthView, fuse, index_among, keys_of, lost

__all__ = ["beyond", "fuse_by_distance"]

SMALLEST_TRIANGLES = 200
"""Of a connected piece, at the finest level; at coarser ones a piece of the same size has a quarter."""


def fuse_by_distance(
    views: Callable[[], Sequence[DepthView]],
    *,
    voxel_size: float,
    distances: Sequence[float],
    region_of: Callable[[NDArray[np.float64]], NDArray[np.int64]],
    cameras: Sequence[Camera],
    scratch: Path,
    cache: FrameCache,
    progress: Progress = no_progress,
) -> Mesh:
    """Fuse depth images into one mesh whose voxels grow with distance.

    Args:
        views: makes them; they are let go of once they lie in files.
        voxel_size: edge of a voxel of the finest level, metres.
        distances: to which depth each level is fused, metres, rising; each has voxels twice as large as the one before.
        region_of, cameras, scratch, cache: see :func:`unveil_core.mesh.tsdf.fuse`.
        progress: counts levels and views.
    """
    finer, sizes = Mesh.empty(), []
    # As ``fuse`` does with regions: the mesh of a long drive is too large to be held twice.
    kept = Kept(scratch / "levels")
    for level, distance in enumerate(distances):
        voxel, smallest = voxel_size * 2**level, SMALLEST_TRIANGLES >> 2 * level
        found = fuse(
            views() if level == 0 else Frames(len(cameras), lost),
            voxel_size=voxel,
            max_depth=distance,
            smallest_triangles=smallest,
            region_of=region_of,
            cameras=cameras,
            scratch=scratch,
            regions_name=f"regions_{level}",
            cache=cache,
            progress=part_of(progress, level, len(distances)),
        )
        part = drop_small_components(beyond(found, finer, voxel), smallest) if level else found
        kept.once(str(level), lambda part=part: vars(part))  # type: ignore[misc]
        sizes.append((len(part.vertices), len(part.faces)))
        # As it was fused: the border of what was taken of it runs along the finer level, too.
        finer = found
        del found, part
    del finer
    return joined((Mesh(**kept.once(str(level), lost)) for level in range(len(sizes))), sizes)


def beyond(coarse: Mesh, fine: Mesh, cell: float) -> Mesh:
    """What a coarse mesh shows and a fine one does not; where they meet, they overlap by a triangle or two.

    Args:
        cell: metres within which a vertex of the fine mesh stands for the coarse surface, about its voxel.
    """
    if not len(fine.vertices) or not len(coarse.faces):
        return coarse
    places = np.floor(coarse.vertices / cell).astype(np.int64)
    covered = _beside(places, fine.vertices, cell)
    # At the border of the fine mesh both go on for a triangle or two: ended at the same line, they would leave a crack.
    covered &= ~_beside(places, fine.vertices[_on_border(fine)], cell)
    return keep_faces(coarse, ~covered[coarse.faces].all(axis=1))  # type: ignore[arg-type]


def _beside(places: NDArray[np.int64], points: NDArray[np.float32], cell: float) -> NDArray[np.bool_]:
    """(N,) bool, which cells (N, 3) are one with a point (P, 3) in it or beside one."""
    found = np.zeros(len(places), dtype=bool)
    if not len(points):
        return found
    taken = np.unique(keys_of(np.floor(points / cell).astype(np.int64)))
    for step in AROUND:
        left = np.flatnonzero(~found)
        found[left] = index_among(taken, keys_of(places[left] + step)) >= 0
    return found


def _on_border(mesh: Mesh) -> NDArray[np.bool_]:
    """(V,) bool, which vertices the triangles do not go around."""
    ends = np.zeros(len(mesh.vertices), np.int64)
    _sum_ends(mesh.faces, ends)
    return ends != 0


@njit(cache=True)
def _sum_ends(faces, ends):  # type: ignore[no-untyped-def]
    """Sum, for each vertex, first less last vertex of the edges opposite to it: 0 where they form rings."""
    for f in range(faces.shape[0]):
        for k in range(3):
            ends[faces[f, k]] += np.int64(faces[f, (k + 1) % 3]) - np.int64(faces[f, (k + 2) % 3])

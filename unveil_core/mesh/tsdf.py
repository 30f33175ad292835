"""Fusion of depth images into one mesh: a truncated signed distance field on sparse blocks of voxels.

Curless and Levoy, *A volumetric method for building complex models from range images* (1996), with blocks allocated
only near what was seen (Niessner et al., *Real-time 3D reconstruction at scale using voxel hashing*, 2013), distances
taken along the surface normal instead of along the ray, so that road seen at a flat angle is not lost, and surface nets
for the triangles.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import cameras_near, centres_of
from unveil_core.mesh import tsdf_kernels as kernels
from unveil_core.mesh.join import joined
from unveil_core.mesh.mesh import Mesh, drop_small_components, keep_faces

__all__ = ["AROUND", "DepthView", "fuse", "index_among", "keys_of", "lost"]

LARGEST_BLOCKS = 400_000
"""Of a region, about 5 GB of voxels: a voxel size that asks for more was a mistake."""
MOST_KEYS = 40_000_000
"""Of all regions, 320 MB of numbers."""
AROUND = [(n // 9 - 1, n // 3 % 3 - 1, n % 3 - 1) for n in range(27)]
"""Steps from a place in a grid to those around it and to itself."""
RIM_JUMP = 1.0
"""Neighbouring voxels that differ by more than this (of 2) are the rim of a silhouette, not a surface."""


@dataclass(frozen=True, eq=False)
class DepthView:
    """One posed depth image.

    Attributes:
        camera: the view.
        depth: (H, W) float, along the optical axis in metres; 0, inf or NaN where there is none.
        rgb: (H, W, 3) float in [0, 1] or uint8, sRGB.
        weight: (H, W) float, how far to trust each pixel; None for 1 everywhere.
    """

    camera: Camera
    depth: NDArray[np.floating]
    rgb: NDArray[np.floating] | NDArray[np.uint8]
    weight: NDArray[np.floating] | None = None


class _Views:
    """Depth views as the kernels want them, in files, for fusing goes through them twice: those of a long drive need gigabytes.

    Args:
        views: each is asked for once.
        cameras: of the views; None = those that the views say themselves, once they were asked for.
        folder: for the files, 11 to 15 bytes a pixel; what lies there from an interrupted attempt is not made again.
        cache: room for views in memory.
    """

    def __init__(
        self, views: Sequence[DepthView], cameras: Sequence[Camera] | None, folder: Path, cache: FrameCache
    ) -> None:
        lenses = self.cameras = [] if cameras is None else list(cameras)
        made: dict[int, NDArray[np.float32]] = {}

        # It does not refer to this object: what the cache holds of the views would stay until somebody looks for circles.
        def make(index: int) -> tuple[NDArray[Any], ...]:
            view = views[index]
            if cameras is None:
                lenses.append(view.camera)
            inverse, *rest = _packed(view, index)
            normals, factor = _slopes(inverse, view.camera)
            made.clear()  # 12 bytes a pixel: those of one view are kept
            made[index] = normals
            return inverse, kernels.flattest_factor(inverse, factor), *rest

        self._normals, self._packed = made, cache.stored(folder, len(views), make)

    def __len__(self) -> int:
        return len(self._packed)

    def read(self, index: int) -> _Prepared:
        """One view; the first time in order."""
        inverse, factor, rgb, *weight = self._packed[index]
        return _Prepared(inverse, factor, rgb, weight[0] if weight else np.ones_like(inverse))

    def normals(self, index: int) -> NDArray[np.float32]:
        """(H, W, 3) of a view that was read, see ``kernels.inverse_depth_slopes``."""
        known = self._normals.pop(index, None)
        return known if known is not None else _slopes(self.read(index).inverse_depth, self.cameras[index])[0]


def _slopes(inverse: NDArray[np.float32], camera: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return kernels.inverse_depth_slopes(inverse, camera.fx, camera.fy, camera.cx, camera.cy)


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A view as the kernels want it.

    Attributes:
        inverse_depth: (H, W), 0 where there is none; factor: (H, W), see ``kernels.flattest_factor``.
        rgb: (H, W, 3); weight: (H, W).
    """

    inverse_depth: NDArray[np.float32]
    factor: NDArray[np.float32]
    rgb: NDArray[np.uint8]
    weight: NDArray[np.float32]


def fuse(
    views: Sequence[DepthView],
    *,
    voxel_size: float,
    truncation: float | None = None,
    bounds: ArrayLike | None = None,
    max_depth: float = 40.0,
    smallest_triangles: int = 200,
    region_of: Callable[[NDArray[np.float64]], NDArray[np.int64]] | None = None,
    cameras: Sequence[Camera] | None = None,
    scratch: Path | None = None,
    regions_name: str = "regions",
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> Mesh:
    """Fuse depth images into a mesh with vertex colours.

    The result is the same, bit for bit, for the same views whatever the number of threads. Where nothing was seen
    there is no surface.

    Args:
        views: posed depth images; each is asked for once, one after the other, and kept in a file of 11 to 15 bytes a pixel.
        voxel_size: edge of a voxel in metres.
        truncation: distance over which a view speaks about space around its surface; 4 voxels by default, at least 2.
        bounds: (2, 3) lowest and highest corner of the space to keep, or None.
        max_depth: depth beyond which a pixel is not used, in metres.
        smallest_triangles: connected pieces of fewer triangles are dropped.
        region_of: numbers of the regions that places (N, 3) lie in; one region after the other is fused, and only one is in
            memory. The mesh is the same; None = all in one.
        cameras: of the views, needed with ``scratch``.
        scratch: folder in which an interrupted attempt finds its views and regions again, the caller's to remove; None = a
            temporary one. It must be given to calls with the same views only.
        regions_name: in ``scratch``, of what hangs on the other arguments, too.
        cache: room for views in memory.
        progress: called once per view, then for the surface.
    Returns:
        the mesh, in the frame of the cameras; empty where nothing was seen.
    Raises:
        SettingsError: a size that cannot work, or one that asks for more memory than is sensible.
    """
    voxel = float(voxel_size)
    band = 4.0 * voxel if truncation is None else float(truncation)
    if not (np.isfinite(voxel) and voxel > 0):
        raise SettingsError(f"voxel_size is {voxel_size}", mend="give a positive length")
    if not (np.isfinite(band) and band >= 2 * voxel):
        raise SettingsError(f"truncation is {truncation}", mend=f"give at least two voxels, {2 * voxel:g}")
    if not (np.isfinite(max_depth) and max_depth > 0):
        raise SettingsError(f"max_depth is {max_depth}", mend="give a positive length")
    box = np.array([[-np.inf] * 3, [np.inf] * 3]) if bounds is None else np.asarray(bounds, dtype=np.float64)
    if box.shape != (2, 3) or not (box[0] < box[1]).all():
        raise SettingsError("bounds must be a lowest and a highest corner", mend="give two rows of three")

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory())) if scratch is None else scratch
        prepared = _Views(views, cameras, folder / "views", FrameCache(0) if cache is None else cache)
        found = _SeenBlocks(voxel, band, float(max_depth), box, LARGEST_BLOCKS if region_of is None else MOST_KEYS)
        total = 2 * len(views) + 2
        for index in range(len(prepared)):
            view = prepared.read(index)
            found.add(prepared.cameras[index], view, prepared.normals(index))
            progress(index + 1, total, "finding surfaces")
        keys = found.keys
        if not len(keys):
            progress(total, total, "fusing depth")
            return Mesh.empty()
        blocks = _places_of(keys)
        region = np.zeros(len(blocks), dtype=np.int64)
        if region_of is not None:
            region = region_of((blocks + 0.5) * voxel * kernels.BLOCK)  # type: ignore[arg-type]
        regions = np.unique(region)
        kept = Kept(folder / regions_name)
        sizes = []
        for done, number in enumerate(regions):
            step = part_of(_from(progress, len(prepared), total), done, len(regions))
            work = partial(_fuse_region, prepared, keys, region == number, voxel, band, float(max_depth), step)
            part = kept.once(str(number), lambda work=work: vars(work()))  # type: ignore[misc]
            sizes.append((len(part["vertices"]), len(part["faces"])))
            del part  # read again when all are joined: the next region needs the memory
        # The views hold the scene that they show, which may be as large as the mesh.
        del views, prepared, found, keys, blocks, region, work
        progress(total - 1, total, "joining the mesh")
        mesh = joined((Mesh(**kept.once(str(number), lost)) for number in regions), sizes)
    if bounds is not None and len(mesh.faces):
        inside = ((mesh.vertices >= box[0]) & (mesh.vertices <= box[1])).all(axis=1)
        mesh = keep_faces(mesh, inside[mesh.faces].all(axis=1))
    mesh = drop_small_components(mesh, smallest_triangles, overwrite=True)
    progress(total, total, f"{len(mesh.faces)} triangles")
    return mesh


def _too_fine(voxel: float, most: int) -> SettingsError:
    return SettingsError(
        f"voxel_size {voxel:g} asks for more than {most:,} blocks of voxels",
        mend="give a larger voxel_size or a smaller max_depth",
    )


def _from(progress: Progress, first: int, total: int) -> Progress:
    """Progress of the second of two passes over views, the first of which took ``first`` of ``total`` units."""

    whole = total

    def told(done: int, total: int, message: str = "", **metrics: float) -> None:
        progress(first + round((whole - 2 - first) * done / max(total, 1)), whole, message, **metrics)

    return told


def _places_of(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """(B, 3) positions of blocks in the grid of blocks."""
    half, mask = kernels.HALF_KEYS, 2 * kernels.HALF_KEYS - 1
    return np.stack([(keys >> 42) - half, (keys >> 21 & mask) - half, (keys & mask) - half], axis=1)


def _fuse_region(
    views: _Views,
    keys: NDArray[np.int64],
    own: NDArray[np.bool_],
    voxel: float,
    band: float,
    max_depth: float,
    progress: Progress,
) -> Mesh:
    """The surface in some of the blocks.

    Args:
        keys: (B,) of all blocks, rising; own: (B,) those whose triangles are wanted.
    """
    if not own.all():
        # The triangles of a block hang on its neighbours' voxels, too.
        around = _neighbours(_places_of(keys[own]), keys)
        wanted = own.copy()
        wanted[around[around >= 0]] = True
        keys, own = keys[wanted], own[wanted]
    if len(keys) > LARGEST_BLOCKS:
        raise _too_fine(voxel, LARGEST_BLOCKS)
    blocks = _places_of(keys)
    size = voxel * kernels.BLOCK
    ends = np.stack([blocks.min(axis=0) * size, (blocks.max(axis=0) + 1) * size])
    furthest = max_depth + band / kernels.SMALLEST_COSINE
    cameras = views.cameras
    # A block counts with its bounding sphere.
    reach = max(c.longest_ray for c in cameras) * (furthest + size) + size
    near = set(cameras_near(centres_of(cameras), ends, reach).tolist())
    volume = np.zeros((len(blocks), kernels.BLOCK**3, 6), dtype=np.float32)
    for done, camera in enumerate(cameras):
        if done in near and len(chosen := _blocks_in_view(blocks, camera, voxel, furthest)):
            view = views.read(done)
            kernels.integrate(
                volume,
                blocks,
                chosen,
                view.inverse_depth,
                view.factor,
                view.weight,
                view.rgb,
                camera.fx,
                camera.fy,
                camera.cx,
                camera.cy,
                camera.world_to_camera,
                voxel,
                band,
                max_depth,
            )
        progress(done + 1, len(views), "fusing depth", blocks=len(blocks))
    return _extract(volume, blocks, keys, voxel, own)


def lost(*_: object) -> Any:
    """What is asked for what lies in files already."""
    raise WorkspaceError("a part of the mesh was removed while it was in use", mend="run it again")


def _packed(view: DepthView, index: int) -> tuple[NDArray[Any], ...]:
    """What is kept of a view: (H, W) float32 inverse depth, 0 where there is none, (H, W, 3) uint8 and, if it has them, weights."""
    size = (view.camera.height, view.camera.width)
    depth = np.asarray(view.depth)
    if depth.shape != size or view.rgb.shape != (*size, 3):
        raise ValueError(f"view {index}: depth {depth.shape} and rgb {view.rgb.shape} must be {size} and {(*size, 3)}")
    if view.weight is not None and view.weight.shape != size:
        raise ValueError(f"view {index}: weight {view.weight.shape} must be {size}")
    usable = np.isfinite(depth) & (depth > 1e-3)
    # Pixels beyond max_depth stay, as neighbours of the nearer ones; the kernels leave them out themselves.
    inverse = np.divide(1.0, depth, out=np.zeros(size, dtype=np.float64), where=usable).astype(np.float32)
    rgb = view.rgb
    if rgb.dtype != np.uint8:
        rgb = np.round(np.clip(np.nan_to_num(rgb), 0, 1) * 255).astype(np.uint8)
    weight = () if view.weight is None else (np.maximum(np.nan_to_num(view.weight).astype(np.float32), 0),)
    return inverse, np.ascontiguousarray(rgb), *weight


class _SeenBlocks:
    """The blocks near surfaces that were seen, in a hash table.

    Args:
        voxel, band: edge of a voxel and truncation, metres; max_depth: of the pixels that count.
        box: (2, 3) the space to keep; most: blocks at most.
    """

    def __init__(self, voxel: float, band: float, max_depth: float, box: NDArray[np.float64], most: int) -> None:
        self._space = (voxel, band, max_depth, box[0], box[1])
        self._voxel, self._most = voxel, most
        self._table = np.full(1 << 16, -1, dtype=np.int64)
        self._count = 0

    def add(self, camera: Camera, view: _Prepared, normals: NDArray[np.float32]) -> None:
        """Those that a view sees, see ``kernels.allocate``."""
        lens = (camera.fx, camera.fy, camera.cx, camera.cy, camera.camera_to_world)
        while True:
            count = kernels.allocate(
                view.inverse_depth, normals, view.factor, *lens, *self._space, self._table, self._count
            )
            if count >= 0:
                self._count = count
                return
            self._count = int(np.count_nonzero(self._table != -1))
            if self._count > self._most:
                raise _too_fine(self._voxel, self._most)
            self._table = kernels.rehash(self._table, 2 * len(self._table))

    @property
    def keys(self) -> NDArray[np.int64]:
        """(B,), rising."""
        keys: NDArray[np.int64] = np.sort(self._table[self._table != -1])
        return keys


def _blocks_in_view(blocks: NDArray[np.int64], camera: Camera, voxel: float, furthest: float) -> NDArray[np.int64]:
    """Indices of blocks whose bounding sphere may meet the view's frustum."""
    size = voxel * kernels.BLOCK
    radius = 0.5 * np.sqrt(3) * size
    local = ((blocks + 0.5) * size) @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    x, y, z = local[:, 0], local[:, 1], local[:, 2]
    inside = (z > -radius) & (z < furthest + radius)
    for across, focal, low, high in (
        (x, camera.fx, -camera.cx, camera.width - camera.cx),
        (y, camera.fy, -camera.cy, camera.height - camera.cy),
    ):
        # Signed distances to the two side planes through the optical centre.
        inside &= focal * across - low * z > -radius * np.hypot(focal, low)
        inside &= focal * across - high * z < radius * np.hypot(focal, high)
    chosen: NDArray[np.int64] = np.flatnonzero(inside)
    return chosen


def _extract(
    volume: NDArray[np.float32],
    blocks: NDArray[np.int64],
    keys: NDArray[np.int64],
    voxel: float,
    own: NDArray[np.bool_],
) -> Mesh:
    """Triangles of the zero level in the blocks that are ``own`` (B,)."""
    neighbours = _neighbours(blocks, keys)
    rank = np.empty(volume.shape[:2], dtype=np.int16)
    counts = kernels.mark_cells(volume, neighbours, np.float32(RIM_JUMP), rank)
    first = np.concatenate([[0], np.cumsum(counts)])
    vertices = np.zeros((int(first[-1]), 3), dtype=np.float32)
    colors = np.zeros((int(first[-1]), 3), dtype=np.float32)
    kernels.place_vertices(volume, neighbours, blocks, rank, first, voxel, vertices, colors)
    quads = np.concatenate([[0], np.cumsum(kernels.count_quads(volume, neighbours, rank, first))])
    faces = np.empty((2 * int(quads[-1]), 3), dtype=np.int32)
    kernels.write_quads(volume, neighbours, rank, first, quads, vertices, faces)
    mesh = Mesh(vertices, faces, np.round(np.clip(colors, 0, 255)).astype(np.uint8))
    return mesh if own.all() else keep_faces(mesh, np.repeat(own, 2 * np.diff(quads)))


def _neighbours(blocks: NDArray[np.int64], keys: NDArray[np.int64]) -> NDArray[np.int32]:
    """(B, 27) indices of the blocks around each block, itself at 13, -1 where there is none."""
    table = np.empty((len(blocks), 27), dtype=np.int32)
    for n, step in enumerate(AROUND):
        table[:, n] = index_among(keys, keys_of(blocks + step))
    return table


def keys_of(places: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) numbers of places (N, 3) in a grid, those by which the kernels know blocks; rising with x, then y, then z."""
    x, y, z = (places + kernels.HALF_KEYS).T
    keys: NDArray[np.int64] = x << 42 | y << 21 | z
    return keys


def index_among(keys: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) where each of ``wanted`` (N,) is in rising ``keys``, at least one; -1 for those that are not."""
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)

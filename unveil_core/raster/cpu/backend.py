"""The CPU backend: the kernels in their order, on arrays. A backend is four steps: project, bin, forward, backward."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.buffers import Buffers, borrow, give_back
from unveil_core.geometry.camera import Camera
from unveil_core.parallel import in_parallel, thread_count
from unveil_core.raster.cpu import kernels as k
from unveil_core.raster.cpu import tiles
from unveil_core.raster.cpu.records import RECORD

__all__ = ["Inputs", "Pass", "Settings", "backward_pass", "forward_pass", "group_for", "release"]

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Inputs = tuple[Float32, Float32, Float32, Float32, Float32]
"""means (N, 3), quats (N, 4), log_scales (N, 2), opacity_logits (N,), sh (N, C, 3): float32, contiguous."""
TILES_AT_ONCE = 8
_templates: dict[tuple[int, str], Float32] = {}
_MEMBERS = {
    "colour": {"rgb", "alpha"},
    "semantic": {"rgb", "alpha", "semantics"},
    "geometry": {"rgb", "alpha", "depth", "median_depth", "normal", "distortion"},
}


def group_for(wanted: Collection[str]) -> str:
    """The cheapest group of kernels that makes all these planes."""
    return next((group for group, members in _MEMBERS.items() if members.issuperset(wanted)), "all")


def _tiles(width: int, height: int) -> tuple[int, int]:
    """How many tiles cover an image, across and down."""
    return -(-width // k.TILE), -(-height // k.TILE)


def _plane_shapes(group: str, width: int, height: int, label_count: int) -> dict[str, tuple[int, ...]]:
    """Shapes in the kernels' order; planes that the group does not make are empty."""
    geometry, semantics, label_distortion, *_ = tiles.GROUPS[group]
    flat = (height, width)
    return {
        "rgb": (*flat, 3),
        "alpha": flat,
        "depth": flat if geometry else (0, 0),
        "median_depth": flat if geometry else (0, 0),
        "normal": (*flat, 3) if geometry else (0, 0, 0),
        "distortion": flat if geometry else (0, 0),
        "semantics": (*flat, label_count) if semantics else (0, 0, 0),
        "label_distortion": flat if label_distortion else (0, 0),
    }


@dataclass(frozen=True)
class Settings:
    """What to render.

    Attributes:
        group: name in ``tiles.GROUPS``.
        label_count: K.
        coefficients: how many spherical-harmonic coefficients are used.
        near, far: world units.
    """

    group: str
    label_count: int
    coefficients: int
    near: float
    far: float


@dataclass(eq=False)
class Pass:
    """One forward pass: its planes, and everything that a backward pass needs of it.

    Attributes:
        planes: every plane of the group by name, fresh arrays in their public shapes.
        visible: (N,) bool.
    """

    planes: dict[str, Float32]
    visible: NDArray[np.bool_]
    buffers: Buffers
    settings: Settings
    camera: Camera
    pose: tuple[Float64, Float64, Float64]
    c1: np.float32
    inv_near: np.float32
    records: Float32
    packed: Float32
    surfel_start: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ids: NDArray[np.int32]
    place: NDArray[np.int32]
    hits: NDArray[np.uint16]
    kept: Float32
    released: bool = False


def forward_pass(inputs: Inputs, labels: NDArray[np.int64], camera: Camera, settings: Settings, *, keep: bool) -> Pass:
    """Render one group of planes.

    Args:
        labels: (N,) int64, contiguous.
        keep: whether a backward pass will follow; if not, the buffers are given back at once.
    """
    buffers = borrow()
    count, width, height = len(labels), camera.width, camera.height
    group, label_count, near, far = settings.group, settings.label_count, settings.near, settings.far
    geometry, semantics, label_distortion, forward, _ = tiles.GROUPS[group]
    pose = (
        np.ascontiguousarray(camera.world_to_camera[:3, :3], dtype=np.float64),
        np.ascontiguousarray(camera.world_to_camera[:3, 3], dtype=np.float64),
        np.ascontiguousarray(camera.centre, dtype=np.float64),
    )
    records = buffers.array("records", (count, RECORD))
    boxes, depths = buffers.array("boxes", (count, 4), np.int16), buffers.array("depths", (count,))
    visible = np.empty(count, np.uint8)
    in_parallel(
        k.project, count, 4096, *inputs, labels, *pose, float(camera.fx), float(camera.fy), float(camera.cx),
        float(camera.cy), width, height, float(near), settings.coefficients, records, boxes, depths, visible,
    )  # fmt: skip
    order = k.depth_order(depths.view(np.uint32), visible)
    packed = buffers.array("packed", (len(order), RECORD))
    in_parallel(k.pack, len(order), 4096, records, order, packed)
    tiles_x, tiles_y = _tiles(width, height)
    surfel_start = buffers.array("surfel_start", (count + 1,), np.int64)
    offsets = buffers.array("offsets", (tiles_x * tiles_y + 1,), np.int64)
    total = k.count_tiles(boxes, visible, tiles_x, tiles_y, surfel_start, offsets)
    if total > np.iinfo(np.int32).max:
        raise ValueError(
            f"{total} surfel-tile intersections in one view; the surfels are too large for this image size"
        )
    ids = buffers.array("ids", (total,), np.int32)
    place = buffers.array("place", (total,), np.int32)
    hits = buffers.array("hits", (total,), np.uint16)
    band = max(1, -(-tiles_y // thread_count()))
    in_parallel(k.fill_tiles, tiles_y, band, order, boxes, tiles_x, surfel_start, offsets, ids, place)
    shapes = _plane_shapes(group, width, height, label_count)
    planes = {name: np.empty(shape, np.float32) for name, shape in shapes.items()}
    kept = buffers.array(
        "kept", (tiles_x * tiles_y if keep else 0, tiles.kept_size(label_count, geometry, label_distortion))
    )
    template = _templates.get((label_count, group))
    if template is None:
        template = _templates[label_count, group] = tiles.template(label_count, geometry, semantics, label_distortion)
    # m = far / (far - near) - c1 / depth is the mapped depth; differences of m need c1 alone.
    c1, inv_near = np.float32(far * near / (far - near)), np.float32(1.0 / near)
    in_parallel(
        forward, tiles_x * tiles_y, TILES_AT_ONCE, tiles_x, template, packed.ravel(), offsets, ids, width, height, c1, inv_near,
        label_count, *planes.values(), kept, hits,
    )  # fmt: skip
    done = Pass(
        planes, visible.view(np.bool_), buffers, settings, camera, pose, c1, inv_near,
        records, packed, surfel_start, offsets, ids, place, hits, kept,
    )  # fmt: skip
    if not keep:
        release(done)
    return done


def backward_pass(done: Pass, grads: Mapping[str, Float32], inputs: Inputs) -> tuple[Float32, ...]:
    """Gradients in the order and shapes of the inputs, then by the projected means (N, 2).

    Args:
        grads: gradient of the loss by each plane that has one, in the plane's shape, contiguous.
    """
    camera, buffers, settings = done.camera, done.buffers, done.settings
    width, height = camera.width, camera.height
    shapes = _plane_shapes(settings.group, width, height, settings.label_count)
    incoming = [grads[name] if name in grads else buffers.zeros(shape) for name, shape in shapes.items()]
    rows = buffers.array("rows", (len(done.ids), tiles.row_size(tiles.GROUPS[settings.group][0])))
    tiles_x, tiles_y = _tiles(width, height)
    in_parallel(
        tiles.GROUPS[settings.group][4], tiles_x * tiles_y, TILES_AT_ONCE, tiles_x, done.packed.ravel(), done.offsets, done.ids, width,
        height, done.c1, done.inv_near, settings.label_count, done.kept, done.hits, *incoming, done.place, rows.ravel(),
    )  # fmt: skip
    gradients = (*(np.empty_like(a) for a in inputs), np.empty((len(done.visible), 2), np.float32))
    in_parallel(
        k.reduce_rows, len(done.visible), 2048, done.records, done.visible.view(np.uint8), done.surfel_start, rows, *inputs,
        *done.pose, float(camera.fx), float(camera.fy), settings.coefficients, *gradients,
    )  # fmt: skip
    return gradients


def release(done: Pass) -> None:
    """Give the pass's buffers back to the pool; what lies in them must not be used afterwards."""
    if not done.released:
        done.released = True
        give_back(done.buffers)

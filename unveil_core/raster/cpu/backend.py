"""The CPU backend: the kernels in their order, on arrays. A backend is four steps: project, bin, forward, backward."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.raster.cpu import kernels as k
from unveil_core.raster.cpu.workspace import Buffers, borrow, give_back

__all__ = ["Pass", "backward_pass", "forward_pass", "release"]

Float32 = NDArray[np.float32]
_templates: dict[int, Float32] = {}


@dataclass(eq=False)
class Pass:
    """Everything that a backward pass needs of its forward pass."""

    buffers: Buffers
    inputs: tuple[Float32, ...]
    camera: Camera
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    label_count: int
    geometry: bool
    labels: bool
    c1: np.float32
    inv_near: np.float32
    order: NDArray[np.int32]
    packed: Float32
    surfel_start: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ids: NDArray[np.int32]
    slot: NDArray[np.int32]
    kept: Float32
    planes: Float32
    visible: NDArray[np.uint8]
    released: bool = False


def forward_pass(
    means: Float32, quats: Float32, scales: Float32, opacity: Float32, rgb: Float32, labels: NDArray[np.int64],
    camera: Camera, *, label_count: int, geometry: bool, with_labels: bool, near: float, far: float,
) -> Pass:  # fmt: skip
    """Render; ``planes`` of the result is (11 + K, H, W), in the order of the ``P_`` constants of the kernels.

    Args:
        means (N, 3), quats (N, 4), scales (N, 2), opacity (N,), rgb (N, 3): float32, contiguous; labels (N,) int64.
        geometry, with_labels: whether depth, normals and distortion, or semantics and label distortion, are wanted.
    """
    buffers = borrow()
    count, width, height = len(means), camera.width, camera.height
    # Poses stay float64: the per-surfel chain is scalar code, and edge-on discs cancel digits there.
    rotation = np.ascontiguousarray(camera.world_to_camera[:3, :3], dtype=np.float64)
    translation = np.ascontiguousarray(camera.world_to_camera[:3, 3], dtype=np.float64)
    records = buffers.array("records", (count, k.RECORD))
    visible = buffers.array("visible", (count,), np.uint8)
    numba.set_parallel_chunksize(4096)
    intrinsics = tuple(np.float32(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy))
    k.project(
        means, quats, scales, opacity, rgb, labels, rotation, translation, *intrinsics, width, height,
        np.float32(near), records, visible,
    )  # fmt: skip
    order = k.depth_order(np.ascontiguousarray(records[:, int(k.R_Z)]).view(np.uint32), visible)
    packed = buffers.array("packed", (len(order), k.RECORD))
    k.pack(records, order, packed)
    tiles_x, tiles_y = -(-width // k.TILE), -(-height // k.TILE)
    surfel_start = buffers.array("surfel_start", (len(order) + 1,), np.int64)
    offsets = buffers.array("offsets", (tiles_x * tiles_y + 1,), np.int64)
    total = k.count_tiles(packed, tiles_x, tiles_y, surfel_start, offsets)
    ids = buffers.array("ids", (total,), np.int32)
    slot = buffers.array("slot", (total,), np.int32)
    numba.set_parallel_chunksize(1)
    k.fill_tiles(packed, tiles_x, tiles_y, surfel_start, offsets, ids, slot, numba.get_num_threads())
    planes = buffers.array("planes", (11 + label_count, height, width))
    kept = buffers.array("kept", (tiles_x * tiles_y, k.kept_size(label_count)))
    if label_count not in _templates:
        _templates[label_count] = k.forward_template(label_count)
    # m = far / (far - near) - c1 / depth is the mapped depth; differences of m need c1 alone.
    c1, inv_near = np.float32(far * near / (far - near)), np.float32(1.0 / near)
    numba.set_parallel_chunksize(4)
    k.forward(
        _templates[label_count], packed, offsets, ids, width, height, c1, inv_near, label_count, geometry, with_labels,
        planes, kept,
    )  # fmt: skip
    return Pass(
        buffers, (means, quats, scales), camera, rotation, translation, label_count, geometry, with_labels, c1,
        inv_near, order, packed, surfel_start, offsets, ids, slot, kept, planes, visible,
    )  # fmt: skip


def backward_pass(done: Pass, grad: Float32) -> tuple[Float32, ...]:
    """Gradients by means (N, 3), quats (N, 4), scales (N, 2), opacity (N,), rgb (N, 3) and projected mean (N, 2).

    Args:
        grad: (11 + K, H, W) gradient of the loss by the planes.
    """
    means, quats, scales = done.inputs
    count, camera = len(means), done.camera
    rows = done.buffers.array("rows", (len(done.ids), k.ROW))
    numba.set_parallel_chunksize(4)
    k.backward(
        done.packed, done.offsets, done.ids, camera.width, camera.height, done.c1, done.inv_near, done.label_count,
        done.geometry, done.labels, done.kept, grad, rows,
    )  # fmt: skip
    shapes = ((count, 3), (count, 4), (count, 2), (count,), (count, 3), (count, 2))
    gradients = tuple(np.zeros(shape, np.float32) for shape in shapes)
    numba.set_parallel_chunksize(2048)
    k.reduce_rows(
        done.packed, done.order, done.surfel_start, done.slot, rows, means, quats, scales, done.rotation,
        done.translation, np.float32(camera.fx), np.float32(camera.fy), *gradients,
    )  # fmt: skip
    return gradients


def release(done: Pass) -> None:
    """Give the pass's buffers back to the pool; its arrays must not be used afterwards."""
    if not done.released:
        done.released = True
        give_back(done.buffers)

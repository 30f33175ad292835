"""The CPU backend: the kernels in their order, on arrays. A backend is four steps: project, bin, forward, backward."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.base.array_pool import Buffers, borrow, give_back, lend
from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.camera import Camera
from unveil_core.raster.cpu import ellipsoids, per_surfel
from unveil_core.raster.cpu.backward import row_size
from unveil_core.raster.cpu.binning import Bins, bin_surfels
from unveil_core.raster.cpu.block import kept_size
from unveil_core.raster.cpu.forward import template
from unveil_core.raster.cpu.groups import kernels_for
from unveil_core.raster.passes import GROUPS, Inputs, Settings, field_of_view, plane_shapes, tile_counts
from unveil_core.raster.records import SIZE as RECORD

__all__ = ["Pass", "backward_pass", "forward_pass", "release"]

TILES_AT_ONCE = 8


@lru_cache(32)
def _start(settings: Settings) -> Float32:
    group = GROUPS[settings.group]
    start: Float32 = template(settings.label_count, *group, settings.limits)
    return start


@dataclass(eq=False)
class Pass:
    """One forward pass: its planes, and everything that a backward pass needs of it.

    Attributes:
        planes: every plane of the group by name, in its public shape.
        visible: (N,) bool.
    """

    planes: dict[str, Tensor]
    visible: Tensor
    buffers: Buffers
    settings: Settings
    camera: Camera
    pose: tuple[Float64, Float64, Float64]
    records: Float32
    bins: Bins
    hits: NDArray[np.uint16]
    kept: Float32
    released: bool = False


def _by_shape(inputs: Inputs, camera: Camera) -> tuple[Any, tuple[float, ...]]:
    """The module that projects surfels with so many scales, and what its kernels are told beside."""
    return (ellipsoids, field_of_view(camera)) if inputs[2].shape[1] == 3 else (per_surfel, ())


def _array(tensor: Tensor) -> NDArray[Any]:
    array: NDArray[Any] = tensor.detach().contiguous().numpy()
    return array


def forward_pass(inputs: Inputs, labels: Tensor, camera: Camera, settings: Settings, *, keep: bool) -> Pass:
    """Render one group of planes.

    Args:
        labels: (N,) int64.
        keep: whether a backward pass will follow; if not, the buffers are given back at once.
    """
    buffers = borrow()
    count, width, height = len(labels), camera.width, camera.height
    label_count, limits = settings.label_count, settings.limits
    group = GROUPS[settings.group]
    pose = (
        np.ascontiguousarray(camera.world_to_camera[:3, :3], dtype=np.float64),
        np.ascontiguousarray(camera.world_to_camera[:3, 3], dtype=np.float64),
        np.ascontiguousarray(camera.centre, dtype=np.float64),
    )
    records = buffers.array("records", (count, RECORD))
    boxes, depths = buffers.array("boxes", (count, 4), np.int16), buffers.array("depths", (count,))
    visible = lend((count,), np.uint8)
    shape, field = _by_shape(inputs, camera)
    in_parallel(
        shape.project,
        count,
        4096,
        *map(_array, inputs),
        _array(labels),
        *pose,
        float(camera.fx),
        float(camera.fy),
        float(camera.cx),
        float(camera.cy),
        width,
        height,
        float(settings.near),
        settings.coefficients,
        limits.alpha_min,
        limits.exact_reach,
        records,
        boxes,
        depths,
        visible,
        *field,
    )
    tiles_x, tiles_y = tile_counts(width, height)
    bins = bin_surfels(depths.view(np.uint32), visible, boxes, (tiles_x, tiles_y), buffers)
    total = len(bins.ids)
    hits = buffers.array("hits", (total,), np.uint16)
    planes = {name: lend(shape) for name, shape in plane_shapes(group, width, height, label_count).items()}
    kept_tiles = tiles_x * tiles_y if keep else 0
    kept = buffers.array("kept", (kept_tiles, kept_size(label_count, group.geometry, group.label_distortion)))
    in_parallel(
        kernels_for(settings.group, limits.exp_degree).forward,
        tiles_x * tiles_y,
        TILES_AT_ONCE,
        tiles_x,
        _start(settings),
        records.ravel(),
        bins.offsets,
        bins.ids,
        width,
        height,
        np.float32(settings.c1),
        np.float32(settings.inv_near),
        np.float32(limits.transmittance_min),
        label_count,
        *planes.values(),
        kept,
        hits,
    )
    done = Pass(
        {name: torch.from_numpy(plane) for name, plane in planes.items()},
        torch.from_numpy(visible.view(np.bool_)),
        buffers,
        settings,
        camera,
        pose,
        records,
        bins,
        hits,
        kept,
    )
    if not keep:
        release(done)
    return done


def backward_pass(done: Pass, grads: Mapping[str, Tensor], inputs: Inputs) -> tuple[Tensor, ...]:
    """Gradients in the order and shapes of the inputs, then by the projected means (N, 2).

    Args:
        grads: gradient of the loss by each plane that has one, in the plane's shape.
    """
    camera, buffers, group = done.camera, done.buffers, GROUPS[done.settings.group]
    settings = done.settings
    width, height, label_count = camera.width, camera.height, settings.label_count
    shapes = plane_shapes(group, width, height, label_count)
    incoming = [_array(grads[name]) if name in grads else buffers.zeros(shape) for name, shape in shapes.items()]
    rows = buffers.array("rows", (len(done.bins.ids), row_size(group.geometry)))
    touched = buffers.array("touched", (len(done.bins.ids),), np.uint8)
    tiles_x, tiles_y = tile_counts(width, height)
    in_parallel(
        kernels_for(settings.group, settings.limits.exp_degree).backward,
        tiles_x * tiles_y,
        TILES_AT_ONCE,
        tiles_x,
        done.records.ravel(),
        done.bins.offsets,
        done.bins.ids,
        width,
        height,
        np.float32(settings.c1),
        np.float32(settings.inv_near),
        np.float32(settings.limits.alpha_min),
        label_count,
        done.kept,
        done.hits,
        *incoming,
        done.bins.place,
        rows.ravel(),
        touched,
    )
    arrays, visible = [_array(t) for t in inputs], _array(done.visible).view(np.uint8)
    gradients = (*(lend(a.shape) for a in arrays), lend((len(visible), 2)))
    shape, field = _by_shape(inputs, camera)
    in_parallel(
        shape.reduce_rows,
        len(visible),
        2048,
        done.records,
        visible,
        done.bins.surfel_start,
        rows,
        touched,
        *arrays,
        *done.pose,
        float(camera.fx),
        float(camera.fy),
        settings.coefficients,
        *gradients,
        *field,
    )
    return tuple(torch.from_numpy(g) for g in gradients)


def release(done: Pass) -> None:
    """Give the pass's buffers back to the pool; what lies in them must not be used afterwards."""
    if not done.released:
        done.released = True
        give_back(done.buffers)

"""The GPU backend: project, bin, forward, backward, on tensors of one device.

Binning is done by torch's own sorts: by depth, then stably by tile. Lists, records and gradient rows are laid out as by
the CPU backend. Nothing here was measured on a GPU: the kernels are checked in Triton's interpreter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.passes import GROUPS, TILE, Inputs, Settings, plane_shapes, tile_counts
from unveil_core.raster.records import SIZE as RECORD
from unveil_core.raster.triton import per_surfel, tiles

__all__ = ["Pass", "backward_pass", "bin_surfels", "forward_pass", "release"]

BLOCK = 128


@dataclass(eq=False)
class Pass:
    """One forward pass: its planes, and what a backward pass needs of it."""

    planes: dict[str, Tensor]
    visible: Tensor
    settings: Settings
    camera: Camera
    pose: Tensor
    records: Tensor
    surfel_start: Tensor
    offsets: Tensor
    ids: Tensor
    place: Tensor
    kept: Tensor
    slots: Tensor


def _pose(camera: Camera, near: float, device: torch.device) -> Tensor:
    values = [*camera.world_to_camera[:3, :3].ravel(), *camera.world_to_camera[:3, 3], *camera.centre]
    values += [camera.fx, camera.fy, camera.cx, camera.cy, near]
    return torch.tensor([float(v) for v in values], dtype=torch.float64, device=device)


def bin_surfels(
    boxes: Tensor, depths: Tensor, visible: Tensor, tiles_x: int, tiles_y: int
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Tile lists in depth order.

    Args:
        boxes: (N, 4) first and last tile column, first and last row. depths: (N,). visible: (N,) bool.
    Returns:
        surfel_start (N + 1,): intersections before each surfel; offsets (T + 1,): and before each tile; ids: the
        surfel of each entry of the lists; place: its gradient row, surfel after surfel.
    """
    device = boxes.device
    shown = visible.nonzero()[:, 0]
    # Ties by index: the sort is stable.
    order = shown[torch.sort(depths[shown], stable=True).indices]
    box = boxes[order].long()
    across, down = box[:, 1] - box[:, 0] + 1, box[:, 3] - box[:, 2] + 1
    count = torch.zeros(len(visible), dtype=torch.int64, device=device)
    count[order] = across * down
    surfel_start = torch.zeros(len(visible) + 1, dtype=torch.int64, device=device)
    surfel_start[1:] = torch.cumsum(count, 0)
    entries = across * down
    owner = torch.repeat_interleave(torch.arange(len(order), device=device), entries)
    within = torch.arange(len(owner), device=device) - (torch.cumsum(entries, 0) - entries)[owner]
    x, y = box[owner, 0] + within % across[owner], box[owner, 2] + within // across[owner]
    tile, by_tile = torch.sort(y * tiles_x + x, stable=True)
    offsets = torch.searchsorted(tile, torch.arange(tiles_x * tiles_y + 1, device=device))
    ids = order[owner[by_tile]]
    place = (surfel_start[order][owner] + within)[by_tile]
    return surfel_start, offsets, ids.to(torch.int32), place


def forward_pass(inputs: Inputs, labels: Tensor, camera: Camera, settings: Settings, *, keep: bool) -> Pass:
    """Render one group of planes; arguments as of the CPU backend. ``keep`` makes no difference here."""
    means, quats, log_scales, opacity_logits, sh = (t.detach().contiguous() for t in inputs)
    device, count, width, height = means.device, len(means), camera.width, camera.height
    group, label_count = GROUPS[settings.group], settings.label_count
    pose = _pose(camera, settings.near, device)
    records = torch.empty(count, RECORD, device=device)
    boxes = torch.empty(count, 4, dtype=torch.int16, device=device)
    depths = torch.empty(count, device=device)
    visible = torch.zeros(count, dtype=torch.uint8, device=device)
    if count:
        per_surfel.project[(-(-count // BLOCK),)](
            means,
            quats,
            log_scales,
            opacity_logits,
            sh,
            labels.contiguous(),
            pose,
            count,
            width,
            height,
            records,
            boxes,
            depths,
            visible,
            COEFFICIENTS=settings.coefficients,
            SH_ROWS=sh.shape[1],
            TILE=TILE,
            BLOCK=BLOCK,
        )
    tiles_x, tiles_y = tile_counts(width, height)
    surfel_start, offsets, ids, place = bin_surfels(boxes, depths, visible.bool(), tiles_x, tiles_y)
    shapes = plane_shapes(group, width, height, label_count)
    planes = {name: torch.empty(shape, device=device) for name, shape in shapes.items()}
    kept = torch.empty(tiles_x * tiles_y, tiles.KEPT.value, tiles.PIXELS.value, device=device)
    slot_tiles = tiles_x * tiles_y if group.semantics else 0
    slots = torch.zeros(slot_tiles, label_count, tiles.SLOT.value, tiles.PIXELS.value, device=device)
    slots[:, :, 1] = 1.0
    tiles.forward[(tiles_x * tiles_y,)](
        records,
        offsets,
        ids,
        tiles_x,
        width,
        height,
        settings.c1,
        settings.inv_near,
        label_count,
        *planes.values(),
        kept,
        slots,
        GEOMETRY=group.geometry,
        SEMANTICS=group.semantics,
        LABELS=group.label_distortion,
    )
    return Pass(planes, visible.bool(), settings, camera, pose, records, surfel_start, offsets, ids, place, kept, slots)


def backward_pass(done: Pass, grads: Mapping[str, Tensor], inputs: Inputs) -> tuple[Tensor, ...]:
    """Gradients in the order and shapes of the inputs, then by the projected means (N, 2)."""
    means, quats, log_scales, opacity_logits, sh = (t.detach().contiguous() for t in inputs)
    camera, group, label_count = done.camera, GROUPS[done.settings.group], done.settings.label_count
    device, count, width, height = means.device, len(means), camera.width, camera.height
    shapes = plane_shapes(group, width, height, label_count)
    incoming = [
        grads[name].contiguous() if name in grads else torch.zeros(shape, device=device)
        for name, shape in shapes.items()
    ]
    row_size, used = (20, 19) if group.geometry else (16, 15)
    rows = torch.empty(len(done.ids), row_size, device=device)
    touched = torch.zeros(len(done.ids), dtype=torch.uint8, device=device)
    tiles_x, tiles_y = tile_counts(width, height)
    behind = torch.zeros(len(done.slots), label_count, tiles.PIXELS.value, device=device)
    # The semantics are out; their place takes each label's transmittance at the end of the list.
    done.slots[:, :, 0] = done.slots[:, :, 1]
    tiles.backward[(tiles_x * tiles_y,)](
        done.records,
        done.offsets,
        done.ids,
        done.place,
        tiles_x,
        width,
        height,
        done.settings.c1,
        done.settings.inv_near,
        label_count,
        done.kept,
        done.slots,
        behind,
        *incoming,
        rows,
        touched,
        GEOMETRY=group.geometry,
        SEMANTICS=group.semantics,
        LABELS=group.label_distortion,
        ROW=row_size,
    )
    gradients = (
        *(torch.empty_like(t) for t in (means, quats, log_scales, opacity_logits, sh)),
        torch.empty(count, 2, device=device),
    )
    if count:
        sums = torch.empty(count, 32, device=device)
        per_surfel.sum_rows[(count,)](done.surfel_start, rows, touched, sums, ROW=row_size, USED=used)
        per_surfel.chain[(-(-count // BLOCK),)](
            means,
            quats,
            log_scales,
            opacity_logits,
            sh,
            done.pose,
            done.records,
            done.visible.to(torch.uint8),
            sums,
            count,
            *gradients,
            COEFFICIENTS=done.settings.coefficients,
            SH_ROWS=sh.shape[1],
            BLOCK=BLOCK,
        )
    return gradients


def release(done: Pass) -> None:
    """Nothing to give back: torch's allocator keeps the memory."""

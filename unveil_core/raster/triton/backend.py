"""The GPU backend: project, bin, forward, backward, on tensors of one device.

Records and gradient rows are laid out as by the CPU backend; lists hold only tiles that a surfel reaches. Checked in Triton's
interpreter and on a card; times are in docs/benchmarks.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.passes import GEOMETRY, GROUPS, TILE, Inputs, Settings, field_of_view, plane_shapes, tile_counts
from unveil_core.raster.records import SIZE as RECORD
from unveil_core.raster.triton import backward, ellipsoids, forward, label_distortion, per_surfel
from unveil_core.raster.triton.binning import Lists, bin_surfels, longest_first
from unveil_core.raster.triton.memory import KEPT, KEPT_FLAT, SUMS

__all__ = [
    "BACKWARD_WARPS",
    "FORWARD_WARPS",
    "FUSED",
    "LABEL_WARPS",
    "Pass",
    "backward_pass",
    "forward_pass",
    "forward_registers",
    "release",
]

BLOCK = 128
PIXELS = TILE * TILE
FORWARD_WARPS, BACKWARD_WARPS, LABEL_WARPS = 4, 2, 2
"""Threads of a tile, in 32s. Few, as each warp loads the same records again and waits at the sums' barriers; forward has more, so
that a thread has registers for two pixels' sums of 19 labels. On an H100 half and twice as many change a pass by -2 to +3 %
(``benchmarks/results/gpu.json``)."""


FUSED = {"enable_fp_fusion": True}
"""A product and a sum in one instruction, asked for by name: from Triton 3.10 on it is not the default, and 3.9 says so at each
start. Only binning goes without, where two kernels must round alike."""
BLACKWELL = 10
"""Compute capability from which on the compiler takes some registers more for the same kernel."""


def forward_registers(labels: int, capability: int) -> int:
    """How many registers a thread of forward may take: enough for its pixels' sums per label. Without a limit the compiler spills
    some values on its own account, to fit one more tile on a multiprocessor.

    Args:
        labels: whose sums are made; capability: the card's, its first number.
    """
    few = 80 if capability < BLACKWELL else 88
    a_tile = 4 * (few if labels <= 8 else 128)
    return min(255, max(64, a_tile // FORWARD_WARPS))


@cache
def _capability(device: torch.device) -> int:
    """The first number of the card's compute capability; in Triton's interpreter that of the oldest."""
    return torch.cuda.get_device_capability(device)[0] if device.type == "cuda" else 8


@dataclass(eq=False)
class Pass:
    """One forward pass: its planes, and what a backward pass needs of it.

    Attributes:
        kept: (T, 2 or 6, 256) see ``forward``; ended: (T,) int32, entries that a pixel of the tile needed.
        by_label: (E,) int32, each tile's needed entries by label; empty without label distortion.
    """

    planes: dict[str, Tensor]
    visible: Tensor
    settings: Settings
    camera: Camera
    pose: Tensor
    records: Tensor
    lists: Lists | None
    kept: Tensor
    ended: Tensor
    by_label: Tensor


def _pose(camera: Camera, near: float, device: torch.device) -> Tensor:
    values = [*camera.world_to_camera[:3, :3].ravel(), *camera.world_to_camera[:3, 3], *camera.centre]
    values += [camera.fx, camera.fy, camera.cx, camera.cy, near, *field_of_view(camera)]
    # From pinned memory, as a copy from any other waits for the GPU.
    pose = torch.tensor([float(v) for v in values], dtype=torch.float64, pin_memory=device.type == "cuda")
    return pose.to(device, non_blocking=True)


def _project(inputs: Inputs, labels: Tensor, camera: Camera, settings: Settings, pose: Tensor) -> tuple[Tensor, ...]:
    """Records, boxes, depths and visibility of the surfels."""
    means, quats, log_scales, opacity_logits, sh = inputs
    device, count = means.device, len(means)
    records = torch.empty(count, RECORD, device=device)
    boxes = torch.empty(count, 4, dtype=torch.int16, device=device)
    depths = torch.empty(count, device=device)
    visible = torch.empty(count, dtype=torch.uint8, device=device)
    if count:
        project = per_surfel.project if log_scales.shape[1] == 2 else ellipsoids.project_ellipsoids
        project[(-(-count // BLOCK),)](
            means,
            quats,
            log_scales,
            opacity_logits,
            sh,
            labels,
            pose,
            count,
            camera.width,
            camera.height,
            records,
            boxes,
            depths,
            visible,
            COEFFICIENTS=settings.coefficients,
            SH_ROWS=sh.shape[1],
            TILE=TILE,
            BLOCK=BLOCK,
            **FUSED,
        )
    return records, boxes, depths, visible


def _planes(settings: Settings, camera: Camera, device: torch.device) -> dict[str, Tensor]:
    """Room for the planes. Semantics lie label after label: neighbours in the image are neighbours in memory."""
    group = GROUPS[settings.group]
    planes = {}
    for name, shape in plane_shapes(group, camera.width, camera.height, settings.label_count).items():
        if name == "semantics":
            planes[name] = torch.empty(shape[2], *shape[:2], device=device).permute(1, 2, 0)
        elif name != "label_distortion" or name in settings.planes:
            planes[name] = torch.empty(shape, device=device)
    return planes


def forward_pass(inputs: Inputs, labels: Tensor, camera: Camera, settings: Settings, *, keep: bool) -> Pass:
    """Render one group of planes; arguments as of the CPU backend."""
    means, quats, log_scales, opacity_logits, sh = (t.detach().contiguous() for t in inputs)
    device, width, height = means.device, camera.width, camera.height
    group, labels = GROUPS[settings.group], labels.contiguous()
    pose = _pose(camera, settings.near, device)
    records, boxes, depths, visible = _project(
        (means, quats, log_scales, opacity_logits, sh), labels, camera, settings, pose
    )
    tiles_x, tiles_y = tile_counts(width, height)
    tile_count = tiles_x * tiles_y
    lists = bin_surfels(records, boxes, depths, visible, tiles_x, tiles_y)
    del boxes, depths
    planes = _planes(settings, camera, device)
    within_labels = group.label_distortion and "label_distortion" in planes
    kept_planes = KEPT if group.geometry else KEPT_FLAT
    keeping = keep or within_labels
    kept = torch.empty(tile_count if keeping else 0, kept_planes, PIXELS, device=device)
    ended = torch.empty(tile_count if keeping else 0, dtype=torch.int32, device=device)
    made = [planes[name] for name in ("rgb", "alpha", "depth", "median_depth", "normal", "distortion", "semantics")]
    label_count = settings.label_count if group.semantics else 0
    forward.forward[(tile_count,)](
        records,
        lists.offsets,
        lists.ids,
        lists.turn,
        tiles_x,
        width,
        height,
        settings.c1,
        settings.inv_near,
        *made,
        kept,
        ended,
        GEOMETRY=group.geometry,
        LABELS=label_count,
        KEEP=keeping,
        KEPT_PLANES=kept_planes,
        num_warps=FORWARD_WARPS,
        maxnreg=forward_registers(label_count, _capability(device)),
        **FUSED,
    )
    done = Pass(
        planes,
        visible.bool(),
        settings,
        camera,
        pose,
        records,
        lists,
        kept,
        ended,
        torch.empty(0, dtype=torch.int32, device=device),
    )
    if within_labels:
        done.by_label = _by_label(done, labels)
        label_distortion.label_forward[(tile_count,)](
            records,
            lists.offsets,
            lists.ids,
            done.by_label,
            lists.turn,
            ended,
            tiles_x,
            width,
            height,
            settings.c1,
            settings.inv_near,
            kept,
            planes["label_distortion"],
            KEPT_PLANES=kept_planes,
            num_warps=LABEL_WARPS,
            **FUSED,
        )
    if keep:
        # The tiles of the entries are known from the offsets, and their order was that of the lists' lengths.
        lists.tiles = lists.tiles.new_empty(0)
        lists.turn = longest_first(ended)
    else:
        done.lists = None
    return done


def _by_label(done: Pass, labels: Tensor) -> Tensor:
    """Entries of each tile by label, those that no pixel needed behind them."""
    lists, label_count = done.lists, done.settings.label_count
    assert lists is not None
    total = len(lists.ids)
    keys = torch.empty(total, dtype=torch.int32, device=lists.ids.device)
    if total:
        label_distortion.label_keys[(-(-total // 256),)](
            lists.tiles,
            lists.ids,
            labels,
            lists.offsets,
            done.ended,
            total,
            keys,
            LABELS=label_count,
            BLOCK=256,
            **FUSED,
        )
    return torch.sort(keys, stable=True).indices.to(torch.int32)


def backward_pass(done: Pass, grads: Mapping[str, Tensor], inputs: Inputs) -> tuple[Tensor, ...]:
    """Gradients in the order and shapes of the inputs, then by the projected means (N, 2)."""
    means, quats, log_scales, opacity_logits, sh = (t.detach().contiguous() for t in inputs)
    camera, lists = done.camera, done.lists
    assert lists is not None
    group = GROUPS[done.settings.group]
    device, count, width, height = means.device, len(means), camera.width, camera.height
    geometry = any(name in grads for name in GEOMETRY)
    shapes = plane_shapes(group, width, height, done.settings.label_count)
    incoming = [
        grads[name].contiguous() if name in grads else torch.zeros(shapes[name] if needed else 0, device=device)
        for name, needed in (("rgb", True), ("alpha", True), *((name, geometry) for name in GEOMETRY))
    ]
    semantics = grads["semantics"].permute(2, 0, 1).contiguous() if "semantics" in grads else incoming[0][:0]
    row = 20 if geometry else 16
    rows = torch.empty(len(lists.ids), row, device=device)
    touched = torch.zeros(len(lists.ids), dtype=torch.uint8, device=device)
    tiles_x, tiles_y = tile_counts(width, height)
    backward.backward[(tiles_x * tiles_y,)](
        done.records,
        lists.offsets,
        lists.ids,
        lists.place,
        lists.turn,
        done.ended,
        tiles_x,
        width,
        height,
        done.settings.c1,
        done.settings.inv_near,
        done.kept,
        *incoming,
        semantics,
        rows,
        touched,
        GEOMETRY=geometry,
        SEMANTICS="semantics" in grads,
        KEPT_PLANES=done.kept.shape[1],
        ROW=row,
        num_warps=BACKWARD_WARPS,
        **FUSED,
    )
    if "label_distortion" in grads:
        label_distortion.label_backward[(tiles_x * tiles_y,)](
            done.records,
            lists.offsets,
            lists.ids,
            done.by_label,
            lists.place,
            lists.turn,
            done.ended,
            tiles_x,
            width,
            height,
            done.settings.c1,
            done.settings.inv_near,
            done.kept,
            grads["label_distortion"].contiguous(),
            rows,
            touched,
            KEPT_PLANES=done.kept.shape[1],
            ROW=row,
            num_warps=LABEL_WARPS,
            **FUSED,
        )
    gradients = (
        *(torch.empty_like(t) for t in (means, quats, log_scales, opacity_logits, sh)),
        torch.empty(count, 2, device=device),
    )
    if count:
        sums = torch.empty(count, SUMS, device=device)
        backward.sum_rows[(count,)](
            lists.start, lists.count, rows, touched, sums, ROW=row, SUMS=SUMS, num_warps=1, **FUSED
        )
        chain = per_surfel.chain if log_scales.shape[1] == 2 else ellipsoids.chain_ellipsoids
        chain[(-(-count // BLOCK),)](
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
            SUMS=SUMS,
            BLOCK=BLOCK,
            **FUSED,
        )
    return gradients


def release(done: Pass) -> None:
    """Nothing to give back: torch's allocator keeps the memory."""

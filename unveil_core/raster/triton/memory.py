"""How many bytes one training step of the Triton backend holds: counted from the sizes of its arrays.

The backend's arrays are counted here one by one; ``tests/raster/triton/test_memory.py`` holds the sum against what torch
allocates. Arrays of the losses are not counted: they are the caller's.
"""

from __future__ import annotations

from collections.abc import Collection
from math import prod

from unveil_core.raster.passes import GEOMETRY, GROUPS, TILE, group_for, plane_shapes, tile_counts
from unveil_core.raster.records import SIZE as RECORD
from unveil_core.raster.spec import PLANES

__all__ = ["KEPT", "KEPT_FLAT", "SHORT_KEYS", "SUMS", "step_bytes"]

PIXELS = TILE * TILE
SUMS, KEPT_FLAT, KEPT = 20, 2, 6
"""Numbers of a surfel's gradient, and planes that a tile keeps, without and with geometry."""
SHORT_KEYS = 2**15
"""From so many tiles on, their numbers need more than 16 bits."""


def step_bytes(
    surfels: int,
    intersections: int,
    width: int,
    height: int,
    labels: int,
    planes: Collection[str] = PLANES,
    *,
    sh_rows: int = 1,
) -> dict[str, int]:
    """Bytes on the device at the peak of one step: forward, backward and Adam.

    Args:
        surfels: N, visible or not. intersections: pairs of a surfel and a tile.
        width, height: pixels. labels: K. planes: names of the planes that are rendered, all with a gradient.
        sh_rows: spherical-harmonic coefficients of a surfel: 1, 4, 9 or 16.
    Returns:
        bytes by part; "peak": the most at one time, as binning and backward do not hold their arrays together. torch's
        allocator rounds up, and keeps what is freed: leave it a tenth more.
    """
    group = GROUPS[group_for(planes)]
    within_labels = "label_distortion" in planes
    across, down = tile_counts(width, height)
    tiles = across * down
    key = 2 if tiles < SHORT_KEYS else 4
    floats = 3 + 4 + 2 + 1 + 3 * sh_rows
    shapes = plane_shapes(group, width, height, labels)
    made = 4 * sum(prod(shape) for name, shape in shapes.items() if name != "label_distortion" or within_labels)
    geometry = any(name in planes for name in GEOMETRY)
    parts = {
        # Trained values and labels (int64); two moments; the gradients and that by the projected means.
        "parameters": surfels * (4 * floats + 8),
        "adam": surfels * 8 * floats,
        "gradients": surfels * (4 * floats + 8),
        # Records, visible, start and count of the rows.
        "surfels": surfels * (4 * RECORD + 1 + 4 + 4),
        # ids, place, by_label; offsets, turn, ended.
        "lists": intersections * (4 + 4 + (4 if within_labels else 0)) + tiles * 12,
        "planes": made,
        "kept": 4 * tiles * PIXELS * (KEPT if group.geometry else KEPT_FLAT),
        # Keys and owners; sorted keys and their int64 order; ids, place. Boxes, depths, visibility as bytes, and the order
        # and sums of the surfels. Before the last are made the first are still there.
        "binning": intersections * (key + 4 + _sort(key)) + surfels * (8 + 4 + 1 + 8 + 8),
        "label_sort": intersections * (4 + _sort(4)) if within_labels else 0,
        "rows": intersections * (4 * (20 if geometry else 16) + 1),
        # Semantics once more: label after label, if their gradient comes otherwise.
        "plane_gradients": made + 4 * prod(shapes["semantics"]),
        "sums": surfels * (4 * SUMS + 1),
    }
    lasting = parts["parameters"] + parts["adam"]
    done = parts["surfels"] + parts["lists"] + parts["planes"] + parts["kept"]
    parts["peak"] = lasting + max(
        parts["surfels"] + parts["lists"] + parts["binning"],
        done + parts["label_sort"],
        done + sum(parts[name] for name in ("plane_gradients", "rows", "sums", "gradients")),
    )
    return parts


def _sort(key: int) -> int:
    """Bytes per entry of torch's sort on CUDA: sorted keys and int64 order, and inside it (read from its source, not measured)
    the order before, and both once more."""
    return (key + 8) + 8 + (key + 8)

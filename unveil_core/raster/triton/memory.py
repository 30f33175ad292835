"""How many bytes one training step of the Triton backend holds: counted from the sizes of its arrays.

The backend's arrays are counted here one by one; ``tests/raster/triton/test_memory.py`` holds the sum against what torch
allocates. Arrays of the losses are not counted: they are the caller's.
"""

from __future__ import annotations

from collections.abc import Collection
from math import prod

from unveil_core.raster.passes import GROUPS, TILE, group_for, plane_shapes, tile_counts
from unveil_core.raster.records import SIZE as RECORD
from unveil_core.raster.spec import PLANES

__all__ = ["step_bytes"]

PIXELS = TILE * TILE


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
        bytes by part; "peak": the most at one time, as binning and backward do not hold their arrays together.
    """
    group = GROUPS[group_for(planes)]
    across, down = tile_counts(width, height)
    tiles = across * down
    floats = 3 + 4 + 2 + 1 + 3 * sh_rows
    made = 4 * sum(prod(shape) for shape in plane_shapes(group, width, height, labels).values())
    slots = tiles * labels * PIXELS if group.semantics else 0
    parts = {
        # Trained values and labels (int64).
        "parameters": surfels * (4 * floats + 8),
        "gradients": surfels * (4 * floats + 8),
        "adam": surfels * 8 * floats,
        # Records, boxes, depths, visible twice, surfel_start.
        "surfels": surfels * (4 * RECORD + 8 + 4 + 2 + 8),
        # ids, place; offsets.
        "lists": intersections * (4 + 8) + 8 * (tiles + 1),
        "planes": made,
        "kept": tiles * 6 * PIXELS * 4,
        "label_state": 4 * slots * 5,
    }
    lasting = sum(parts.values()) - parts["gradients"]
    # owner, within, x, y, the key and its sorted copy with indices, and the index of each sum: int64.
    parts["binning"] = intersections * 8 * 12
    row = 20 if group.geometry else 16
    parts["rows"] = intersections * (4 * row + 1)
    parts["plane_gradients"] = made
    parts["labels_behind"] = 4 * slots
    parts["sums"] = surfels * 4 * 32
    backward = sum(parts[k] for k in ("gradients", "rows", "plane_gradients", "labels_behind", "sums"))
    parts["peak"] = lasting + max(parts["binning"], backward)
    return parts

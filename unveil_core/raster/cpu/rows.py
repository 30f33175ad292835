"""A surfel's record as the tiles read it, and the gradient rows that they give back for it."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import INLINED
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.camera_frame import ZERO
from unveil_core.raster.passes import TILE

__all__ = ["clear", "sum_rows", "write_record"]

f64, i64 = np.float64, np.int64


@njit(**INLINED)
def write_record(
    i,
    cx,
    cy,
    iz,
    a0,
    b0,
    a1,
    b1,
    a2,
    b2,
    opacity,
    red,
    green,
    blue,
    nx,
    ny,
    nz,
    Z,
    label,
    low,
    ex,
    ey,
    e0,
    e1,
    e2,
    x0,
    x1,
    y0,
    y1,
    records,
    boxes,
    depths,
    visible,
):
    """The record of a surfel that can touch the image, its tiles and its depth."""
    records[i, rec.CX] = cx
    records[i, rec.CY] = cy
    rest_x, rest_y = (cx - f64(records[i, rec.CX])) / rec.REST_UNIT, (cy - f64(records[i, rec.CY])) / rec.REST_UNIT
    rest_x = np.floor(min(max(rest_x, -rec.REST_MAX), rec.REST_MAX) + 0.5)
    rest_y = np.floor(min(max(rest_y, -rec.REST_MAX), rec.REST_MAX) + 0.5)
    records[i, rec.REST] = rest_x * rec.REST_BASE + rest_y
    records[i, rec.IZ] = iz
    records[i, rec.A0] = a0
    records[i, rec.B0] = b0
    records[i, rec.A1] = a1
    records[i, rec.B1] = b1
    records[i, rec.A2] = a2
    records[i, rec.B2] = b2
    records[i, rec.OPACITY] = opacity
    records[i, rec.RED] = max(red, 0.0)
    records[i, rec.GREEN] = max(green, 0.0)
    records[i, rec.BLUE] = max(blue, 0.0)
    records[i, rec.NX] = nx
    records[i, rec.NY] = ny
    records[i, rec.NZ] = nz
    records[i, rec.Z] = Z
    records[i, rec.EX] = ex
    records[i, rec.EY] = ey
    records[i, rec.E0] = e0
    records[i, rec.E1] = e1
    records[i, rec.E2] = e2
    records[i, rec.LABEL_LOW] = rec.LOW_RANGE * label + low
    boxes[i, 0], boxes[i, 1] = i64(x0) // TILE, (i64(x1) - 1) // TILE
    boxes[i, 2], boxes[i, 3] = i64(y0) // TILE, (i64(y1) - 1) // TILE
    depths[i] = Z
    visible[i] = 1


@njit(**INLINED)
def sum_rows(n, surfel_start, rows, touched, a):
    """A surfel's rows summed in a fixed order, into ``a`` (20,); see ``backward.row_size``."""
    for k in range(len(a)):
        a[k] = ZERO
    for s in range(surfel_start[n], surfel_start[n + 1]):
        if touched[s]:
            for k in range(rows.shape[1]):
                a[k] += rows[s, k]


@njit(**INLINED)
def clear(n, g_means, g_quats, g_log_scales, g_opacity_logits, g_sh, g_screen):
    """No gradient, for a surfel off the screen."""
    for k in range(g_sh.shape[1]):
        for c in range(3):
            g_sh[n, k, c] = ZERO
    for k in range(3):
        g_means[n, k] = ZERO
    for k in range(4):
        g_quats[n, k] = ZERO
    for k in range(g_log_scales.shape[1]):
        g_log_scales[n, k] = ZERO
    for k in range(2):
        g_screen[n, k] = ZERO
    g_opacity_logits[n] = ZERO

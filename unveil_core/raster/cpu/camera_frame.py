"""Where a surfel lies in the camera's frame, how it is turned and how large; and what it covers of the image.

Float64 between the parameters and the records: edge-on discs cancel digits there.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import INLINED
from unveil_core.raster.spec import EDGE_ON, LOG_SCALE_MAX

__all__ = [
    "ZERO",
    "axes",
    "clipped_extent",
    "held_scale",
    "in_camera",
    "pixel_range",
    "quaternion_gradient",
    "rotation",
    "seen_from",
]

f32, f64 = np.float32, np.float64
ZERO = f32(0)


@njit(**INLINED)
def in_camera(means, i, R, t):
    """A surfel's centre in the camera's frame."""
    return (
        R[0, 0] * means[i, 0] + R[0, 1] * means[i, 1] + R[0, 2] * means[i, 2] + t[0],
        R[1, 0] * means[i, 0] + R[1, 1] * means[i, 1] + R[1, 2] * means[i, 2] + t[1],
        R[2, 0] * means[i, 0] + R[2, 1] * means[i, 1] + R[2, 2] * means[i, 2] + t[2],
    )


@njit(**INLINED)
def rotation(q0, q1, q2, q3):
    """Inverse norm, unit quaternion and the nine entries of its rotation; a zero quaternion is no rotation."""
    norm = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    tiny = norm < 1e-24
    inverse = 0.0 if tiny else 1.0 / np.sqrt(norm)
    w = 1.0 if tiny else q0 * inverse
    x, y, z = q1 * inverse, q2 * inverse, q3 * inverse
    return (
        inverse,
        w,
        x,
        y,
        z,
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@njit(**INLINED)
def axes(R, r0, r1, r2, r3, r4, r5, r6, r7, r8):
    """A rotation's three columns in the camera's frame: both tangents, then the normal."""
    return (
        R[0, 0] * r0 + R[0, 1] * r3 + R[0, 2] * r6,
        R[1, 0] * r0 + R[1, 1] * r3 + R[1, 2] * r6,
        R[2, 0] * r0 + R[2, 1] * r3 + R[2, 2] * r6,
        R[0, 0] * r1 + R[0, 1] * r4 + R[0, 2] * r7,
        R[1, 0] * r1 + R[1, 1] * r4 + R[1, 2] * r7,
        R[2, 0] * r1 + R[2, 1] * r4 + R[2, 2] * r7,
        R[0, 0] * r2 + R[0, 1] * r5 + R[0, 2] * r8,
        R[1, 0] * r2 + R[1, 1] * r5 + R[1, 2] * r8,
        R[2, 0] * r2 + R[2, 1] * r5 + R[2, 2] * r8,
    )


@njit(**INLINED)
def held_scale(log_scale, floor):
    """The standard deviation within its limits, and its derivative by the logarithm: itself, or zero at a limit."""
    scale = np.exp(min(f64(log_scale), LOG_SCALE_MAX))
    slope = scale if log_scale < LOG_SCALE_MAX else 0.0
    return (scale, slope) if scale > floor else (floor, 0.0)


@njit(**INLINED)
def seen_from(X, Y, Z, nx, ny, nz):
    """Distance to the camera, whether a disc is seen from its edge, and -1 where its normal must turn, else 1."""
    facing = nx * X + ny * Y + nz * Z
    distance = np.sqrt(X * X + Y * Y + Z * Z)
    edge_on = abs(facing) < EDGE_ON * distance
    return distance, edge_on, -1.0 if facing > 0.0 and not edge_on else 1.0


@njit(**INLINED)
def clipped_extent(g0, g1, h0, h1, Z, near, k2):
    """Least and greatest slope (offset from the projected mean over depth) of a disc cut at the near plane.

    The disc is ``{s: |s|^2 <= k2}`` at depth ``Z + h . s``, its offset times depth is ``g . s``. The extremes of such
    a ratio over a convex region lie on its boundary: at the ends of the chord depth = near, or where a line through
    the eye touches the arc.
    """
    hh = h0 * h0 + h1 * h1
    h = np.sqrt(hh)
    along = (near - Z) / hh
    across = np.sqrt(max(k2 - along * along * hh, 0.0)) / h
    middle, swing = along * (g0 * h0 + g1 * h1) / near, abs(across * (g1 * h0 - g0 * h1)) / near
    low, high = middle - swing, middle + swing
    A, B, C = Z * Z - k2 * hh, k2 * (g0 * h0 + g1 * h1), -k2 * (g0 * g0 + g1 * g1)
    discriminant = B * B - A * C
    if discriminant > 0.0:
        root = -(B + np.sqrt(discriminant)) if B > 0.0 else np.sqrt(discriminant) - B
        for turn in range(2):
            top, bottom = (root, A) if turn == 0 else (C, root)
            if abs(bottom) > 1e-12 * abs(top):
                slope = top / bottom
                n0, n1 = g0 - slope * h0, g1 - slope * h1
                nn = n0 * n0 + n1 * n1
                if nn > 0.0:
                    touch = slope * Z / nn
                    if Z + touch * (h0 * n0 + h1 * n1) >= near:
                        low, high = min(low, slope), max(high, slope)
    return low, high


@njit(**INLINED)
def pixel_range(cx, cy, x0, x1, y0, y1, width, height):
    """First and past-the-last column and row of the image within bounds about the projected mean."""
    # Pixels whose centre lies within, a thousandth generous for float32.
    x0, x1 = np.floor(max(cx + x0, 0.0) + 0.499), np.floor(min(cx + x1, f64(width)) + 0.501)
    y0, y1 = np.floor(max(cy + y0, 0.0) + 0.499), np.floor(min(cy + y1, f64(height)) + 0.501)
    return x0, min(x1, f64(width)), y0, min(y1, f64(height))


@njit(**INLINED)
def quaternion_gradient(n, R, inverse, w, x, y, z, h00, h01, h02, h10, h11, h12, h20, h21, h22, g_quats):
    """The gradient by a rotation's three columns in the camera's frame, back to its quaternion."""
    G0 = R[0, 0] * h00 + R[1, 0] * h01 + R[2, 0] * h02
    G3 = R[0, 1] * h00 + R[1, 1] * h01 + R[2, 1] * h02
    G6 = R[0, 2] * h00 + R[1, 2] * h01 + R[2, 2] * h02
    G1 = R[0, 0] * h10 + R[1, 0] * h11 + R[2, 0] * h12
    G4 = R[0, 1] * h10 + R[1, 1] * h11 + R[2, 1] * h12
    G7 = R[0, 2] * h10 + R[1, 2] * h11 + R[2, 2] * h12
    G2 = R[0, 0] * h20 + R[1, 0] * h21 + R[2, 0] * h22
    G5 = R[0, 1] * h20 + R[1, 1] * h21 + R[2, 1] * h22
    G8 = R[0, 2] * h20 + R[1, 2] * h21 + R[2, 2] * h22
    gw = 2.0 * (x * (G7 - G5) + y * (G2 - G6) + z * (G3 - G1))
    gx = 2.0 * (-2.0 * x * (G4 + G8) + y * (G1 + G3) + z * (G2 + G6) + w * (G7 - G5))
    gy = 2.0 * (x * (G1 + G3) - 2.0 * y * (G0 + G8) + z * (G5 + G7) + w * (G2 - G6))
    gz = 2.0 * (x * (G2 + G6) + y * (G5 + G7) - 2.0 * z * (G0 + G4) + w * (G3 - G1))
    along = gw * w + gx * x + gy * y + gz * z
    g_quats[n, 0] = (gw - along * w) * inverse
    g_quats[n, 1] = (gx - along * x) * inverse
    g_quats[n, 2] = (gy - along * y) * inverse
    g_quats[n, 3] = (gz - along * z) * inverse

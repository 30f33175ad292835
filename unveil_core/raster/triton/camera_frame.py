"""What discs and ellipsoids share on the GPU: pose, rotation, colour, the record, and the gradients of these.

float64 between the parameters and the records, as in ``cpu.per_surfel``.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster import records as rec
from unveil_core.raster import spec
from unveil_core.raster import spherical_harmonics as harmonics

__all__ = [
    "column",
    "colour",
    "colour_gradient",
    "held_scale",
    "in_camera",
    "opacity_of",
    "pixel_range",
    "quaternion_gradient",
    "rotation",
    "row",
    "store",
    "sum_at",
    "write_record",
]

# ``pose`` is 24 float64 of a view: rotation (9), translation (3), eye (3), fx, fy, cx, cy, near, and the field of view of
# ``passes.field_of_view``.
LOG_SCALE_MAX = tl.constexpr(spec.LOG_SCALE_MAX)
SIZE, LOW_RANGE = tl.constexpr(rec.SIZE), tl.constexpr(rec.LOW_RANGE)
REST_UNIT, REST_BASE, REST_MAX = tl.constexpr(rec.REST_UNIT), tl.constexpr(rec.REST_BASE), tl.constexpr(rec.REST_MAX)
SH0, SH1 = tl.constexpr(harmonics.SH0), tl.constexpr(harmonics.SH1)
SH20, SH21, SH22, SH23, SH24 = (tl.constexpr(c) for c in harmonics.SH2)
SH30, SH31, SH32, SH33, SH34, SH35, SH36 = (tl.constexpr(c) for c in harmonics.SH3)


@triton.jit
def _basis(K: tl.constexpr, x, y, z):
    """The K-th basis function at a unit direction, and its slopes by x, y and z."""
    xx, yy, zz, o = x * x, y * y, z * z, x * 0.0
    if K == 0:
        b, bx, by, bz = o + SH0, o, o, o
    elif K == 1:
        b, bx, by, bz = -SH1 * y, o, o - SH1, o
    elif K == 2:
        b, bx, by, bz = SH1 * z, o, o, o + SH1
    elif K == 3:
        b, bx, by, bz = -SH1 * x, o - SH1, o, o
    elif K == 4:
        b, bx, by, bz = SH20 * x * y, SH20 * y, SH20 * x, o
    elif K == 5:
        b, bx, by, bz = SH21 * y * z, o, SH21 * z, SH21 * y
    elif K == 6:
        b, bx, by, bz = SH22 * (2.0 * zz - xx - yy), -2.0 * SH22 * x, -2.0 * SH22 * y, 4.0 * SH22 * z
    elif K == 7:
        b, bx, by, bz = SH23 * x * z, SH23 * z, o, SH23 * x
    elif K == 8:
        b, bx, by, bz = SH24 * (xx - yy), 2.0 * SH24 * x, -2.0 * SH24 * y, o
    elif K == 9:
        b, bx, by, bz = SH30 * y * (3.0 * xx - yy), 6.0 * SH30 * x * y, 3.0 * SH30 * (xx - yy), o
    elif K == 10:
        b, bx, by, bz = SH31 * x * y * z, SH31 * y * z, SH31 * x * z, SH31 * x * y
    elif K == 11:
        b, bx = SH32 * y * (4.0 * zz - xx - yy), -2.0 * SH32 * x * y
        by, bz = SH32 * (4.0 * zz - xx - 3.0 * yy), 8.0 * SH32 * y * z
    elif K == 12:
        b, bx = SH33 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy), -6.0 * SH33 * x * z
        by, bz = -6.0 * SH33 * y * z, SH33 * (6.0 * zz - 3.0 * xx - 3.0 * yy)
    elif K == 13:
        b, bx = SH34 * x * (4.0 * zz - xx - yy), SH34 * (4.0 * zz - 3.0 * xx - yy)
        by, bz = -2.0 * SH34 * x * y, 8.0 * SH34 * x * z
    elif K == 14:
        b, bx, by, bz = SH35 * z * (xx - yy), 2.0 * SH35 * x * z, -2.0 * SH35 * y * z, SH35 * (xx - yy)
    else:
        b, bx, by, bz = SH36 * x * (xx - 3.0 * yy), 3.0 * SH36 * (xx - yy), -6.0 * SH36 * x * y, o
    # The zero in front makes tensors of what the interpreter takes for constants.
    return o + b, o + bx, o + by, o + bz


@triton.jit
def rotation(q0, q1, q2, q3):
    """Inverse norm, unit quaternion and the nine entries of its rotation; a zero quaternion is no rotation."""
    norm = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3
    tiny = norm < 1e-24
    inverse = tl.where(tiny, 0.0, 1.0 / tl.sqrt(tl.where(tiny, 1.0, norm)))
    w = tl.where(tiny, 1.0, q0 * inverse)
    x, y, z = q1 * inverse, q2 * inverse, q3 * inverse
    r0, r1, r2 = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    r3, r4, r5 = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    r6, r7, r8 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8


@triton.jit
def held_scale(log_scale, floor):
    """The standard deviation within its limits, and its derivative by the logarithm: itself, or zero at a limit."""
    scale = tl.exp(tl.minimum(log_scale, LOG_SCALE_MAX))
    slope = tl.where(log_scale < LOG_SCALE_MAX, scale, 0.0)
    return tl.where(scale > floor, scale, floor), tl.where(scale > floor, slope, 0.0)


@triton.jit
def row(pose, K: tl.constexpr, a, b, c):
    return tl.load(pose + K) * a + tl.load(pose + K + 1) * b + tl.load(pose + K + 2) * c


@triton.jit
def column(pose, K: tl.constexpr, a, b, c):
    return tl.load(pose + K) * a + tl.load(pose + K + 3) * b + tl.load(pose + K + 6) * c


@triton.jit
def store(at, K: tl.constexpr, value, mask):
    tl.store(at + K, value.to(tl.float32), mask)


@triton.jit
def sum_at(at, K: tl.constexpr, mask):
    return tl.load(at + K, mask, 0.0).to(tl.float64)


@triton.jit
def in_camera(means, pose, i, mask):
    """A centre in the camera's frame, and less the eye in the world's."""
    m0, m1, m2 = (
        tl.load(means + 3 * i, mask, 0.0).to(tl.float64),
        tl.load(means + 3 * i + 1, mask, 0.0).to(tl.float64),
        tl.load(means + 3 * i + 2, mask, 1.0).to(tl.float64),
    )
    X, Y = row(pose, 0, m0, m1, m2) + tl.load(pose + 9), row(pose, 3, m0, m1, m2) + tl.load(pose + 10)
    Z = row(pose, 6, m0, m1, m2) + tl.load(pose + 11)
    return X, Y, Z, m0 - tl.load(pose + 12), m1 - tl.load(pose + 13), m2 - tl.load(pose + 14)


@triton.jit
def opacity_of(opacity_logits, i, mask):
    """The sigmoid."""
    logit = tl.load(opacity_logits + i, mask, -100.0).to(tl.float64)
    return 1.0 / (1.0 + tl.exp(tl.minimum(-logit, 700.0)))


@triton.jit
def pixel_range(cx, cy, x0, x1, y0, y1, width, height):
    """As ``cpu.per_surfel.pixel_range``, within the image: large numbers fit no integer."""
    x0 = tl.minimum(tl.floor(tl.maximum(cx + x0, 0.0) + 0.499), width)
    y0 = tl.minimum(tl.floor(tl.maximum(cy + y0, 0.0) + 0.499), height)
    x1 = tl.floor(tl.maximum(tl.minimum(cx + x1, width), -1.0) + 0.501)
    y1 = tl.floor(tl.maximum(tl.minimum(cy + y1, height), -1.0) + 0.501)
    return x0, tl.minimum(x1, width), y0, tl.minimum(y1, height)


@triton.jit
def colour(sh, i, mask, dx, dy, dz, COEFFICIENTS: tl.constexpr, SH_ROWS: tl.constexpr):
    """Red, green and blue seen in a unit direction, before the clamp at zero."""
    red, green, blue = dx * 0.0 + 0.5, dx * 0.0 + 0.5, dx * 0.0 + 0.5
    for k in tl.static_range(COEFFICIENTS):
        b, _, _, _ = _basis(k, dx, dy, dz)
        at = sh + (i * SH_ROWS + k) * 3
        red += b * tl.load(at, mask, 0.0)
        green += b * tl.load(at + 1, mask, 0.0)
        blue += b * tl.load(at + 2, mask, 0.0)
    return red, green, blue


@triton.jit
def colour_gradient(
    records, sums, sh, g_sh, n, here, seen, dx, dy, dz, far, SUMS: tl.constexpr, COEFFICIENTS: tl.constexpr, SH_ROWS: tl.constexpr
):  # fmt: skip
    """Store the gradient by the coefficients; returns that by the centre, as the direction turns with it."""
    at, record = sums + n * SUMS, records + n * SIZE
    # No gradient where the clamp at zero held the colour.
    red = tl.where(tl.load(record + 10, seen, 0.0) > 0.0, sum_at(at, 10, seen), 0.0)
    green = tl.where(tl.load(record + 11, seen, 0.0) > 0.0, sum_at(at, 11, seen), 0.0)
    blue = tl.where(tl.load(record + 12, seen, 0.0) > 0.0, sum_at(at, 12, seen), 0.0)
    gx, gy, gz = dx * 0.0, dx * 0.0, dx * 0.0
    for k in tl.static_range(SH_ROWS):
        of_k = (n * SH_ROWS + k) * 3
        if k < COEFFICIENTS:
            b, bx, by, bz = _basis(k, dx, dy, dz)
            weight = red * tl.load(sh + of_k, seen, 0.0) + green * tl.load(sh + of_k + 1, seen, 0.0)
            weight += blue * tl.load(sh + of_k + 2, seen, 0.0)
            gx, gy, gz = gx + weight * bx, gy + weight * by, gz + weight * bz
        else:
            b = dx * 0.0
        store(g_sh + of_k, 0, b * red, here)
        store(g_sh + of_k, 1, b * green, here)
        store(g_sh + of_k, 2, b * blue, here)
    radial = gx * dx + gy * dy + gz * dz
    return (gx - radial * dx) / far, (gy - radial * dy) / far, (gz - radial * dz) / far


@triton.jit
def quaternion_gradient(
    pose, g_quats, n, here, seen, inverse, w, x, y, z, h00, h01, h02, h10, h11, h12, h20, h21, h22
):  # fmt: skip
    """Store the gradient by the quaternion, from that by the rotation's three columns in the camera's frame."""
    G0, G3, G6 = column(pose, 0, h00, h01, h02), column(pose, 1, h00, h01, h02), column(pose, 2, h00, h01, h02)
    G1, G4, G7 = column(pose, 0, h10, h11, h12), column(pose, 1, h10, h11, h12), column(pose, 2, h10, h11, h12)
    G2, G5, G8 = column(pose, 0, h20, h21, h22), column(pose, 1, h20, h21, h22), column(pose, 2, h20, h21, h22)
    gw = 2.0 * (x * (G7 - G5) + y * (G2 - G6) + z * (G3 - G1))
    gx = 2.0 * (-2.0 * x * (G4 + G8) + y * (G1 + G3) + z * (G2 + G6) + w * (G7 - G5))
    gy = 2.0 * (x * (G1 + G3) - 2.0 * y * (G0 + G8) + z * (G5 + G7) + w * (G2 - G6))
    gz = 2.0 * (x * (G2 + G6) + y * (G5 + G7) - 2.0 * z * (G0 + G4) + w * (G3 - G1))
    along = gw * w + gx * x + gy * y + gz * z
    store(g_quats + 4 * n, 0, tl.where(seen, (gw - along * w) * inverse, 0.0), here)
    store(g_quats + 4 * n, 1, tl.where(seen, (gx - along * x) * inverse, 0.0), here)
    store(g_quats + 4 * n, 2, tl.where(seen, (gy - along * y) * inverse, 0.0), here)
    store(g_quats + 4 * n, 3, tl.where(seen, (gz - along * z) * inverse, 0.0), here)


@triton.jit
def write_record(
    i, seen, here, cx, cy, Z, a0, b0, a1, b1, a2, b2, opacity, red, green, blue, nx, ny, nz, label, low, ex, ey, e0, e1, e2,
    x0, x1, y0, y1, records, boxes, depths, visible, TILE: tl.constexpr,
):  # fmt: skip
    """Store a surfel's record (see ``raster.records``; ``low`` is squared), box of tiles, depth and visibility."""
    at = records + i * SIZE
    rest_x = (cx - cx.to(tl.float32).to(tl.float64)) / REST_UNIT
    rest_y = (cy - cy.to(tl.float32).to(tl.float64)) / REST_UNIT
    rest_x = tl.floor(tl.minimum(tl.maximum(rest_x, -REST_MAX), REST_MAX) + 0.5)
    rest_y = tl.floor(tl.minimum(tl.maximum(rest_y, -REST_MAX), REST_MAX) + 0.5)
    store(at, 0, cx, seen)
    store(at, 1, cy, seen)
    store(at, 2, 1.0 / Z, seen)
    store(at, 3, a0, seen)
    store(at, 4, b0, seen)
    store(at, 5, a1, seen)
    store(at, 6, b1, seen)
    store(at, 7, a2, seen)
    store(at, 8, b2, seen)
    store(at, 9, opacity, seen)
    store(at, 10, tl.maximum(red, 0.0), seen)
    store(at, 11, tl.maximum(green, 0.0), seen)
    store(at, 12, tl.maximum(blue, 0.0), seen)
    store(at, 13, nx, seen)
    store(at, 14, ny, seen)
    store(at, 15, nz, seen)
    store(at, 16, Z, seen)
    store(at, 17, label * LOW_RANGE + low, seen)
    store(at, 18, ex, seen)
    store(at, 19, ey, seen)
    store(at, 20, e0, seen)
    store(at, 21, e1, seen)
    store(at, 22, e2, seen)
    store(at, 23, rest_x * REST_BASE + rest_y, seen)
    tl.store(boxes + 4 * i, (x0.to(tl.int32) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 1, ((x1.to(tl.int32) - 1) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 2, (y0.to(tl.int32) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 3, ((y1.to(tl.int32) - 1) // TILE).to(tl.int16), seen)
    tl.store(depths + i, tl.where(seen, Z.to(tl.float32), float("inf")), here)
    tl.store(visible + i, seen.to(tl.uint8), here)

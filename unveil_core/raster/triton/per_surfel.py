"""What is done per surfel on the GPU: project, and carry gradients back. The same arithmetic as ``cpu.per_surfel``.

float64 between the parameters and the records, as there: edge-on discs cancel digits.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster import records as rec
from unveil_core.raster import spec
from unveil_core.raster import spherical_harmonics as harmonics

__all__ = ["chain", "project"]

# ``pose`` is 20 float64 of a view: rotation (9), translation (3), eye (3), fx, fy, cx, cy, near.
ALPHA_MIN, DEPTH_MAX, EDGE_ON = tl.constexpr(spec.ALPHA_MIN), tl.constexpr(spec.DEPTH_MAX), tl.constexpr(spec.EDGE_ON)
LOG_SCALE_MAX, OFFSET_MAX = tl.constexpr(spec.LOG_SCALE_MAX), tl.constexpr(spec.OFFSET_MAX)
SCALE_MIN_PX, GENEROUS = tl.constexpr(spec.SCALE_MIN_PX), tl.constexpr(spec.GENEROUS)
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
def _rotation(q0, q1, q2, q3):
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
def _held_scale(log_scale, floor):
    """The standard deviation within its limits, and its derivative by the logarithm: itself, or zero at a limit."""
    scale = tl.exp(tl.minimum(log_scale, LOG_SCALE_MAX))
    slope = tl.where(log_scale < LOG_SCALE_MAX, scale, 0.0)
    return tl.where(scale > floor, scale, floor), tl.where(scale > floor, slope, 0.0)


@triton.jit
def _disc(means, quats, log_scales, pose, i, mask):
    """A surfel in the camera's frame, for project and for its gradient."""
    m0, m1, m2 = (
        tl.load(means + 3 * i, mask, 0.0).to(tl.float64),
        tl.load(means + 3 * i + 1, mask, 0.0).to(tl.float64),
        tl.load(means + 3 * i + 2, mask, 1.0).to(tl.float64),
    )
    X = tl.load(pose) * m0 + tl.load(pose + 1) * m1 + tl.load(pose + 2) * m2 + tl.load(pose + 9)
    Y = tl.load(pose + 3) * m0 + tl.load(pose + 4) * m1 + tl.load(pose + 5) * m2 + tl.load(pose + 10)
    Z = tl.load(pose + 6) * m0 + tl.load(pose + 7) * m1 + tl.load(pose + 8) * m2 + tl.load(pose + 11)
    dx, dy, dz = m0 - tl.load(pose + 12), m1 - tl.load(pose + 13), m2 - tl.load(pose + 14)
    inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = _rotation(
        tl.load(quats + 4 * i, mask, 1.0).to(tl.float64),
        tl.load(quats + 4 * i + 1, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 2, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 3, mask, 0.0).to(tl.float64),
    )
    floor = Z * SCALE_MIN_PX / tl.maximum(tl.load(pose + 15), tl.load(pose + 16))
    s0, slope0 = _held_scale(tl.load(log_scales + 2 * i, mask, 0.0).to(tl.float64), floor)
    s1, slope1 = _held_scale(tl.load(log_scales + 2 * i + 1, mask, 0.0).to(tl.float64), floor)
    t00, t10, nx = _row(pose, 0, r0, r3, r6), _row(pose, 0, r1, r4, r7), _row(pose, 0, r2, r5, r8)
    t01, t11, ny = _row(pose, 3, r0, r3, r6), _row(pose, 3, r1, r4, r7), _row(pose, 3, r2, r5, r8)
    t02, t12, nz = _row(pose, 6, r0, r3, r6), _row(pose, 6, r1, r4, r7), _row(pose, 6, r2, r5, r8)
    facing = nx * X + ny * Y + nz * Z
    distance = tl.sqrt(X * X + Y * Y + Z * Z)
    edge_on = tl.abs(facing) < distance * EDGE_ON
    side = tl.where((facing > 0.0) & (edge_on == 0), -1.0, 1.0)
    return (
        X,
        Y,
        Z,
        dx,
        dy,
        dz,
        distance,
        inverse,
        w,
        x,
        y,
        z,
        s0,
        slope0,
        s1,
        slope1,
        t00,
        t01,
        t02,
        t10,
        t11,
        t12,
        side * nx,
        side * ny,
        side * nz,
        side,
        edge_on,
    )


@triton.jit
def _row(pose, K: tl.constexpr, a, b, c):
    return tl.load(pose + K) * a + tl.load(pose + K + 1) * b + tl.load(pose + K + 2) * c


@triton.jit
def _column(pose, K: tl.constexpr, a, b, c):
    return tl.load(pose + K) * a + tl.load(pose + K + 3) * b + tl.load(pose + K + 6) * c


@triton.jit
def _clipped_extent(g0, g1, h0, h1, Z, near, k2):
    """As ``cpu.per_surfel.clipped_extent``."""
    hh = tl.maximum(h0 * h0 + h1 * h1, 1e-300)
    h = tl.sqrt(hh)
    along = (near - Z) / hh
    across = tl.sqrt(tl.maximum(k2 - along * along * hh, 0.0)) / h
    middle, swing = along * (g0 * h0 + g1 * h1) / near, tl.abs(across * (g1 * h0 - g0 * h1)) / near
    low, high = middle - swing, middle + swing
    A, B, C = Z * Z - k2 * hh, k2 * (g0 * h0 + g1 * h1), -k2 * (g0 * g0 + g1 * g1)
    discriminant = B * B - A * C
    some = discriminant > 0.0
    s = tl.sqrt(tl.where(some, discriminant, 0.0))
    root = tl.where(B > 0.0, -(B + s), s - B)
    for turn in tl.static_range(2):
        if turn == 0:
            top, bottom = root, A
        else:
            top, bottom = C, root
        good = some & (tl.abs(bottom) > 1e-12 * tl.abs(top))
        slope = tl.where(good, top, 0.0) / tl.where(good, bottom, 1.0)
        n0, n1 = g0 - slope * h0, g1 - slope * h1
        nn = n0 * n0 + n1 * n1
        good = good & (nn > 0.0)
        touch = slope * Z / tl.where(nn > 0.0, nn, 1.0)
        good = good & (Z + touch * (h0 * n0 + h1 * n1) >= near)
        low, high = tl.where(good, tl.minimum(low, slope), low), tl.where(good, tl.maximum(high, slope), high)
    return low, high


@triton.jit
def project(
    means,
    quats,
    log_scales,
    opacity_logits,
    sh,
    labels,
    pose,
    count_surfels,
    width,
    height,
    records,
    boxes,
    depths,
    visible,
    COEFFICIENTS: tl.constexpr,
    SH_ROWS: tl.constexpr,
    TILE: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """Records of the surfels that can touch the image, boxes of tiles about them, their depth (infinite for others), and
    whether each can."""
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < count_surfels
    (
        X,
        Y,
        Z,
        dx,
        dy,
        dz,
        distance,
        _,
        _,
        _,
        _,
        _,
        s0,
        _,
        s1,
        _,
        t00,
        t01,
        t02,
        t10,
        t11,
        t12,
        nx,
        ny,
        nz,
        _,
        edge_on,
    ) = _disc(means, quats, log_scales, pose, i, here)
    fx, fy, cx0, cy0, near = (
        tl.load(pose + 15),
        tl.load(pose + 16),
        tl.load(pose + 17),
        tl.load(pose + 18),
        tl.load(pose + 19),
    )
    logit = tl.load(opacity_logits + i, here, -100.0).to(tl.float64)
    opacity = 1.0 / (1.0 + tl.exp(tl.minimum(-logit, 700.0)))
    seen = here & (near < Z) & (Z < DEPTH_MAX) & (opacity >= ALPHA_MIN)
    Z = tl.where(seen, Z, near + 1.0)
    iz = 1.0 / Z
    xn, yn = X * iz, Y * iz
    seen = seen & (tl.abs(fx * xn) < OFFSET_MAX) & (tl.abs(fy * yn) < OFFSET_MAX)
    cx, cy = fx * xn + cx0, fy * yn + cy0
    h00, h01, h02, h10, h11, h12 = t00 * s0, t01 * s0, t02 * s0, t10 * s1, t11 * s1, t12 * s1
    U0, U1 = fx * (h00 - xn * h02), fx * (h10 - xn * h12)
    V0, V1 = fy * (h01 - yn * h02), fy * (h11 - yn * h12)
    k2 = tl.maximum(2.0 * tl.log(tl.maximum(opacity / ALPHA_MIN, 1.0)), 1e-6)
    low = tl.sqrt(0.5 * k2)
    slant = k2 * (h02 * h02 + h12 * h12)
    whole = (Z - tl.sqrt(slant) > near) & (edge_on == 0)
    cut = (whole == 0) & (edge_on == 0)
    g = 1.0 / tl.where(whole, Z * Z - slant, 1.0)
    mx = tl.where(whole, -k2 * (U0 * h02 + U1 * h12) * g, 0.0)
    my = tl.where(whole, -k2 * (V0 * h02 + V1 * h12) * g, 0.0)
    hx = tl.sqrt(tl.maximum(mx * mx + k2 * (U0 * U0 + U1 * U1) * g, 0.0))
    hy = tl.sqrt(tl.maximum(my * my + k2 * (V0 * V0 + V1 * V1) * g, 0.0))
    ex0, ex1 = _clipped_extent(U0, U1, h02, h12, Z, near, k2)
    ey0, ey1 = _clipped_extent(V0, V1, h02, h12, Z, near, k2)
    x0 = tl.minimum(tl.where(whole, mx - hx, tl.where(cut, ex0, 0.0)), -low)
    x1 = tl.maximum(tl.where(whole, mx + hx, tl.where(cut, ex1, 0.0)), low)
    y0 = tl.minimum(tl.where(whole, my - hy, tl.where(cut, ey0, 0.0)), -low)
    y1 = tl.maximum(tl.where(whole, my + hy, tl.where(cut, ey1, 0.0)), low)
    x0 = tl.floor(tl.maximum(cx + x0, 0.0) + 0.499)
    y0 = tl.floor(tl.maximum(cy + y0, 0.0) + 0.499)
    # From here on within the image: large numbers fit no integer.
    x1 = tl.floor(tl.maximum(tl.minimum(cx + x1, width), -1.0) + 0.501)
    y1 = tl.floor(tl.maximum(tl.minimum(cy + y1, height), -1.0) + 0.501)
    x1, y1 = tl.minimum(x1, width), tl.minimum(y1, height)
    seen = seen & (x1 > x0) & (y1 > y0)
    x0, y0 = tl.minimum(x0, width), tl.minimum(y0, height)
    det = U0 * V1 - U1 * V0
    g = tl.where(edge_on, 0.0, Z) / tl.where(edge_on, 1.0, det)
    a0, b0 = tl.where(edge_on, 1e3, V1 * g), -U1 * g
    a1, b1 = -V0 * g, tl.where(edge_on, 1e3, U0 * g)
    a2 = tl.where(edge_on, 0.0, -(h02 * a0 + h12 * a1) * iz)
    b2 = tl.where(edge_on, 0.0, -(h02 * b0 + h12 * b1) * iz)
    level = k2 * GENEROUS * Z * Z / tl.where(whole, Z * Z - slant, 1.0)
    xx = tl.where(whole, a0 * a0 + a1 * a1 - k2 * a2 * a2, 1.0)
    xy = a0 * b0 + a1 * b1 - k2 * a2 * b2
    form = (a0 * b1 - a1 * b0) * (a0 * b1 - a1 * b0) * (1.0 - slant * iz * iz)
    side = tl.where(edge_on, 1e6, 1e-12)
    e0 = tl.where(whole, tl.sqrt(xx / tl.where(whole, level, 1.0)), side)
    e1 = tl.where(whole, xy / tl.where(whole, level * e0, 1.0), 0.0)
    e2 = tl.where(whole, tl.sqrt(tl.where(whole, form, 0.0) / tl.where(whole, xx * level, 1.0)), side)
    red, green, blue = X * 0.0 + 0.5, X * 0.0 + 0.5, X * 0.0 + 0.5
    far = tl.where(distance > 0.0, distance, 1.0)
    for k in tl.static_range(COEFFICIENTS):
        b, _, _, _ = _basis(k, dx / far, dy / far, dz / far)
        at = sh + (i * SH_ROWS + k) * 3
        red += b * tl.load(at, here, 0.0)
        green += b * tl.load(at + 1, here, 0.0)
        blue += b * tl.load(at + 2, here, 0.0)
    at = records + i * SIZE
    label = tl.load(labels + i, here, 0).to(tl.float64)
    _store(at, 0, cx, seen)
    _store(at, 1, cy, seen)
    rest_x = (cx - cx.to(tl.float32).to(tl.float64)) / REST_UNIT
    rest_y = (cy - cy.to(tl.float32).to(tl.float64)) / REST_UNIT
    rest_x = tl.floor(tl.minimum(tl.maximum(rest_x, -REST_MAX), REST_MAX) + 0.5)
    rest_y = tl.floor(tl.minimum(tl.maximum(rest_y, -REST_MAX), REST_MAX) + 0.5)
    _store(at, 2, iz, seen)
    _store(at, 3, a0, seen)
    _store(at, 4, b0, seen)
    _store(at, 5, a1, seen)
    _store(at, 6, b1, seen)
    _store(at, 7, a2, seen)
    _store(at, 8, b2, seen)
    _store(at, 9, opacity, seen)
    _store(at, 10, tl.maximum(red, 0.0), seen)
    _store(at, 11, tl.maximum(green, 0.0), seen)
    _store(at, 12, tl.maximum(blue, 0.0), seen)
    _store(at, 13, nx, seen)
    _store(at, 14, ny, seen)
    _store(at, 15, nz, seen)
    _store(at, 16, Z, seen)
    _store(at, 17, label * LOW_RANGE + low * low * GENEROUS, seen)
    _store(at, 18, cx + mx, seen)
    _store(at, 19, cy + my, seen)
    _store(at, 20, e0, seen)
    _store(at, 21, e1, seen)
    _store(at, 22, e2, seen)
    _store(at, 23, rest_x * REST_BASE + rest_y, seen)
    tl.store(boxes + 4 * i, (x0.to(tl.int32) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 1, ((x1.to(tl.int32) - 1) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 2, (y0.to(tl.int32) // TILE).to(tl.int16), seen)
    tl.store(boxes + 4 * i + 3, ((y1.to(tl.int32) - 1) // TILE).to(tl.int16), seen)
    tl.store(depths + i, tl.where(seen, Z.to(tl.float32), float("inf")), here)
    tl.store(visible + i, seen.to(tl.uint8), here)


@triton.jit
def _store(at, K: tl.constexpr, value, mask):
    tl.store(at + K, value.to(tl.float32), mask)


@triton.jit
def chain(
    means,
    quats,
    log_scales,
    opacity_logits,
    sh,
    pose,
    records,
    visible,
    sums,
    count_surfels,
    g_means,
    g_quats,
    g_log_scales,
    g_opacity_logits,
    g_sh,
    g_screen,
    COEFFICIENTS: tl.constexpr,
    SH_ROWS: tl.constexpr,
    SUMS: tl.constexpr,
    BLOCK: tl.constexpr,
):
    """Sums of gradient rows carried back to the parameters; zero for surfels off the screen."""
    n = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = n < count_surfels
    seen = here & (tl.load(visible + n, here, 0) != 0)
    (
        X,
        Y,
        Z,
        dx,
        dy,
        dz,
        distance,
        inverse,
        w,
        x,
        y,
        z,
        s0,
        slope0,
        s1,
        slope1,
        t00,
        t01,
        t02,
        t10,
        t11,
        t12,
        _,
        _,
        _,
        side,
        edge_on,
    ) = _disc(means, quats, log_scales, pose, n, seen)
    fx, fy = tl.load(pose + 15), tl.load(pose + 16)
    iz = 1.0 / tl.where(seen, Z, 1.0)
    xn, yn, W0, W1 = X * iz, Y * iz, t02 * s0, t12 * s1
    U0, U1 = fx * (t00 * s0 - xn * W0), fx * (t10 * s1 - xn * W1)
    V0, V1 = fy * (t01 * s0 - yn * W0), fy * (t11 * s1 - yn * W1)
    at = sums + n * SUMS
    flat = seen & (edge_on == 0)
    g = tl.where(flat, Z, 0.0) / tl.where(flat, U0 * V1 - U1 * V0, 1.0)
    A0, B0, A1, B1 = V1 * g, -U1 * g, -V0 * g, U0 * g
    A2, B2 = -(W0 * A0 + W1 * A1) * iz, -(W0 * B0 + W1 * B1) * iz
    sum_nu, sum_nv, sum_q = _sum(at, 0, flat), _sum(at, 3, flat), _sum(at, 6, flat)
    g_cx = 2.0 * _sum(at, 13, seen) - (A0 * sum_nu + A1 * sum_nv + A2 * sum_q)
    g_cy = 2.0 * _sum(at, 14, seen) - (B0 * sum_nu + B1 * sum_nv + B2 * sum_q)
    g_a2, g_b2 = _sum(at, 7, flat), _sum(at, 8, flat)
    g_a0, g_a1 = _sum(at, 1, flat) - W0 * iz * g_a2, _sum(at, 4, flat) - W1 * iz * g_a2
    g_b0, g_b1 = _sum(at, 2, flat) - W0 * iz * g_b2, _sum(at, 5, flat) - W1 * iz * g_b2
    g_W0, g_W1 = -(A0 * g_a2 + B0 * g_b2) * iz, -(A1 * g_a2 + B1 * g_b2) * iz
    m00, m01 = A0 * g_a0 + A1 * g_a1, A0 * g_b0 + A1 * g_b1
    m10, m11 = B0 * g_a0 + B1 * g_a1, B0 * g_b0 + B1 * g_b1
    g_U0, g_U1 = -(m00 * A0 + m01 * B0) * iz, -(m00 * A1 + m01 * B1) * iz
    g_V0, g_V1 = -(m10 * A0 + m11 * B0) * iz, -(m10 * A1 + m11 * B1) * iz
    g_Z = -(A2 * g_a2 + B2 * g_b2) * iz - (U0 * g_U0 + U1 * g_U1 + V0 * g_V0 + V1 * g_V1) * iz
    h00, h10, h01, h11 = fx * g_U0, fx * g_U1, fy * g_V0, fy * g_V1
    h02 = -fx * xn * g_U0 - fy * yn * g_V0 + g_W0
    h12 = -fx * xn * g_U1 - fy * yn * g_V1 + g_W1
    g_xn, g_yn = fx * (g_cx - g_U0 * W0 - g_U1 * W1), fy * (g_cy - g_V0 * W0 - g_V1 * W1)
    g_X, g_Y = g_xn * iz, g_yn * iz
    g_Z -= (xn * g_xn + yn * g_yn) * iz + _sum(at, 15, seen) * iz * iz
    gm0, gm1, gm2 = _column(pose, 0, g_X, g_Y, g_Z), _column(pose, 1, g_X, g_Y, g_Z), _column(pose, 2, g_X, g_Y, g_Z)
    # Colour: no gradient where the clamp at zero held it.
    colour = records + n * SIZE
    red = tl.where(tl.load(colour + 10, seen, 0.0) > 0.0, _sum(at, 10, seen), 0.0)
    green = tl.where(tl.load(colour + 11, seen, 0.0) > 0.0, _sum(at, 11, seen), 0.0)
    blue = tl.where(tl.load(colour + 12, seen, 0.0) > 0.0, _sum(at, 12, seen), 0.0)
    far = tl.where(seen, distance, 1.0)
    dx, dy, dz = dx / far, dy / far, dz / far
    gx, gy, gz = X * 0.0, X * 0.0, X * 0.0
    for k in tl.static_range(SH_ROWS):
        row = (n * SH_ROWS + k) * 3
        if k < COEFFICIENTS:
            b, bx, by, bz = _basis(k, dx, dy, dz)
            weight = red * tl.load(sh + row, seen, 0.0) + green * tl.load(sh + row + 1, seen, 0.0)
            weight += blue * tl.load(sh + row + 2, seen, 0.0)
            gx, gy, gz = gx + weight * bx, gy + weight * by, gz + weight * bz
        else:
            b = X * 0.0
        _store(g_sh + row, 0, b * red, here)
        _store(g_sh + row, 1, b * green, here)
        _store(g_sh + row, 2, b * blue, here)
    radial = gx * dx + gy * dy + gz * dz
    _store(g_means + 3 * n, 0, tl.where(seen, gm0 + (gx - radial * dx) / far, 0.0), here)
    _store(g_means + 3 * n, 1, tl.where(seen, gm1 + (gy - radial * dy) / far, 0.0), here)
    _store(g_means + 3 * n, 2, tl.where(seen, gm2 + (gz - radial * dz) / far, 0.0), here)
    _store(g_log_scales + 2 * n, 0, tl.where(seen, slope0 * (h00 * t00 + h01 * t01 + h02 * t02), 0.0), here)
    _store(g_log_scales + 2 * n, 1, tl.where(seen, slope1 * (h10 * t10 + h11 * t11 + h12 * t12), 0.0), here)
    h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
    h20, h21, h22 = side * _sum(at, 16, seen), side * _sum(at, 17, seen), side * _sum(at, 18, seen)
    G0, G3, G6 = _column(pose, 0, h00, h01, h02), _column(pose, 1, h00, h01, h02), _column(pose, 2, h00, h01, h02)
    G1, G4, G7 = _column(pose, 0, h10, h11, h12), _column(pose, 1, h10, h11, h12), _column(pose, 2, h10, h11, h12)
    G2, G5, G8 = _column(pose, 0, h20, h21, h22), _column(pose, 1, h20, h21, h22), _column(pose, 2, h20, h21, h22)
    gw = 2.0 * (x * (G7 - G5) + y * (G2 - G6) + z * (G3 - G1))
    gx = 2.0 * (-2.0 * x * (G4 + G8) + y * (G1 + G3) + z * (G2 + G6) + w * (G7 - G5))
    gy = 2.0 * (x * (G1 + G3) - 2.0 * y * (G0 + G8) + z * (G5 + G7) + w * (G2 - G6))
    gz = 2.0 * (x * (G2 + G6) + y * (G5 + G7) - 2.0 * z * (G0 + G4) + w * (G3 - G1))
    along = gw * w + gx * x + gy * y + gz * z
    _store(g_quats + 4 * n, 0, tl.where(seen, (gw - along * w) * inverse, 0.0), here)
    _store(g_quats + 4 * n, 1, tl.where(seen, (gx - along * x) * inverse, 0.0), here)
    _store(g_quats + 4 * n, 2, tl.where(seen, (gy - along * y) * inverse, 0.0), here)
    _store(g_quats + 4 * n, 3, tl.where(seen, (gz - along * z) * inverse, 0.0), here)
    logit = tl.load(opacity_logits + n, here, 0.0).to(tl.float64)
    _store(g_opacity_logits + n, 0, _sum(at, 9, seen) / (1.0 + tl.exp(tl.minimum(logit, 700.0))), here)
    _store(g_screen + 2 * n, 0, tl.where(seen, g_cx, 0.0), here)
    _store(g_screen + 2 * n, 1, tl.where(seen, g_cy, 0.0), here)


@triton.jit
def _sum(at, K: tl.constexpr, mask):
    return tl.load(at + K, mask, 0.0).to(tl.float64)

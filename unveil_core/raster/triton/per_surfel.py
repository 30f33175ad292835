"""What is done per surfel on the GPU: project, and carry gradients back. The same arithmetic as ``cpu.per_surfel``.

float64 between the parameters and the records, as there: edge-on discs cancel digits.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster import spec
from unveil_core.raster.triton.camera_frame import (
    colour,
    colour_gradient,
    column,
    held_scale,
    in_camera,
    opacity_of,
    pixel_range,
    quaternion_gradient,
    rotation,
    row,
    store,
    sum_at,
    write_record,
)

__all__ = ["chain", "project"]

ALPHA_MIN, DEPTH_MAX, EDGE_ON = tl.constexpr(spec.ALPHA_MIN), tl.constexpr(spec.DEPTH_MAX), tl.constexpr(spec.EDGE_ON)
OFFSET_MAX = tl.constexpr(spec.OFFSET_MAX)
SCALE_MIN_PX, GENEROUS = tl.constexpr(spec.SCALE_MIN_PX), tl.constexpr(spec.GENEROUS)


@triton.jit
def _disc(means, quats, log_scales, pose, i, mask):
    """A surfel in the camera's frame, for project and for its gradient."""
    X, Y, Z, dx, dy, dz = in_camera(means, pose, i, mask)
    inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
        tl.load(quats + 4 * i, mask, 1.0).to(tl.float64),
        tl.load(quats + 4 * i + 1, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 2, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 3, mask, 0.0).to(tl.float64),
    )
    floor = Z * SCALE_MIN_PX / tl.maximum(tl.load(pose + 15), tl.load(pose + 16))
    s0, slope0 = held_scale(tl.load(log_scales + 2 * i, mask, 0.0).to(tl.float64), floor)
    s1, slope1 = held_scale(tl.load(log_scales + 2 * i + 1, mask, 0.0).to(tl.float64), floor)
    t00, t10, nx = row(pose, 0, r0, r3, r6), row(pose, 0, r1, r4, r7), row(pose, 0, r2, r5, r8)
    t01, t11, ny = row(pose, 3, r0, r3, r6), row(pose, 3, r1, r4, r7), row(pose, 3, r2, r5, r8)
    t02, t12, nz = row(pose, 6, r0, r3, r6), row(pose, 6, r1, r4, r7), row(pose, 6, r2, r5, r8)
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


@triton.jit(do_not_specialize=["count_surfels"])
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
    opacity = opacity_of(opacity_logits, i, here)
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
    x0, x1, y0, y1 = pixel_range(cx, cy, x0, x1, y0, y1, width, height)
    seen = seen & (x1 > x0) & (y1 > y0)
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
    far = tl.where(distance > 0.0, distance, 1.0)
    red, green, blue = colour(sh, i, here, dx / far, dy / far, dz / far, COEFFICIENTS, SH_ROWS)
    label = tl.load(labels + i, here, 0).to(tl.float64)
    write_record(
        i, seen, here, cx, cy, Z, a0, b0, a1, b1, a2, b2, opacity, red, green, blue, nx, ny, nz, label, low * low * GENEROUS,
        cx + mx, cy + my, e0, e1, e2, x0, x1, y0, y1, records, boxes, depths, visible, TILE,
    )  # fmt: skip


@triton.jit(do_not_specialize=["count_surfels"])
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
    sum_nu, sum_nv, sum_q = sum_at(at, 0, flat), sum_at(at, 3, flat), sum_at(at, 6, flat)
    g_cx = 2.0 * sum_at(at, 13, seen) - (A0 * sum_nu + A1 * sum_nv + A2 * sum_q)
    g_cy = 2.0 * sum_at(at, 14, seen) - (B0 * sum_nu + B1 * sum_nv + B2 * sum_q)
    g_a2, g_b2 = sum_at(at, 7, flat), sum_at(at, 8, flat)
    g_a0, g_a1 = sum_at(at, 1, flat) - W0 * iz * g_a2, sum_at(at, 4, flat) - W1 * iz * g_a2
    g_b0, g_b1 = sum_at(at, 2, flat) - W0 * iz * g_b2, sum_at(at, 5, flat) - W1 * iz * g_b2
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
    g_Z -= (xn * g_xn + yn * g_yn) * iz + sum_at(at, 15, seen) * iz * iz
    gm0, gm1, gm2 = column(pose, 0, g_X, g_Y, g_Z), column(pose, 1, g_X, g_Y, g_Z), column(pose, 2, g_X, g_Y, g_Z)
    far = tl.where(seen, distance, 1.0)
    gx, gy, gz = colour_gradient(
        records, sums, sh, g_sh, n, here, seen, dx / far, dy / far, dz / far, far, SUMS, COEFFICIENTS, SH_ROWS
    )
    store(g_means + 3 * n, 0, tl.where(seen, gm0 + gx, 0.0), here)
    store(g_means + 3 * n, 1, tl.where(seen, gm1 + gy, 0.0), here)
    store(g_means + 3 * n, 2, tl.where(seen, gm2 + gz, 0.0), here)
    store(g_log_scales + 2 * n, 0, tl.where(seen, slope0 * (h00 * t00 + h01 * t01 + h02 * t02), 0.0), here)
    store(g_log_scales + 2 * n, 1, tl.where(seen, slope1 * (h10 * t10 + h11 * t11 + h12 * t12), 0.0), here)
    h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
    h20, h21, h22 = side * sum_at(at, 16, seen), side * sum_at(at, 17, seen), side * sum_at(at, 18, seen)
    quaternion_gradient(
        pose, g_quats, n, here, seen, inverse, w, x, y, z, h00, h01, h02, h10, h11, h12, h20, h21, h22
    )  # fmt: skip
    logit = tl.load(opacity_logits + n, here, 0.0).to(tl.float64)
    store(g_opacity_logits + n, 0, sum_at(at, 9, seen) / (1.0 + tl.exp(tl.minimum(logit, 700.0))), here)
    store(g_screen + 2 * n, 0, tl.where(seen, g_cx, 0.0), here)
    store(g_screen + 2 * n, 1, tl.where(seen, g_cy, 0.0), here)

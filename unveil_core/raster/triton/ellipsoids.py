"""What is a 3D Gaussian's own among what is done per surfel on the GPU. The same arithmetic as ``cpu.ellipsoids``.

The records are those of discs, so that binning and the tile kernels know nothing of the difference.
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

__all__ = ["chain_ellipsoids", "project_ellipsoids"]

ALPHA_MIN, DEPTH_MAX, EDGE_ON = tl.constexpr(spec.ALPHA_MIN), tl.constexpr(spec.DEPTH_MAX), tl.constexpr(spec.EDGE_ON)
OFFSET_MAX, DILATION = tl.constexpr(spec.OFFSET_MAX), tl.constexpr(spec.DILATION)
SCALE_MIN_PX, GENEROUS = tl.constexpr(spec.SCALE_MIN_PX), tl.constexpr(spec.GENEROUS)


@triton.jit
def _scaled(quats, log_scales, pose, i, Z, mask):
    """Rotation, its columns in the camera's frame, and the standard deviations with their slopes; ``thin`` is the number of the
    smallest, the last of equals."""
    inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
        tl.load(quats + 4 * i, mask, 1.0).to(tl.float64),
        tl.load(quats + 4 * i + 1, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 2, mask, 0.0).to(tl.float64),
        tl.load(quats + 4 * i + 3, mask, 0.0).to(tl.float64),
    )
    floor = Z * SCALE_MIN_PX / tl.maximum(tl.load(pose + 15), tl.load(pose + 16))
    l0, l1 = tl.load(log_scales + 3 * i, mask, 0.0), tl.load(log_scales + 3 * i + 1, mask, 0.0)
    l2 = tl.load(log_scales + 3 * i + 2, mask, 0.0)
    s0, slope0 = held_scale(l0.to(tl.float64), floor)
    s1, slope1 = held_scale(l1.to(tl.float64), floor)
    s2, slope2 = held_scale(l2.to(tl.float64), floor)
    thin = tl.where(l2 <= tl.minimum(l0, l1), 2, tl.where(l1 <= l0, 1, 0))
    t00, t10, t20 = row(pose, 0, r0, r3, r6), row(pose, 0, r1, r4, r7), row(pose, 0, r2, r5, r8)
    t01, t11, t21 = row(pose, 3, r0, r3, r6), row(pose, 3, r1, r4, r7), row(pose, 3, r2, r5, r8)
    t02, t12, t22 = row(pose, 6, r0, r3, r6), row(pose, 6, r1, r4, r7), row(pose, 6, r2, r5, r8)
    return (
        inverse, w, x, y, z, s0, slope0, s1, slope1, s2, slope2, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22,
    )  # fmt: skip


@triton.jit
def _field(pose, xn, yn):
    """The direction at which the Jacobian is taken: held within the field of view and its margin."""
    x = tl.minimum(tl.maximum(xn, tl.load(pose + 20)), tl.load(pose + 21))
    return x, tl.minimum(tl.maximum(yn, tl.load(pose + 22)), tl.load(pose + 23))


@triton.jit
def _columns(jx, jy, x, y, s0, s1, s2, t00, t01, t02, t10, t11, t12, t20, t21, t22):
    """Jp R diag(s), its first row and then its second."""
    return (
        jx * s0 * (t00 - x * t02),
        jx * s1 * (t10 - x * t12),
        jx * s2 * (t20 - x * t22),
        jy * s0 * (t01 - y * t02),
        jy * s1 * (t11 - y * t12),
        jy * s2 * (t21 - y * t22),
    )


@triton.jit
def _whitening(p0, p1, p2, q0, q1, q2):
    """a0, b0, b1 of the footprint with these columns, its variances along x and y, and the minors of the columns."""
    c00, c11 = p0 * p0 + p1 * p1 + p2 * p2 + DILATION, q0 * q0 + q1 * q1 + q2 * q2 + DILATION
    c01 = p0 * q0 + p1 * q1 + p2 * q2
    m0, m1, m2 = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    # The determinant as a sum of squares: c00 c11 - c01^2 has no digit left for a needle of a million pixels.
    det = m0 * m0 + m1 * m1 + m2 * m2 + (c00 + c11 - DILATION) * DILATION
    a0 = tl.sqrt(c11 / det)
    return a0, -c01 * a0 / c11, 1.0 / tl.sqrt(c11), c00, c11, m0, m1, m2


@triton.jit
def _facing(X, Y, Z, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22):
    """The normal, unturned; the distance; and -1 where the normal must turn, else 1."""
    nx = tl.where(thin == 0, t00, tl.where(thin == 1, t10, t20))
    ny = tl.where(thin == 0, t01, tl.where(thin == 1, t11, t21))
    nz = tl.where(thin == 0, t02, tl.where(thin == 1, t12, t22))
    facing, distance = nx * X + ny * Y + nz * Z, tl.sqrt(X * X + Y * Y + Z * Z)
    edge_on = tl.abs(facing) < distance * EDGE_ON
    return nx, ny, nz, distance, tl.where((facing > 0.0) & (edge_on == 0), -1.0, 1.0)


@triton.jit(do_not_specialize=["count_surfels"])
def project_ellipsoids(
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
    """As ``per_surfel.project``."""
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < count_surfels
    fx, fy, near = tl.load(pose + 15), tl.load(pose + 16), tl.load(pose + 19)
    X, Y, Z, dx, dy, dz = in_camera(means, pose, i, here)
    opacity = opacity_of(opacity_logits, i, here)
    seen = here & (near < Z) & (Z < DEPTH_MAX) & (opacity >= ALPHA_MIN)
    Z = tl.where(seen, Z, near + 1.0)
    xn, yn = X / Z, Y / Z
    seen = seen & (tl.abs(fx * xn) < OFFSET_MAX) & (tl.abs(fy * yn) < OFFSET_MAX)
    cx, cy = fx * xn + tl.load(pose + 17), fy * yn + tl.load(pose + 18)
    _, _, _, _, _, s0, _, s1, _, s2, _, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22 = _scaled(
        quats, log_scales, pose, i, Z, here
    )
    x, y = _field(pose, xn, yn)
    p0, p1, p2, q0, q1, q2 = _columns(
        fx / Z, fy / Z, x, y, s0, s1, s2, t00, t01, t02, t10, t11, t12, t20, t21, t22
    )  # fmt: skip
    a0, b0, b1, c00, c11, _, _, _ = _whitening(p0, p1, p2, q0, q1, q2)
    k2 = tl.maximum(2.0 * tl.log(tl.maximum(opacity / ALPHA_MIN, 1.0)), 1e-6)
    hx, hy = tl.sqrt(k2 * c00), tl.sqrt(k2 * c11)
    x0, x1, y0, y1 = pixel_range(cx, cy, -hx, hx, -hy, hy, width, height)
    seen = seen & (x1 > x0) & (y1 > y0)
    # The reach is a triangular factor too. The low-pass filter's circle lies within it, so there is none.
    shrink = 1.0 / tl.sqrt(k2 * GENEROUS)
    nx, ny, nz, distance, side = _facing(X, Y, Z, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    far = tl.where(distance > 0.0, distance, 1.0)
    red, green, blue = colour(sh, i, here, dx / far, dy / far, dz / far, COEFFICIENTS, SH_ROWS)
    zero, label = cx * 0.0, tl.load(labels + i, here, 0).to(tl.float64)
    write_record(
        i, seen, here, cx, cy, Z, a0, b0, zero, b1, zero, zero, opacity, red, green, blue, side * nx, side * ny, side * nz,
        label, zero, cx, cy, a0 * shrink, b0 * shrink, b1 * shrink, x0, x1, y0, y1, records, boxes, depths, visible, TILE,
    )  # fmt: skip


@triton.jit(do_not_specialize=["count_surfels"])
def chain_ellipsoids(
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
    """As ``per_surfel.chain``."""
    n = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = n < count_surfels
    seen = here & (tl.load(visible + n, here, 0) != 0)
    fx, fy = tl.load(pose + 15), tl.load(pose + 16)
    X, Y, Z, dx, dy, dz = in_camera(means, pose, n, seen)
    Z = tl.where(seen, Z, 1.0)
    iz = 1.0 / Z
    xn, yn, jx, jy = X * iz, Y * iz, fx * iz, fy * iz
    (
        inverse, w, qx, qy, qz, s0, slope0, s1, slope1, s2, slope2, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22,
    ) = _scaled(quats, log_scales, pose, n, Z, seen)  # fmt: skip
    x, y = _field(pose, xn, yn)
    p0, p1, p2, q0, q1, q2 = _columns(jx, jy, x, y, s0, s1, s2, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    A0, B0, B1, _, c11, m0, m1, m2 = _whitening(p0, p1, p2, q0, q1, q2)
    at = sums + n * SUMS
    sum_nu, sum_nv = sum_at(at, 0, seen), sum_at(at, 3, seen)
    g_cx, g_cy = -A0 * sum_nu, -B0 * sum_nu - B1 * sum_nv
    # N, the sum of h (u, v)^T (u, v) over the pixels, from the moments. The gradient by a column w of W is A^T N A w, taken
    # from right to left, and the first row of A W by minors, so that needles keep their digits.
    n00 = -A0 * sum_at(at, 1, seen) - B0 * sum_at(at, 2, seen)
    n01, n11 = -B1 * sum_at(at, 2, seen), -B1 * sum_at(at, 5, seen)
    g = A0 / c11
    u0 = g * (p0 * DILATION + q1 * m2 - q2 * m1)
    u1 = g * (p1 * DILATION + q2 * m0 - q0 * m2)
    u2 = g * (p2 * DILATION + q0 * m1 - q1 * m0)
    v0, v1, v2 = B1 * q0, B1 * q1, B1 * q2
    g_u0, g_u1, g_u2 = n00 * u0 + n01 * v0, n00 * u1 + n01 * v1, n00 * u2 + n01 * v2
    g_p0, g_p1, g_p2 = A0 * g_u0, A0 * g_u1, A0 * g_u2
    g_q0 = B0 * g_u0 + B1 * (n01 * u0 + n11 * v0)
    g_q1 = B0 * g_u1 + B1 * (n01 * u1 + n11 * v1)
    g_q2 = B0 * g_u2 + B1 * (n01 * u2 + n11 * v2)
    h00, h01, h02 = jx * g_p0, jy * g_q0, -jx * x * g_p0 - jy * y * g_q0
    h10, h11, h12 = jx * g_p1, jy * g_q1, -jx * x * g_p1 - jy * y * g_q1
    h20, h21, h22 = jx * g_p2, jy * g_q2, -jx * x * g_p2 - jy * y * g_q2
    store(g_log_scales + 3 * n, 0, tl.where(seen, slope0 * (h00 * t00 + h01 * t01 + h02 * t02), 0.0), here)
    store(g_log_scales + 3 * n, 1, tl.where(seen, slope1 * (h10 * t10 + h11 * t11 + h12 * t12), 0.0), here)
    store(g_log_scales + 3 * n, 2, tl.where(seen, slope2 * (h20 * t20 + h21 * t21 + h22 * t22), 0.0), here)
    g_xn, g_yn = fx * g_cx, fy * g_cy
    # Held at the field's edge, the Jacobian's direction has no gradient.
    g_xn -= tl.where(x == xn, jx * (g_p0 * s0 * t02 + g_p1 * s1 * t12 + g_p2 * s2 * t22), 0.0)
    g_yn -= tl.where(y == yn, jy * (g_q0 * s0 * t02 + g_q1 * s1 * t12 + g_q2 * s2 * t22), 0.0)
    g_X, g_Y = g_xn * iz, g_yn * iz
    g_Z = -(p0 * g_p0 + p1 * g_p1 + p2 * g_p2 + q0 * g_q0 + q1 * g_q1 + q2 * g_q2) * iz
    g_Z -= (xn * g_xn + yn * g_yn) * iz + sum_at(at, 15, seen) * iz * iz
    gm0, gm1, gm2 = column(pose, 0, g_X, g_Y, g_Z), column(pose, 1, g_X, g_Y, g_Z), column(pose, 2, g_X, g_Y, g_Z)
    _, _, _, distance, side = _facing(X, Y, Z, thin, t00, t01, t02, t10, t11, t12, t20, t21, t22)
    far = tl.where(seen, distance, 1.0)
    gx, gy, gz = colour_gradient(
        records, sums, sh, g_sh, n, here, seen, dx / far, dy / far, dz / far, far, SUMS, COEFFICIENTS, SH_ROWS
    )
    store(g_means + 3 * n, 0, tl.where(seen, gm0 + gx, 0.0), here)
    store(g_means + 3 * n, 1, tl.where(seen, gm1 + gy, 0.0), here)
    store(g_means + 3 * n, 2, tl.where(seen, gm2 + gz, 0.0), here)
    k0, k1, k2 = side * sum_at(at, 16, seen), side * sum_at(at, 17, seen), side * sum_at(at, 18, seen)
    h00, h01, h02 = h00 * s0, h01 * s0, h02 * s0
    h10, h11, h12 = h10 * s1, h11 * s1, h12 * s1
    h20, h21, h22 = h20 * s2, h21 * s2, h22 * s2
    quaternion_gradient(
        pose,
        g_quats,
        n,
        here,
        seen,
        inverse,
        w,
        qx,
        qy,
        qz,
        tl.where(thin == 0, h00 + k0, h00),
        tl.where(thin == 0, h01 + k1, h01),
        tl.where(thin == 0, h02 + k2, h02),
        tl.where(thin == 1, h10 + k0, h10),
        tl.where(thin == 1, h11 + k1, h11),
        tl.where(thin == 1, h12 + k2, h12),
        tl.where(thin == 2, h20 + k0, h20),
        tl.where(thin == 2, h21 + k1, h21),
        tl.where(thin == 2, h22 + k2, h22),
    )
    logit = tl.load(opacity_logits + n, here, 0.0).to(tl.float64)
    store(g_opacity_logits + n, 0, sum_at(at, 9, seen) / (1.0 + tl.exp(tl.minimum(logit, 700.0))), here)
    store(g_screen + 2 * n, 0, tl.where(seen, g_cx, 0.0), here)
    store(g_screen + 2 * n, 1, tl.where(seen, g_cy, 0.0), here)

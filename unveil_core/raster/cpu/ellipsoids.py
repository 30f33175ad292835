"""What is a 3D Gaussian's own among what is done per surfel: project, and carry gradients back.

The same arguments as the kernels of :mod:`per_surfel`, and the camera's field of view; see ``raster.spec`` for the
mathematics. Both write the same record, so that the kernels of the tiles know nothing of the difference.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST, INLINED
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.block import sources
from unveil_core.raster.cpu.camera_frame import (
    ZERO,
    axes,
    held_scale,
    in_camera,
    pixel_range,
    quaternion_gradient,
    rotation,
    seen_from,
)
from unveil_core.raster.cpu.colours import higher_colour, higher_colour_gradient
from unveil_core.raster.cpu.per_surfel import SHARED
from unveil_core.raster.cpu.rows import clear, sum_rows, write_record
from unveil_core.raster.spec import DEPTH_MAX, DILATION, GENEROUS, OFFSET_MAX, SCALE_MIN_PX
from unveil_core.raster.spherical_harmonics import SH0

__all__ = ["project", "reduce_rows"]

f32, f64 = np.float32, np.float64


@njit(**INLINED)
def columns(Z, x, y, fx, fy, s0, s1, s2, frame):
    """Jp R diag(s), its first row and then its second, for a centre at depth Z in the direction (x, y, 1)."""
    t00, t01, t02, t10, t11, t12, t20, t21, t22 = frame
    jx, jy = fx / Z, fy / Z
    return (
        jx * s0 * (t00 - x * t02),
        jx * s1 * (t10 - x * t12),
        jx * s2 * (t20 - x * t22),
        jy * s0 * (t01 - y * t02),
        jy * s1 * (t11 - y * t12),
        jy * s2 * (t21 - y * t22),
    )


@njit(**INLINED)
def minors(p0, p1, p2, q0, q1, q2):
    """Cross product of the rows p and q."""
    return p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0


@njit(**INLINED)
def whitening(p0, p1, p2, q0, q1, q2):
    """a0, b0, b1 of the footprint with these columns, and its variances along x and y."""
    c00, c11 = p0 * p0 + p1 * p1 + p2 * p2 + DILATION, q0 * q0 + q1 * q1 + q2 * q2 + DILATION
    c01 = p0 * q0 + p1 * q1 + p2 * q2
    m0, m1, m2 = minors(p0, p1, p2, q0, q1, q2)
    # The determinant as a sum of squares: c00 c11 - c01^2 has no digit left for a needle of a million pixels.
    det = m0 * m0 + m1 * m1 + m2 * m2 + DILATION * (c00 + c11 - DILATION)
    a0 = np.sqrt(c11 / det)
    return a0, -c01 * a0 / c11, 1.0 / np.sqrt(c11), c00, c11


@njit(**INLINED)
def thinnest(l0, l1, l2):
    """Number of the smallest scale, the last of equals."""
    if l2 <= min(l0, l1):
        return 2
    return 1 if l1 <= l0 else 0


def _kernels():
    # numba's cache looks at this file and at what a kernel closes over, not at what it is inlined from.
    code = sources(*SHARED)

    @njit(**FAST)
    def project(
        first,
        end,
        means,
        quats,
        log_scales,
        opacity_logits,
        sh,
        labels,
        R,
        t,
        eye,
        fx,
        fy,
        cx0,
        cy0,
        width,
        height,
        near,
        coefficients,
        alpha_min,
        exact_reach,
        records,
        boxes,
        depths,
        visible,
        x_low,
        x_high,
        y_low,
        y_high,
    ):
        """As ``per_surfel.project``."""
        if code < 0:
            return
        for i in range(first, end):
            visible[i] = 0
            X, Y, Z = in_camera(means, i, R, t)
            if not near < Z < DEPTH_MAX:
                continue
            opacity = 1.0 / (1.0 + np.exp(min(-f64(opacity_logits[i]), 700.0)))
            if opacity < alpha_min:
                continue
            iz = 1.0 / Z
            xn, yn = X * iz, Y * iz
            if not (abs(fx * xn) < OFFSET_MAX and abs(fy * yn) < OFFSET_MAX):
                continue
            _, _, _, _, _, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
                f64(quats[i, 0]), f64(quats[i, 1]), f64(quats[i, 2]), f64(quats[i, 3])
            )
            floor = SCALE_MIN_PX * Z / max(fx, fy)
            s0, _ = held_scale(log_scales[i, 0], floor)
            s1, _ = held_scale(log_scales[i, 1], floor)
            s2, _ = held_scale(log_scales[i, 2], floor)
            frame = axes(R, r0, r1, r2, r3, r4, r5, r6, r7, r8)
            x, y = min(max(xn, x_low), x_high), min(max(yn, y_low), y_high)
            a0, b0, b1, c00, c11 = whitening(*columns(Z, x, y, fx, fy, s0, s1, s2, frame))
            k2 = max(2.0 * np.log(opacity / alpha_min), 1e-6)
            hx, hy = np.sqrt(k2 * c00), np.sqrt(k2 * c11)
            cx, cy = fx * xn + cx0, fy * yn + cy0
            x0, x1, y0, y1 = pixel_range(cx, cy, -hx, hx, -hy, hy, width, height)
            if not (x1 > x0 and y1 > y0):
                continue
            # What the tiles hold against their blocks is a triangular factor too. The low-pass filter's circle lies
            # within it, so there is none.
            shrink = 1.0 / np.sqrt(GENEROUS * k2)
            e0, e1, e2 = a0 * shrink, b0 * shrink, b1 * shrink
            if not exact_reach:
                e0, e1, e2 = 1e-12, 0.0, 1e-12
            t00, t01, t02, t10, t11, t12, nx, ny, nz = frame
            thin = thinnest(log_scales[i, 0], log_scales[i, 1], log_scales[i, 2])
            if thin == 0:
                nx, ny, nz = t00, t01, t02
            elif thin == 1:
                nx, ny, nz = t10, t11, t12
            distance, _, side = seen_from(X, Y, Z, nx, ny, nz)
            dx, dy, dz = means[i, 0] - eye[0], means[i, 1] - eye[1], means[i, 2] - eye[2]
            red, green, blue = 0.5 + SH0 * sh[i, 0, 0], 0.5 + SH0 * sh[i, 0, 1], 0.5 + SH0 * sh[i, 0, 2]
            if coefficients > 1:
                r, g, b = higher_colour(i, dx / distance, dy / distance, dz / distance, sh, coefficients)
                red, green, blue = red + r, green + g, blue + b
            write_record(
                i,
                cx,
                cy,
                iz,
                a0,
                b0,
                0.0,
                b1,
                0.0,
                0.0,
                opacity,
                red,
                green,
                blue,
                side * nx,
                side * ny,
                side * nz,
                Z,
                labels[i],
                0.0,
                cx,
                cy,
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
            )

    @njit(**FAST)
    def reduce_rows(
        first,
        end,
        records,
        visible,
        surfel_start,
        rows,
        touched,
        means,
        quats,
        log_scales,
        opacity_logits,
        sh,
        R,
        t,
        eye,
        fx,
        fy,
        coefficients,
        g_means,
        g_quats,
        g_log_scales,
        g_opacity_logits,
        g_sh,
        g_screen,
        x_low,
        x_high,
        y_low,
        y_high,
    ):
        """As ``per_surfel.reduce_rows``."""
        if code < 0:
            return
        a = np.empty(20, f32)
        for n in range(first, end):
            if not visible[n]:
                clear(n, g_means, g_quats, g_log_scales, g_opacity_logits, g_sh, g_screen)
                continue
            sum_rows(n, surfel_start, rows, touched, a)
            X, Y, Z = in_camera(means, n, R, t)
            iz = 1.0 / Z
            xn, yn = X * iz, Y * iz
            inverse, qw, qx, qy, qz, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
                f64(quats[n, 0]), f64(quats[n, 1]), f64(quats[n, 2]), f64(quats[n, 3])
            )
            floor = SCALE_MIN_PX * Z / max(fx, fy)
            s0, slope0 = held_scale(log_scales[n, 0], floor)
            s1, slope1 = held_scale(log_scales[n, 1], floor)
            s2, slope2 = held_scale(log_scales[n, 2], floor)
            frame = axes(R, r0, r1, r2, r3, r4, r5, r6, r7, r8)
            t00, t01, t02, t10, t11, t12, t20, t21, t22 = frame
            x, y = min(max(xn, x_low), x_high), min(max(yn, y_low), y_high)
            p0, p1, p2, q0, q1, q2 = columns(Z, x, y, fx, fy, s0, s1, s2, frame)
            A0, B0, B1, _, c11 = whitening(p0, p1, p2, q0, q1, q2)
            g_cx, g_cy = -A0 * a[0], -B0 * a[0] - B1 * a[3]
            # N, the sum of h (u, v)^T (u, v) over the pixels, from the moments. The gradient by a column w of W is
            # A^T N A w, taken from right to left, and the first row of A W by minors, so that needles keep their digits.
            n00, n01, n11 = -A0 * a[1] - B0 * a[2], -B1 * a[2], -B1 * a[5]
            m0, m1, m2 = minors(p0, p1, p2, q0, q1, q2)
            g = A0 / c11
            u0 = g * (DILATION * p0 + q1 * m2 - q2 * m1)
            u1 = g * (DILATION * p1 + q2 * m0 - q0 * m2)
            u2 = g * (DILATION * p2 + q0 * m1 - q1 * m0)
            v0, v1, v2 = B1 * q0, B1 * q1, B1 * q2
            g_u0, g_u1, g_u2 = n00 * u0 + n01 * v0, n00 * u1 + n01 * v1, n00 * u2 + n01 * v2
            g_p0, g_p1, g_p2 = A0 * g_u0, A0 * g_u1, A0 * g_u2
            g_q0 = B0 * g_u0 + B1 * (n01 * u0 + n11 * v0)
            g_q1 = B0 * g_u1 + B1 * (n01 * u1 + n11 * v1)
            g_q2 = B0 * g_u2 + B1 * (n01 * u2 + n11 * v2)
            jx, jy = fx * iz, fy * iz
            h00, h01, h02 = jx * g_p0, jy * g_q0, -jx * x * g_p0 - jy * y * g_q0
            h10, h11, h12 = jx * g_p1, jy * g_q1, -jx * x * g_p1 - jy * y * g_q1
            h20, h21, h22 = jx * g_p2, jy * g_q2, -jx * x * g_p2 - jy * y * g_q2
            g_log_scales[n, 0] = slope0 * (h00 * t00 + h01 * t01 + h02 * t02)
            g_log_scales[n, 1] = slope1 * (h10 * t10 + h11 * t11 + h12 * t12)
            g_log_scales[n, 2] = slope2 * (h20 * t20 + h21 * t21 + h22 * t22)
            g_xn, g_yn = fx * g_cx, fy * g_cy
            if x_low < xn < x_high:
                g_xn -= jx * (g_p0 * s0 * t02 + g_p1 * s1 * t12 + g_p2 * s2 * t22)
            if y_low < yn < y_high:
                g_yn -= jy * (g_q0 * s0 * t02 + g_q1 * s1 * t12 + g_q2 * s2 * t22)
            g_X, g_Y = g_xn * iz, g_yn * iz
            g_Z = -(p0 * g_p0 + p1 * g_p1 + p2 * g_p2 + q0 * g_q0 + q1 * g_q1 + q2 * g_q2) * iz
            g_Z -= (xn * g_xn + yn * g_yn) * iz + a[15] * iz * iz
            gm0 = R[0, 0] * g_X + R[1, 0] * g_Y + R[2, 0] * g_Z
            gm1 = R[0, 1] * g_X + R[1, 1] * g_Y + R[2, 1] * g_Z
            gm2 = R[0, 2] * g_X + R[1, 2] * g_Y + R[2, 2] * g_Z
            h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
            h20, h21, h22 = h20 * s2, h21 * s2, h22 * s2
            thin = thinnest(log_scales[n, 0], log_scales[n, 1], log_scales[n, 2])
            if thin == 0:
                distance, _, side = seen_from(X, Y, Z, t00, t01, t02)
                h00, h01, h02 = h00 + side * a[16], h01 + side * a[17], h02 + side * a[18]
            elif thin == 1:
                distance, _, side = seen_from(X, Y, Z, t10, t11, t12)
                h10, h11, h12 = h10 + side * a[16], h11 + side * a[17], h12 + side * a[18]
            else:
                distance, _, side = seen_from(X, Y, Z, t20, t21, t22)
                h20, h21, h22 = h20 + side * a[16], h21 + side * a[17], h22 + side * a[18]
            quaternion_gradient(n, R, inverse, qw, qx, qy, qz, h00, h01, h02, h10, h11, h12, h20, h21, h22, g_quats)
            # Colour: no gradient where the clamp at zero held it.
            red = f64(a[10]) if records[n, rec.RED] > ZERO else 0.0
            green = f64(a[11]) if records[n, rec.GREEN] > ZERO else 0.0
            blue = f64(a[12]) if records[n, rec.BLUE] > ZERO else 0.0
            g_sh[n, 0, 0], g_sh[n, 0, 1], g_sh[n, 0, 2] = SH0 * red, SH0 * green, SH0 * blue
            if coefficients > 1:
                dx, dy, dz = means[n, 0] - eye[0], means[n, 1] - eye[1], means[n, 2] - eye[2]
                gx, gy, gz = higher_colour_gradient(
                    n, red, green, blue, dx / distance, dy / distance, dz / distance, distance, sh, coefficients, g_sh
                )
                gm0, gm1, gm2 = gm0 + gx, gm1 + gy, gm2 + gz
            for k in range(coefficients, g_sh.shape[1]):
                for c in range(3):
                    g_sh[n, k, c] = ZERO
            g_means[n, 0], g_means[n, 1], g_means[n, 2] = gm0, gm1, gm2
            # As for discs: the row holds opacity times its gradient.
            g_opacity_logits[n] = a[9] / (1.0 + np.exp(min(f64(opacity_logits[n]), 700.0)))
            g_screen[n, 0], g_screen[n, 1] = g_cx, g_cy

    return project, reduce_rows


project, reduce_rows = _kernels()

"""What is done per surfel: project, and carry gradients back. See ``raster.spec`` for the mathematics.

Scalar code, and float64 between the parameters and the records: edge-on discs cancel digits there.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.block import sources
from unveil_core.raster.cpu.camera_frame import (
    ZERO,
    axes,
    clipped_extent,
    held_scale,
    in_camera,
    pixel_range,
    quaternion_gradient,
    rotation,
    seen_from,
)
from unveil_core.raster.cpu.colours import higher_colour, higher_colour_gradient
from unveil_core.raster.cpu.rows import clear, sum_rows, write_record
from unveil_core.raster.spec import DEPTH_MAX, GENEROUS, OFFSET_MAX, SCALE_MIN_PX
from unveil_core.raster.spherical_harmonics import SH0

__all__ = ["SHARED", "project", "reduce_rows"]

f32, f64 = np.float32, np.float64
SHARED = (
    *("camera_frame.py", "colours.py", "rows.py"),
    *("../passes.py", "../records.py", "../spec.py", "../spherical_harmonics.py"),
)
"""Files that the kernels of both kinds of surfels are made of, see ``block.sources``."""


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
    ):
        """Records of the surfels that can touch the image, with activations and colour; the tiles that each touches
        (first and last column, first and last row), its depth, and ``visible`` (N,) uint8."""
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
            t00, t01, t02, t10, t11, t12, nx, ny, nz = axes(R, r0, r1, r2, r3, r4, r5, r6, r7, r8)
            h00, h01, h02, h10, h11, h12 = t00 * s0, t01 * s0, t02 * s0, t10 * s1, t11 * s1, t12 * s1
            distance, edge_on, side = seen_from(X, Y, Z, nx, ny, nz)
            nx, ny, nz = side * nx, side * ny, side * nz
            cx, cy = fx * xn + cx0, fy * yn + cy0
            U0, U1 = fx * (h00 - xn * h02), fx * (h10 - xn * h12)
            V0, V1 = fy * (h01 - yn * h02), fy * (h11 - yn * h12)
            # Exact support: G falls under 1/(255 o) at radius sqrt(k2). The bounds of what it projects to, and never
            # smaller than the low-pass filter's circle.
            k2 = max(2.0 * np.log(opacity / alpha_min), 1e-6)
            low = np.sqrt(0.5 * k2)
            x0, x1, y0, y1 = -low, low, -low, low
            # Edge-on: no ellipse. Cut by the near plane: no bounded one, so that every block is reached.
            mx, my, e0, e1, e2 = 0.0, 0.0, 1e6, 0.0, 1e6
            if not edge_on:
                slant = k2 * (h02 * h02 + h12 * h12)
                if Z - np.sqrt(slant) > near:
                    g = 1.0 / (Z * Z - slant)
                    mx, my = -k2 * (U0 * h02 + U1 * h12) * g, -k2 * (V0 * h02 + V1 * h12) * g
                    hx = np.sqrt(max(mx * mx + k2 * (U0 * U0 + U1 * U1) * g, 0.0))
                    hy = np.sqrt(max(my * my + k2 * (V0 * V0 + V1 * V1) * g, 0.0))
                    x0, x1 = min(mx - hx, -low), max(mx + hx, low)
                    y0, y1 = min(my - hy, -low), max(my + hy, low)
                else:
                    e0, e2 = 1e-12, 1e-12
                    ex0, ex1 = clipped_extent(U0, U1, h02, h12, Z, near, k2)
                    ey0, ey1 = clipped_extent(V0, V1, h02, h12, Z, near, k2)
                    x0, x1, y0, y1 = min(ex0, -low), max(ex1, low), min(ey0, -low), max(ey1, low)
            x0, x1, y0, y1 = pixel_range(cx, cy, x0, x1, y0, y1, width, height)
            if not (x1 > x0 and y1 > y0):
                continue
            # Edge-on: an intersection so far out that the low-pass filter always wins.
            a0, b0, a1, b1, a2, b2 = 1e3, 0.0, 0.0, 1e3, 0.0, 0.0
            if not edge_on:
                g = Z / (U0 * V1 - U1 * V0)
                a0, b0, a1, b1 = V1 * g, -U1 * g, -V0 * g, U0 * g
                a2, b2 = -(h02 * a0 + h12 * a1) * iz, -(h02 * b0 + h12 * b1) * iz
                if e0 == 1e6:
                    # The quadratic form A^T A - k2 (a2, b2) (a2, b2)^T, by its known determinant: nothing cancels.
                    level = GENEROUS * k2 * Z * Z / (Z * Z - slant)
                    xx, xy = a0 * a0 + a1 * a1 - k2 * a2 * a2, a0 * b0 + a1 * b1 - k2 * a2 * b2
                    det = (a0 * b1 - a1 * b0) * (a0 * b1 - a1 * b0) * (1.0 - slant * iz * iz)
                    e0 = np.sqrt(xx / level)
                    e1, e2 = xy / (level * e0), np.sqrt(det / (xx * level))
            if not exact_reach:
                e0, e1, e2 = 1e-12, 0.0, 1e-12
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
                labels[i],
                GENEROUS * low * low,
                cx + mx,
                cy + my,
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
    ):
        """Sum each surfel's rows in a fixed order and carry them back to its parameters; zero for those off the screen."""
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
            inverse, w, x, y, z, r0, r1, r2, r3, r4, r5, r6, r7, r8 = rotation(
                f64(quats[n, 0]), f64(quats[n, 1]), f64(quats[n, 2]), f64(quats[n, 3])
            )
            floor = SCALE_MIN_PX * Z / max(fx, fy)
            s0, slope0 = held_scale(log_scales[n, 0], floor)
            s1, slope1 = held_scale(log_scales[n, 1], floor)
            t00, t01, t02, t10, t11, t12, nx, ny, nz = axes(R, r0, r1, r2, r3, r4, r5, r6, r7, r8)
            distance, edge_on, side = seen_from(X, Y, Z, nx, ny, nz)
            xn, yn, W0, W1 = X * iz, Y * iz, t02 * s0, t12 * s1
            U0, U1 = fx * (t00 * s0 - xn * W0), fx * (t10 * s1 - xn * W1)
            V0, V1 = fy * (t01 * s0 - yn * W0), fy * (t11 * s1 - yn * W1)
            g_cx, g_cy, g_Z = 2.0 * a[13], 2.0 * a[14], 0.0
            g_U0, g_U1, g_V0, g_V1, g_W0, g_W1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            if not edge_on:
                g = Z / (U0 * V1 - U1 * V0)
                A0, B0, A1, B1 = V1 * g, -U1 * g, -V0 * g, U0 * g
                A2, B2 = -(W0 * A0 + W1 * A1) * iz, -(W0 * B0 + W1 * B1) * iz
                g_cx -= A0 * a[0] + A1 * a[3] + A2 * a[6]
                g_cy -= B0 * a[0] + B1 * a[3] + B2 * a[6]
                # A = (J / Z)^-1 and (a2, b2) = -(W0 (a0, b0) + W1 (a1, b1)) / Z, backwards
                g_a2, g_b2 = f64(a[7]), f64(a[8])
                g_a0, g_a1 = a[1] - W0 * iz * g_a2, a[4] - W1 * iz * g_a2
                g_b0, g_b1 = a[2] - W0 * iz * g_b2, a[5] - W1 * iz * g_b2
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
            g_Z -= (xn * g_xn + yn * g_yn) * iz + a[15] * iz * iz
            gm0 = R[0, 0] * g_X + R[1, 0] * g_Y + R[2, 0] * g_Z
            gm1 = R[0, 1] * g_X + R[1, 1] * g_Y + R[2, 1] * g_Z
            gm2 = R[0, 2] * g_X + R[1, 2] * g_Y + R[2, 2] * g_Z
            # Colour: no gradient where the clamp at zero held it.
            red = f64(a[10]) if records[n, rec.RED] > ZERO else 0.0
            green = f64(a[11]) if records[n, rec.GREEN] > ZERO else 0.0
            blue = f64(a[12]) if records[n, rec.BLUE] > ZERO else 0.0
            dx, dy, dz = (
                (means[n, 0] - eye[0]) / distance,
                (means[n, 1] - eye[1]) / distance,
                (means[n, 2] - eye[2]) / distance,
            )
            g_sh[n, 0, 0], g_sh[n, 0, 1], g_sh[n, 0, 2] = SH0 * red, SH0 * green, SH0 * blue
            if coefficients > 1:
                gx, gy, gz = higher_colour_gradient(n, red, green, blue, dx, dy, dz, distance, sh, coefficients, g_sh)
                gm0, gm1, gm2 = gm0 + gx, gm1 + gy, gm2 + gz
            for k in range(coefficients, g_sh.shape[1]):
                for c in range(3):
                    g_sh[n, k, c] = ZERO
            g_means[n, 0], g_means[n, 1], g_means[n, 2] = gm0, gm1, gm2
            g_log_scales[n, 0] = slope0 * (h00 * t00 + h01 * t01 + h02 * t02)
            g_log_scales[n, 1] = slope1 * (h10 * t10 + h11 * t11 + h12 * t12)
            h00, h01, h02, h10, h11, h12 = h00 * s0, h01 * s0, h02 * s0, h10 * s1, h11 * s1, h12 * s1
            h20, h21, h22 = side * a[16], side * a[17], side * a[18]
            quaternion_gradient(n, R, inverse, w, x, y, z, h00, h01, h02, h10, h11, h12, h20, h21, h22, g_quats)
            # The row holds opacity times its gradient; sigmoid' = opacity (1 - opacity), without cancellation near 1.
            g_opacity_logits[n] = a[9] / (1.0 + np.exp(min(f64(opacity_logits[n]), 700.0)))
            g_screen[n, 0], g_screen[n, 1] = g_cx, g_cy

    return project, reduce_rows


project, reduce_rows = _kernels()

"""What is done per surfel: project, and carry gradients back. See ``raster.spec`` for the mathematics.

Scalar code, and float64 between the parameters and the records: edge-on discs cancel digits there.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST
from unveil_core.raster import records as rec
from unveil_core.raster.passes import TILE
from unveil_core.raster.spec import DEPTH_MAX, EDGE_ON, GENEROUS, LOG_SCALE_MAX, OFFSET_MAX, SCALE_MIN_PX
from unveil_core.raster.spherical_harmonics import SH0, SH1, SH2, SH3

f32, f64, u64, i64 = np.float32, np.float64, np.uint64, np.int64
INLINED = {**FAST, "forceinline": True}

ZERO = f32(0)


@njit(**INLINED)
def sh_basis(x, y, z):
    """The 16 basis functions of degree 0 to 3 at a unit direction, as ``spherical_harmonics.basis``."""
    xx, yy, zz = x * x, y * y, z * z
    return (
        SH0,
        -SH1 * y,
        SH1 * z,
        -SH1 * x,
        SH2[0] * x * y,
        SH2[1] * y * z,
        SH2[2] * (2 * zz - xx - yy),
        SH2[3] * x * z,
        SH2[4] * (xx - yy),
        SH3[0] * y * (3 * xx - yy),
        SH3[1] * x * y * z,
        SH3[2] * y * (4 * zz - xx - yy),
        SH3[3] * z * (2 * zz - 3 * xx - 3 * yy),
        SH3[4] * x * (4 * zz - xx - yy),
        SH3[5] * z * (xx - yy),
        SH3[6] * x * (xx - 3 * yy),
    )


@njit(**INLINED)
def sh_slopes(x, y, z):
    """Their partial derivatives by x, y and z: three tuples of 16."""
    xx, yy, zz = x * x, y * y, z * z
    by_x = (
        0.0,
        0.0,
        0.0,
        -SH1,
        SH2[0] * y,
        0.0,
        -2 * SH2[2] * x,
        SH2[3] * z,
        2 * SH2[4] * x,
        6 * SH3[0] * x * y,
        SH3[1] * y * z,
        -2 * SH3[2] * x * y,
        -6 * SH3[3] * x * z,
        SH3[4] * (4 * zz - 3 * xx - yy),
        2 * SH3[5] * x * z,
        3 * SH3[6] * (xx - yy),
    )
    by_y = (
        0.0,
        -SH1,
        0.0,
        0.0,
        SH2[0] * x,
        SH2[1] * z,
        -2 * SH2[2] * y,
        0.0,
        -2 * SH2[4] * y,
        3 * SH3[0] * (xx - yy),
        SH3[1] * x * z,
        SH3[2] * (4 * zz - xx - 3 * yy),
        -6 * SH3[3] * y * z,
        -2 * SH3[4] * x * y,
        -2 * SH3[5] * y * z,
        -6 * SH3[6] * x * y,
    )
    by_z = (
        0.0,
        0.0,
        SH1,
        0.0,
        0.0,
        SH2[1] * y,
        4 * SH2[2] * z,
        SH2[3] * x,
        0.0,
        0.0,
        SH3[1] * x * y,
        8 * SH3[2] * y * z,
        SH3[3] * (6 * zz - 3 * xx - 3 * yy),
        8 * SH3[4] * x * z,
        SH3[5] * (xx - yy),
        0.0,
    )
    return by_x, by_y, by_z


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
def held_scale(log_scale, floor):
    """The standard deviation within its limits, and its derivative by the logarithm: itself, or zero at a limit."""
    scale = np.exp(min(f64(log_scale), LOG_SCALE_MAX))
    slope = scale if log_scale < LOG_SCALE_MAX else 0.0
    return (scale, slope) if scale > floor else (floor, 0.0)


@njit(**INLINED)
def in_camera(means, i, R, t):
    """A surfel's centre in the camera's frame."""
    return (
        R[0, 0] * means[i, 0] + R[0, 1] * means[i, 1] + R[0, 2] * means[i, 2] + t[0],
        R[1, 0] * means[i, 0] + R[1, 1] * means[i, 1] + R[1, 2] * means[i, 2] + t[1],
        R[2, 0] * means[i, 0] + R[2, 1] * means[i, 1] + R[2, 2] * means[i, 2] + t[2],
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
def higher_colour(i, dx, dy, dz, sh, coefficients):
    """What the coefficients after the first add to a surfel's colour in a direction."""
    basis = sh_basis(dx, dy, dz)
    r, g, b = ZERO, ZERO, ZERO
    for k in range(1, coefficients):
        weight = f32(basis[k])
        r += weight * sh[i, k, 0]
        g += weight * sh[i, k, 1]
        b += weight * sh[i, k, 2]
    return r, g, b


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
def higher_colour_gradient(n, red, green, blue, dx, dy, dz, distance, sh, coefficients, g_sh):
    """The colour's gradient back to the coefficients after the first; returns what it adds to the mean's."""
    basis = sh_basis(dx, dy, dz)
    by_x, by_y, by_z = sh_slopes(dx, dy, dz)
    red32, green32, blue32 = f32(red), f32(green), f32(blue)
    gx, gy, gz = 0.0, 0.0, 0.0
    for k in range(1, coefficients):
        value = f32(basis[k])
        g_sh[n, k, 0], g_sh[n, k, 1], g_sh[n, k, 2] = value * red32, value * green32, value * blue32
        weight = red32 * sh[n, k, 0] + green32 * sh[n, k, 1] + blue32 * sh[n, k, 2]
        gx += weight * by_x[k]
        gy += weight * by_y[k]
        gz += weight * by_z[k]
    radial = gx * dx + gy * dy + gz * dz
    return (gx - radial * dx) / distance, (gy - radial * dy) / distance, (gz - radial * dz) / distance


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


CHUNK = 8192


@njit(**FAST)
def count_not_finite(first, end, bits, bad):
    """How many of some float32 numbers, given by their bits, are NaN or infinite (fast math forgets NaN); ``bad`` gets
    the count of each chunk of ``CHUNK``."""
    for chunk in range(first // CHUNK, (end + CHUNK - 1) // CHUNK):
        here = np.uint32(0)
        for i in range(u64(chunk * CHUNK), u64(min(bits.size, (chunk + 1) * CHUNK))):
            here += np.uint32((bits[i] & np.uint32(0x7F800000)) == np.uint32(0x7F800000))
        bad[chunk] = here


@njit(**FAST)
def label_ends(first, end, labels, ends):
    """Least and greatest label of each chunk of ``CHUNK``, as the columns of ``ends``."""
    for chunk in range(first // CHUNK, (end + CHUNK - 1) // CHUNK):
        low = high = labels[chunk * CHUNK]
        for i in range(u64(chunk * CHUNK), u64(min(labels.size, (chunk + 1) * CHUNK))):
            low, high = min(low, labels[i]), max(high, labels[i])
        ends[chunk, 0], ends[chunk, 1] = low, high

"""The losses' arithmetic in numba: value and gradient in one go, rows shared out between threads.

Images are flattened to (H, 3 W) rows, so that a blur along a row is a sum of shifted rows and every inner loop runs over
neighbouring numbers. Each loop writes one row only: LLVM then vectorizes it without asking whether two rows overlap.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST

f32, u64 = np.float32, np.uint64
REACH = 5
"""The structural term's Gaussian window is 11 pixels wide, sigma 1.5 (Wang et al. 2004)."""
PAD = 3 * REACH
C1, C2 = f32(0.01**2), f32(0.03**2)
ZERO, ONE, TWO = f32(0), f32(1), f32(2)


def window() -> np.ndarray:
    """(11,) float32 taps that sum to one."""
    taps = np.exp(-(np.arange(-REACH, REACH + 1) ** 2) / (2 * 1.5**2))
    return (taps / taps.sum()).astype(np.float32)


@njit(inline="always")
def _across(column, out, m, taps):
    """Row ``m`` of ``out`` becomes row ``m`` of ``column`` (padded by ``PAD``) blurred along the row."""
    n = u64(out.shape[1])
    for i in range(n):
        out[m, i] = taps[0] * column[m, i]
    for k in range(1, 2 * REACH + 1):
        tap = taps[k]
        shift = u64(3 * k)
        for i in range(n):
            out[m, i] += tap * column[m, i + shift]


@njit(inline="always")
def _down(column, m, a, b, product, r, taps):
    """Row ``m`` of ``column`` becomes ``a``, or the product of ``a`` and ``b``, blurred down the columns at row ``r``."""
    rows, n, pad = a.shape[0], u64(a.shape[1]), u64(PAD)
    for i in range(n):
        column[m, pad + i] = ZERO
    for k in range(2 * REACH + 1):
        s = r + k - REACH
        if s < 0 or s >= rows:
            continue
        tap = taps[k]
        for i in range(n):
            column[m, pad + i] += tap * (a[s, i] * b[s, i] if product else a[s, i])


@njit(**FAST)
def ssim_rows(start, stop, x, y, taps, ssim_sum, l1_sum, d_mean, d_square, d_product):
    """Sums of |x - y| and of SSIM per row, and SSIM's derivatives by the blurred x, x*x and x*y (Wang et al. 2004,
    equation 13). All images (H, 3 W); a zero border makes the blur its own adjoint."""
    width = x.shape[1]
    n = u64(width)
    column = np.zeros((5, width + 2 * PAD), f32)
    blurred = np.empty((5, width), f32)
    for r in range(start, stop):
        _down(column, 0, x, x, False, r, taps)
        _down(column, 1, y, y, False, r, taps)
        _down(column, 2, x, x, True, r, taps)
        _down(column, 3, y, y, True, r, taps)
        _down(column, 4, x, y, True, r, taps)
        for m in range(5):
            _across(column, blurred, m, taps)
        total, difference = ZERO, ZERO
        for i in range(n):
            mx, my = blurred[0, i], blurred[1, i]
            xx, yy, xy = blurred[2, i] - mx * mx, blurred[3, i] - my * my, blurred[4, i] - mx * my
            a1, a2 = TWO * mx * my + C1, TWO * xy + C2
            b1, b2 = mx * mx + my * my + C1, xx + yy + C2
            ssim = a1 * a2 / (b1 * b2)
            d_square[r, i] = -ssim / b2
            total += ssim
        for i in range(n):
            mx, my = blurred[0, i], blurred[1, i]
            xx, yy = blurred[2, i] - mx * mx, blurred[3, i] - my * my
            d_product[r, i] = TWO * (TWO * mx * my + C1) / ((mx * mx + my * my + C1) * (xx + yy + C2))
        for i in range(n):
            mx, my = blurred[0, i], blurred[1, i]
            b1 = mx * mx + my * my + C1
            b2 = blurred[2, i] - mx * mx + blurred[3, i] - my * my + C2
            a2 = TWO * (blurred[4, i] - mx * my) + C2
            ssim = (TWO * mx * my + C1) * a2 / (b1 * b2)
            by_mean = TWO * (my * a2 / (b1 * b2) - mx * ssim / b1)
            d_mean[r, i] = by_mean - TWO * mx * d_square[r, i] - my * d_product[r, i]
        for i in range(n):
            difference += abs(x[r, i] - y[r, i])
        ssim_sum[r] = total
        l1_sum[r] = difference


@njit(**FAST)
def l1_dssim_gradient(start, stop, x, y, taps, d_mean, d_square, d_product, l1_scale, dssim_scale, gradient):
    """Gradient (H, 3 W) of ``l1_scale * sum |x - y| - dssim_scale * sum SSIM``."""
    width = x.shape[1]
    n = u64(width)
    column = np.zeros((3, width + 2 * PAD), f32)
    blurred = np.empty((3, width), f32)
    for r in range(start, stop):
        _down(column, 0, d_mean, d_mean, False, r, taps)
        _down(column, 1, d_square, d_square, False, r, taps)
        _down(column, 2, d_product, d_product, False, r, taps)
        for m in range(3):
            _across(column, blurred, m, taps)
        for i in range(n):
            a, b = x[r, i], y[r, i]
            side = l1_scale if a > b else -l1_scale
            side = side if a != b else ZERO
            gradient[r, i] = side - dssim_scale * (blurred[0, i] + TWO * a * blurred[1, i] + b * blurred[2, i])


@njit(**FAST)
def cross_entropy_rows(start, stop, semantics, alpha, target, weight, sky, scale, sums, g_semantics, g_alpha):
    """Weighted negative log likelihood per row, and its gradients times ``scale``; see ``semantic_cross_entropy``.

    Args:
        weight: (H, W), or (0, 0) for one everywhere; sky: label or -1.
    """
    floor = f32(1e-3)
    for r in range(start, stop):
        total = 0.0
        for c in range(alpha.shape[1]):
            for k in range(semantics.shape[2]):
                g_semantics[r, c, k] = ZERO
            g_alpha[r, c] = ZERO
            label = target[r, c]
            if label < 0:
                continue
            w = weight[r, c] if weight.shape[0] > 0 else ONE
            a = alpha[r, c]
            if label == sky:
                p = ONE - a
                slope = w * scale / (max(p, ZERO) + floor)
                g_alpha[r, c] = slope if p >= ZERO else ZERO
            else:
                p = semantics[r, c, label]
                if sky < 0:
                    below = max(a, floor)
                    p = p / below
                    slope = w * scale / (max(p, ZERO) + floor) if p >= ZERO else ZERO
                    g_semantics[r, c, label] = -slope / below
                    g_alpha[r, c] = slope * p / below if a >= floor else ZERO
                else:
                    g_semantics[r, c, label] = -w * scale / (max(p, ZERO) + floor) if p >= ZERO else ZERO
            total -= w * np.log(max(p, ZERO) + floor)
        sums[r] = total


@njit(**FAST)
def normal_rows(start, stop, normal, depth, alpha, rays, weight, scale, sums, g_normal, g_along, g_down):
    """Rows 1 to H - 2 of the normals' disagreement, the gradient by the normals, and by the differences of points along
    a row and down a column (H, W, 3), which are zero on the border."""
    width = depth.shape[1]
    floor = f32(1e-3)
    for r in range(start, stop):
        total = 0.0
        border = r == 0 or r == depth.shape[0] - 1
        for c in range(width):
            if border or c == 0 or c == width - 1:
                for k in range(3):
                    g_normal[r, c, k] = ZERO
                    g_along[r, c, k] = ZERO
                    g_down[r, c, k] = ZERO
                continue
            d_left, d_right = (
                depth[r, c - 1] / max(alpha[r, c - 1], floor),
                depth[r, c + 1] / max(alpha[r, c + 1], floor),
            )
            d_up, d_low = depth[r - 1, c] / max(alpha[r - 1, c], floor), depth[r + 1, c] / max(alpha[r + 1, c], floor)
            ax = rays[r, c + 1, 0] * d_right - rays[r, c - 1, 0] * d_left
            ay = rays[r, c + 1, 1] * d_right - rays[r, c - 1, 1] * d_left
            az = rays[r, c + 1, 2] * d_right - rays[r, c - 1, 2] * d_left
            bx = rays[r + 1, c, 0] * d_low - rays[r - 1, c, 0] * d_up
            by = rays[r + 1, c, 1] * d_low - rays[r - 1, c, 1] * d_up
            bz = rays[r + 1, c, 2] * d_low - rays[r - 1, c, 2] * d_up
            nx, ny, nz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            inverse = ONE / max(length, f32(1e-12))
            nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
            opaque = alpha[r, c]
            w = opaque * (weight[r, c] if weight.shape[0] > 0 else ONE)
            gx, gy, gz = normal[r, c, 0], normal[r, c, 1], normal[r, c, 2]
            dot = nx * gx + ny * gy + nz * gz
            total += w * (opaque - dot)
            s = w * scale
            g_normal[r, c, 0] = -s * nx
            g_normal[r, c, 1] = -s * ny
            g_normal[r, c, 2] = -s * nz
            # through the normalization, then the cross product down x along
            s = s * inverse if length > f32(1e-12) else ZERO
            gx, gy, gz = -s * (gx - nx * dot), -s * (gy - ny * dot), -s * (gz - nz * dot)
            g_down[r, c, 0] = ay * gz - az * gy
            g_down[r, c, 1] = az * gx - ax * gz
            g_down[r, c, 2] = ax * gy - ay * gx
            g_along[r, c, 0] = gy * bz - gz * by
            g_along[r, c, 1] = gz * bx - gx * bz
            g_along[r, c, 2] = gx * by - gy * bx
        sums[r] = total


@njit(**FAST)
def normal_to_depth(start, stop, depth, alpha, rays, g_along, g_down, g_depth, g_alpha):
    """Collect the gradients of the four differences that a pixel's point is in, along its ray."""
    height, width = depth.shape
    floor = f32(1e-3)
    for r in range(start, stop):
        for c in range(width):
            g = ZERO
            for k in range(3):
                here = ZERO
                if c > 0:
                    here += g_along[r, c - 1, k]
                if c < width - 1:
                    here -= g_along[r, c + 1, k]
                if r > 0:
                    here += g_down[r - 1, c, k]
                if r < height - 1:
                    here -= g_down[r + 1, c, k]
                g += here * rays[r, c, k]
            below = max(alpha[r, c], floor)
            g_depth[r, c] = g / below
            g_alpha[r, c] = -g * depth[r, c] / (below * below) if alpha[r, c] >= floor else ZERO


@njit(inline="always")
def _corner(position, size):
    """The pixel below a position from -1 to 1 along a side of so many pixels, held within, and the share of the one above."""
    place = min(max(f32(0.5) * ((position + ONE) * f32(size) - ONE), ZERO), f32(size - 1))
    low = min(int(place), size - 2)
    return low, place - f32(low)


@njit(**FAST)
def sky_rows(start, stop, rgb, alpha, grid, texture, sky, image):
    """Colour (H, W, 3) over the sky where alpha (H, W) leaves light through, into ``image``; the sky alone into ``sky``.

    ``texture`` (3, E, A) is sampled at ``grid`` (H, W, 2) as ``Sky.sample`` does: bilinear, with one more column on each side.
    """
    around = texture.shape[2]
    for y in range(start, stop):
        for x in range(rgb.shape[1]):
            column, u = _corner(grid[y, x, 0], around + 2)
            row, v = _corner(grid[y, x, 1], texture.shape[1])
            left, right = (column + around - 1) % around, column % around
            a, b, c, d = (ONE - u) * (ONE - v), u * (ONE - v), (ONE - u) * v, u * v
            through = ONE - alpha[y, x]
            for k in range(3):
                t = texture[k]
                seen = a * t[row, left] + b * t[row, right] + c * t[row + 1, left] + d * t[row + 1, right]
                sky[y, x, k] = seen
                image[y, x, k] = rgb[y, x, k] + through * seen


@njit(**FAST)
def sky_gradient(start, stop, rows, alpha, grid, sky, gradient, by_alpha, by_texture):
    """Gradients by alpha (H, W), and by the texture (B, 3, E, A), of each of ``B`` bands of so many rows by itself."""
    around, height = by_texture.shape[3], alpha.shape[0]
    for band in range(start, stop):
        found = by_texture[band]
        for y in range(band * rows, min((band + 1) * rows, height)):
            for x in range(alpha.shape[1]):
                column, u = _corner(grid[y, x, 0], around + 2)
                row, v = _corner(grid[y, x, 1], found.shape[1])
                left, right = (column + around - 1) % around, column % around
                through, total = ONE - alpha[y, x], ZERO
                for k in range(3):
                    g = gradient[y, x, k]
                    total -= g * sky[y, x, k]
                    part = g * through
                    low, high = part * (ONE - v), part * v
                    found[k, row, left] += low * (ONE - u)
                    found[k, row, right] += low * u
                    found[k, row + 1, left] += high * (ONE - u)
                    found[k, row + 1, right] += high * u
                by_alpha[y, x] = total

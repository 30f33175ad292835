"""The colour of a surfel by direction, from its spherical harmonics, and its gradient back. See ``raster.spec``."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import INLINED
from unveil_core.raster.cpu.camera_frame import ZERO
from unveil_core.raster.spherical_harmonics import SH0, SH1, SH2, SH3

__all__ = ["higher_colour", "higher_colour_gradient", "sh_basis", "sh_slopes"]

f32 = np.float32


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

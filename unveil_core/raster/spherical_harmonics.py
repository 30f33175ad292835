"""Real spherical harmonics up to degree 3 as view-dependent colour, in the order and signs of 3D Gaussian Splatting
files.

This is the plain torch form, of any float type. The CPU backend evaluates the same polynomials inside its projection,
and their gradient by hand inside its reduction, for the surfels on the screen only.
"""

from __future__ import annotations

import torch
from torch import Tensor

__all__ = ["SH0", "SH1", "SH2", "SH3", "basis", "evaluate"]

SH0 = 0.28209479177387814
SH1 = 0.4886025119029199
SH2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
SH3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)


def basis(directions: Tensor, degree: int) -> Tensor:
    """(N, (degree+1)^2) basis functions at unit directions (N, 3), degree 0 to 3."""
    if not 0 <= degree <= 3:
        raise ValueError(f"spherical harmonics of degree {degree}; 0 to 3 are known")
    x, y, z = directions.unbind(-1)
    terms = [torch.full_like(x, SH0)]
    if degree >= 1:
        terms += [-SH1 * y, SH1 * z, -SH1 * x]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        terms += [SH2[0] * x * y, SH2[1] * y * z, SH2[2] * (2 * zz - xx - yy), SH2[3] * x * z, SH2[4] * (xx - yy)]
    if degree >= 3:
        terms += [
            SH3[0] * y * (3 * xx - yy),
            SH3[1] * x * y * z,
            SH3[2] * y * (4 * zz - xx - yy),
            SH3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            SH3[4] * x * (4 * zz - xx - yy),
            SH3[5] * z * (xx - yy),
            SH3[6] * x * (xx - 3 * yy),
        ]
    return torch.stack(terms, dim=-1)


def evaluate(sh: Tensor, directions: Tensor) -> Tensor:
    """Colours (N, 3) = max(0, 0.5 + sum of basis * sh), for sh (N, (L+1)^2, 3) and unit directions (N, 3)."""
    degree = round(sh.shape[1] ** 0.5) - 1
    if degree == 0:
        return (0.5 + SH0 * sh[:, 0]).clamp_min(0.0)
    return (0.5 + torch.bmm(basis(directions, degree)[:, None], sh)[:, 0]).clamp_min(0.0)

"""The basis against what defines it: orthonormal over the sphere, and of the stated degree."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.raster.cpu.colours import sh_basis, sh_slopes
from unveil_core.raster.spherical_harmonics import basis, evaluate


def sphere() -> tuple[torch.Tensor, torch.Tensor]:
    """Directions (M, 3) and weights (M,) of a quadrature that is exact to degree 12."""
    z, wz = np.polynomial.legendre.leggauss(8)
    phi = np.arange(16) * 2 * np.pi / 16
    r = np.sqrt(1 - z**2)
    d = np.stack([r[:, None] * np.cos(phi), r[:, None] * np.sin(phi), np.repeat(z[:, None], 16, axis=1)], axis=-1)
    return torch.from_numpy(d.reshape(-1, 3)), torch.from_numpy(np.repeat(wz * 2 * np.pi / 16, 16))


def test_basis_is_orthonormal() -> None:
    directions, weights = sphere()
    values = basis(directions, 3)
    torch.testing.assert_close(values.T @ (values * weights[:, None]), torch.eye(16, dtype=torch.float64))


def test_functions_of_degree_l_have_parity_l() -> None:
    directions, _ = sphere()
    sign = torch.cat([torch.full((2 * degree + 1,), float((-1) ** degree)) for degree in range(4)]).double()
    torch.testing.assert_close(basis(-directions, 3), basis(directions, 3) * sign)


def test_order_and_signs_of_the_file_format() -> None:
    """Degree one in a 3D Gaussian Splatting file is (-y, z, -x)."""
    values = basis(torch.eye(3, dtype=torch.float64), 1)[:, 1:] / 0.4886025119029199
    torch.testing.assert_close(values, torch.tensor([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]], dtype=torch.float64))


def test_kernel_basis_and_slopes_agree_with_torch() -> None:
    directions = sphere()[0][::7].clone().requires_grad_(True)
    values = basis(directions, 3)
    for k in range(16):
        (slope,) = torch.autograd.grad(values[:, k].sum(), directions, retain_graph=True, allow_unused=True)
        for i, d in enumerate(directions.detach().numpy()):
            assert sh_basis(*d)[k] == pytest.approx(float(values[i, k].detach()), abs=1e-12)
            mine = [axis[k] for axis in sh_slopes(*d)]
            assert mine == pytest.approx((slope[i] if slope is not None else torch.zeros(3)).tolist(), abs=1e-12)


def test_evaluate_clamps_at_zero_and_refuses_what_it_does_not_know() -> None:
    sh = torch.zeros(2, 4, 3)
    sh[0, 0], sh[1, 0] = 1.0, -4.0
    colour = evaluate(sh, torch.tensor([[0.0, 0, 1], [0, 0, 1]]))
    torch.testing.assert_close(colour, torch.tensor([[0.5 + 0.28209479] * 3, [0.0] * 3]))
    with pytest.raises(ValueError, match="degree 4"):
        basis(torch.zeros(1, 3), 4)

"""Splats in the coordinates of a file: moved, turned with their colours by direction, and scaled."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from unveil_core.base.types import Float64
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import rotation_to_quat
from unveil_core.raster.spherical_harmonics import basis
from unveil_core.surfels.surfels import Surfels

__all__ = ["opacities", "placed", "turned_sh"]

DIRECTIONS = 64
"""Directions at which turned colours are fitted: four times the coefficients of degree 3, so that the fit is exact to rounding."""


def placed(surfels: Surfels, place: Similarity) -> Surfels:
    """The splats (N) of local coordinates in those that ``place`` leads to, with quaternions of unit length.

    A renderer sees the same as before if its camera is moved likewise: colours by direction are turned, too.
    """
    s = surfels.detach()
    means = torch.from_numpy(place.to_world(s.means.double().numpy()).astype(np.float32))
    log_scales = s.log_scales + math.log(place.scale)
    quats = normalize(s.quats, dim=1)
    quats = torch.where((s.quats == 0).all(dim=1, keepdim=True), quats.new_tensor([1.0, 0.0, 0.0, 0.0]), quats)
    if not place.turns:
        return replace(s, means=means, log_scales=log_scales, quats=quats)
    turn = torch.from_numpy(rotation_to_quat(place.rotation))
    quats = normalize(_product(turn, quats.double()), dim=1).float()
    return replace(s, means=means, log_scales=log_scales, quats=quats, sh=turned_sh(s.sh, place.rotation))


def _product(left: Tensor, right: Tensor) -> Tensor:
    """(N, 4) quaternions wxyz: ``left`` (4,) times ``right`` (N, 4)."""
    w, x, y, z = left
    rows = [[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]
    return right @ torch.stack([torch.stack(row) for row in rows]).T


def turned_sh(sh: Tensor, rotation: Float64) -> Tensor:
    """Coefficients (N, (L+1)^2, 3) of colours that are turned by a rotation (3, 3).

    Each degree is turned by a matrix of its own, which follows from the basis at some directions.
    """
    degree = round(sh.shape[1] ** 0.5) - 1
    if degree == 0:
        return sh
    generator = np.random.default_rng(0)
    directions = generator.normal(size=(DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    new = basis(torch.from_numpy(directions), degree).numpy()
    old = basis(torch.from_numpy(directions @ rotation), degree).numpy()  # where these directions were before
    parts = [sh[:, :1]]
    for level in range(1, degree + 1):
        band = slice(level * level, (level + 1) ** 2)
        matrix = np.linalg.lstsq(new[:, band], old[:, band], rcond=None)[0]
        parts.append(torch.einsum("ij,njc->nic", torch.from_numpy(matrix).to(sh.dtype), sh[:, band]))
    return torch.cat(parts, dim=1)


def opacities(surfels: Surfels) -> Tensor:
    """(N,) 0 to 1."""
    return torch.sigmoid(surfels.opacity_logits)

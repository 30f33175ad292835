"""Surfels: the parameters of a semantic 2D Gaussian scene.

The representation of *2D Gaussian Splatting* (SIGGRAPH 2024), section 4.1: a disc with two tangent axes, their scales and an
opacity; colour as spherical harmonics; with one hard label each (*3D StreetUnveiler*, section 3.1). With a third scale it is the
ellipsoid of *3D Gaussian Splatting* (SIGGRAPH 2023), section 4, for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TypedDict

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import normalize

from unveil_core.base.errors import SettingsError

__all__ = [
    "FLATNESS",
    "THIN_LOG_SCALE",
    "GsplatScene",
    "Surfels",
    "as_ellipsoids",
    "concatenate",
    "rotations",
    "three_log_scales",
    "with_sh_degree",
]


FLATNESS = 0.1
"""Thickness of an ellipsoid that stands for a disc, as a share of its smaller extent."""
THIN_LOG_SCALE = math.log(1e-4)
"""The third scale that is given to programs that expect ellipsoids, natural logarithm of metres: a tenth of a millimetre."""
OPAQUE = 1 - 1e-6
"""The largest opacity that is taken from other programs: the logit of 1 is infinite. The rasterizer stops at 0.99."""


def rotations(quats: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) of quaternions wxyz (N, 4) of any length; of a zero one, the identity."""
    w, x, y, z = normalize(quats, dim=1).unbind(1)
    columns = [
        torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], dim=1),
        torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], dim=1),
        torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1),
    ]
    return torch.stack(columns, dim=2)


class GsplatScene(TypedDict):
    """What ``gsplat.rasterization_2dgs`` takes of a scene, see :meth:`Surfels.as_gsplat`."""

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    colors: Tensor
    sh_degree: int


@dataclass(frozen=True, eq=False)
class Surfels:
    """N surfels, all discs or all ellipsoids; float32 tensors on one device.

    Attributes:
        means: (N, 3) centres in the drive's local frame.
        quats: (N, 4) rotations wxyz, not necessarily normalized; columns 0 and 1 of the rotation are the tangent axes,
            column 2 the normal.
        log_scales: (N, 2) natural logarithm of the standard deviations along the tangent axes, in metres; of an
            ellipsoid (N, 3), along all columns of the rotation.
        opacity_logits: (N,) opacity before the sigmoid.
        sh: (N, (L+1)^2, 3) spherical-harmonic colour; rgb = clamp(0.5 + sum of basis * sh, 0).
        labels: (N,) int64 compact labels (see ``semantics.classes.LabelSet``), never trained.
    """

    means: Tensor
    quats: Tensor
    log_scales: Tensor
    opacity_logits: Tensor
    sh: Tensor
    labels: Tensor

    def __len__(self) -> int:
        return int(self.means.shape[0])

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """The parameters by name."""
        return {f.name: getattr(self, f.name).detach().cpu().numpy() for f in fields(self)}

    @staticmethod
    def from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> Surfels:
        """Inverse of :meth:`arrays`."""
        return Surfels(**{f.name: torch.from_numpy(arrays[f.name]) for f in fields(Surfels)})

    @property
    def device(self) -> torch.device:
        """Where the tensors are."""
        return self.means.device

    def to(self, device: torch.device | str) -> Surfels:
        """The same on a device; themselves where they are there already."""
        if self.device == torch.device(device):
            return self
        return Surfels(*(getattr(self, f.name).to(device) for f in fields(self)))

    @property
    def sh_degree(self) -> int:
        """L, from the number of coefficients."""
        return round(self.sh.shape[1] ** 0.5) - 1

    @property
    def ellipsoids(self) -> bool:
        """Whether these are 3D Gaussians, with three scales, and not discs."""
        return self.log_scales.shape[-1] == 3

    def normal_axes(self) -> Tensor:
        """(N,) int64: which column of the rotation is the normal, of an ellipsoid that of the smallest scale (the last
        of equals)."""
        if not self.ellipsoids:
            return torch.full((len(self),), 2, device=self.device)
        return 2 - self.log_scales.detach().flip(1).argmin(dim=1)

    def normals(self) -> Tensor:
        """(N, 3) unit normals, unturned."""
        rows = torch.arange(len(self), device=self.device)
        return rotations(self.quats)[rows, :, self.normal_axes()]

    def select(self, index: Tensor) -> Surfels:
        """The surfels at a boolean mask (N,) or integer index (M,)."""
        return Surfels(*(getattr(self, f.name)[index] for f in fields(self)))

    def split(self, counts: Sequence[int]) -> list[Surfels]:
        """Consecutive surfels, so many each, N in all: views that share these ones' memory."""
        columns = [getattr(self, f.name).split(list(counts)) for f in fields(self)]
        return [Surfels(*parts) for parts in zip(*columns, strict=True)]

    def as_gsplat(self) -> GsplatScene:
        """The arguments that ``gsplat.rasterization_2dgs`` takes of a scene, with activated values, on the same device.

        Gradients flow through them. Labels are not among them, and a disc's third scale is a thin constant that gsplat leaves out.

        Returns:
            ``means`` (N, 3); ``quats`` (N, 4) unit, wxyz; ``scales`` (N, 3) metres; ``opacities`` (N,) from 0 to 1; ``colors``
            (N, (L+1)^2, 3) spherical harmonics, to which gsplat adds 0.5 as the rasterizer here does; ``sh_degree`` L.
        """
        identity = self.quats.new_tensor([1.0, 0.0, 0.0, 0.0])
        quats = torch.where(self.quats.norm(dim=1, keepdim=True) > 0, normalize(self.quats, dim=1), identity)
        return {
            "means": self.means,
            "quats": quats,
            "scales": three_log_scales(self).exp(),
            "opacities": torch.sigmoid(self.opacity_logits),
            "colors": self.sh,
            "sh_degree": self.sh_degree,
        }

    @staticmethod
    def from_gsplat(
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        colors: Tensor,
        sh_degree: int,
        labels: Tensor | None = None,
    ) -> Surfels:
        """Inverse of :meth:`as_gsplat`: discs from the arguments of ``gsplat.rasterization_2dgs``.

        Args:
            means: (N, 3); quats: (N, 4) wxyz of any length; scales: (N, 3) or (N, 2) metres, of which the third is left out.
            opacities: (N,) from 0 to 1; colors: (N, K, 3) spherical harmonics, of which the first ``(sh_degree + 1)^2`` count.
            labels: (N,) int64 compact labels; None = 0 for all.
        Raises:
            SettingsError: other shapes.
        """
        count, width = len(means), (sh_degree + 1) ** 2
        shapes = {"means": means, "quats": quats, "scales": scales, "opacities": opacities, "colors": colors[:, :width]}
        expected = {"means": (3,), "quats": (4,), "scales": (scales.shape[-1],), "opacities": (), "colors": (width, 3)}
        wrong = [n for n, values in shapes.items() if tuple(values.shape) != (count, *expected[n])]
        if wrong or scales.shape[-1] not in (2, 3):
            name = (wrong or ["scales"])[0]
            raise SettingsError(
                f"Not the shape of {count} 2D Gaussians: {name} {tuple(shapes[name].shape)}",
                mend="give means (N, 3), quats (N, 4), scales (N, 3), opacities (N,), colors (N, K, 3)",
            )
        return Surfels(
            means,
            quats,
            scales[:, :2].log(),
            opacities.clamp(max=OPAQUE).logit(),
            colors[:, :width],
            torch.zeros(count, dtype=torch.int64, device=means.device) if labels is None else labels,
        )

    def detach(self) -> Surfels:
        """The same values outside the autograd graph."""
        return replace(self, **{f.name: getattr(self, f.name).detach() for f in fields(self)})


def as_ellipsoids(discs: Surfels, thickness: float) -> Surfels:
    """3D Gaussians in the place of discs: the third scale is ``thickness`` of the smaller of the other two."""
    third = discs.log_scales.amin(dim=1, keepdim=True) + math.log(thickness)
    return replace(discs, log_scales=torch.cat([discs.log_scales, third], dim=1))


def three_log_scales(surfels: Surfels, scale: float = 1.0) -> Tensor:
    """(N, 3) natural logarithms of the standard deviations; a disc's third is thin, see :data:`THIN_LOG_SCALE`.

    Args:
        scale: units of the file per metre.
    """
    if surfels.ellipsoids:
        return surfels.log_scales
    thin = surfels.log_scales.new_full((len(surfels), 1), THIN_LOG_SCALE + math.log(scale))
    return torch.cat([surfels.log_scales, thin], dim=1)


def with_sh_degree(surfels: Surfels, degree: int) -> Surfels:
    """The same surfels with colours up to a degree: new coefficients are zero, higher ones are dropped."""
    width = (degree + 1) ** 2
    added = surfels.sh.new_zeros(len(surfels), max(0, width - surfels.sh.shape[1]), 3)
    return replace(surfels, sh=torch.cat([surfels.sh[:, :width], added], dim=1))


def concatenate(parts: list[Surfels]) -> Surfels:
    """Join surfels; higher SH degrees are kept and lower ones padded with zeros. Discs become flat ellipsoids beside
    ellipsoids."""
    degree = max(p.sh_degree for p in parts)
    padded = [with_sh_degree(p, degree) for p in parts]
    if any(p.ellipsoids for p in parts):
        padded = [p if p.ellipsoids else as_ellipsoids(p, FLATNESS) for p in padded]
    return Surfels(*(torch.cat([getattr(p, f.name) for p in padded]) for f in fields(Surfels)))

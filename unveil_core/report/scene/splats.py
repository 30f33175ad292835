"""The splats of the page: the empty scene without what a viewer does not need, and never more than a page can carry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float32, Float64
from unveil_core.inpaint.origin import SEEN_ELSEWHERE
from unveil_core.raster.near_camera import REACH_M
from unveil_core.raster.spherical_harmonics import evaluate
from unveil_core.surfels.surfels import Surfels

__all__ = ["Splats", "slices", "splats_of"]

LEAST_OPACITY = 0.02
"""Fainter surfels are left out: five levels of 255 at their middle, in front of nothing. A trained scene has few."""
SLICE = 1 << 18
"""Surfels that are worked on at a time, so that the memory of a long drive's scene is not asked for a second time."""


@dataclass(frozen=True, eq=False)
class Splats:
    """N flat splats with one colour each.

    Attributes:
        means: (N, 3) float32 centres, local metres.
        quats: (N, 4) float32 unit quaternions wxyz; columns 0 and 1 of the rotation are the axes of the ellipse.
        log_scales: (N, 2) float32 natural logarithms of its standard deviations, metres.
        opacities: (N,) float32, 0 to 1.
        colors: (N, 3) float32 sRGB, 0 to 1, as the nearest camera of the drive sees them.
        origins: (N,) uint8, see ``inpaint.origin``.
    """

    means: Float32
    quats: Float32
    log_scales: Float32
    opacities: Float32
    colors: Float32
    origins: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.means)

    def select(self, index: NDArray[np.generic]) -> Splats:
        """Those at a mask (N,) or at indices (M,)."""
        return Splats(*(getattr(self, f.name)[index] for f in fields(self)))


def slices(count: int) -> Iterator[slice]:
    """Parts of ``count`` rows, at most :data:`SLICE` each."""
    return (slice(start, min(start + SLICE, count)) for start in range(0, count, SLICE))


def splats_of(surfels: Surfels, origins: NDArray[np.uint8] | None, eyes: Float64) -> Splats:
    """The surfels that can be seen from near the drive's cameras, as splats.

    Args:
        surfels: M; of ellipsoids the first two axes are taken.
        origins: (M,) where they come from, None where that is not known.
        eyes: (C, 3) places of the cameras, at least one.
    """
    tree = cKDTree(eyes)
    parts = []
    for part in slices(len(surfels)):
        some = Surfels(*(getattr(surfels, f.name)[part] for f in fields(Surfels))).detach()
        far, nearest = tree.query(some.means.numpy(), distance_upper_bound=REACH_M)
        opacities = torch.sigmoid(some.opacity_logits).numpy()
        keep = np.flatnonzero(np.isfinite(far) & (opacities > LEAST_OPACITY))
        some = some.select(torch.from_numpy(keep))
        towards = some.means.double() - torch.from_numpy(eyes[nearest[keep]])
        directions = torch.nn.functional.normalize(towards, dim=1).float()
        quats = torch.nn.functional.normalize(some.quats, dim=1).numpy()
        quats[~quats.any(axis=1)] = (1, 0, 0, 0)
        of_these = np.full(len(keep), SEEN_ELSEWHERE, np.uint8) if origins is None else origins[part][keep]
        colors = evaluate(some.sh, directions).clamp_max(1).numpy()
        parts.append(
            Splats(some.means.numpy(), quats, some.log_scales[:, :2].numpy(), opacities[keep], colors, of_these)
        )
    if not parts:
        empty = np.zeros((0, 4), np.float32)
        return Splats(empty[:, :3], empty, empty[:, :2], empty[:, 0], empty[:, :3], np.zeros(0, np.uint8))
    return Splats(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Splats)))

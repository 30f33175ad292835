"""What lies behind the removed objects of a drive: what stands there and is left, the ground as it goes on, or the sky."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.ground.fit import DriveGround
from unveil_core.remove.observed import depth_behind
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import scene_depth

__all__ = ["EmptyStreet", "empty_street"]


@dataclass(frozen=True, eq=False)
class EmptyStreet:
    """The surfaces that are left when the removed have gone.

    Attributes:
        left: surfels that stay; standing: of them those that do not lie on the ground.
        ground: of the drive.
    """

    left: Surfels
    standing: Surfels
    ground: DriveGround

    def depth(self, camera: Camera, pixels: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(H, W) depth of what lies behind the ``pixels`` (H, W), see :func:`depth_behind`; inf elsewhere, and for the sky."""
        if not pixels.any():
            return np.full(pixels.shape, np.inf)
        street = np.full(pixels.shape, np.inf)
        if self.ground.street is not None:
            street[pixels] = self.ground.street.intersect(camera, camera.rays()[pixels])[0]
        left, terrain = scene_depth(self.left, camera), self.ground.terrain
        if terrain is None:
            behind = depth_behind(left, street)
        else:
            ends = terrain.depth(camera, pixels, near=NEAR_M, far=FAR_M)
            behind = depth_behind(left, street, scene_depth(self.standing, camera), ends)
        return np.where(pixels, behind, np.inf)


def empty_street(left: Surfels, ground: DriveGround, on_ground: Sequence[int]) -> EmptyStreet:
    """What is left of a drive.

    Args:
        left: surfels that stay.
        ground: of the drive.
        on_ground: labels of the ground; empty where the scene has no classes.
    """
    standing = ~np.isin(left.labels.numpy(), on_ground)
    return EmptyStreet(left, left.select(torch.from_numpy(standing)), ground)

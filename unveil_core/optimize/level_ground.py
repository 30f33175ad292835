"""A level start for a street that only images place: its surfels begin on the ground that most of them agree on.

On bare asphalt the sweep of planes finds depths that differ by decimetres from pixel to pixel, and no loss on images draws them
together again. Lines, kerbs and stones are right, and so are the points of structure from motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from unveil_core.base.types import Float64
from unveil_core.drives.drive import PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import quats_from_normals
from unveil_core.ground.fit import fit_street, street_noise
from unveil_core.ground.one_place import LEAST_OWN, goes_round, share_of_own
from unveil_core.ground.path import fit_path
from unveil_core.ground.plain_fit import NOISY_M, WIDTH_M
from unveil_core.ground.street import Ground
from unveil_core.semantics.classes import GROUND_CLASSES, LabelSet
from unveil_core.surfels.surfels import Surfels

__all__ = ["on_level_ground"]

BELOW_M, ABOVE_M = 1.0, 0.3
"""How far below the ground or above it a surfel may be that bears a label of the ground to be put on it, metres: they sink, behind
what few frames show; what is higher lies on a bank or a step."""


def on_level_ground(
    surfels: Surfels, labels: LabelSet, cameras: Sequence[Camera], points: PointCloud | None = None
) -> Surfels:
    """The surfels of a start, those of a noisy ground on its plain surface; as they are where it is not noisy, there is
    no street, or nothing tells the ground.

    Args:
        cameras: of one camera of the rig, in the order of the drive; points: of the drive.
    """
    wanted = labels.indices(GROUND_CLASSES)
    path = fit_path(cameras)
    if not wanted or goes_round(path) or share_of_own(path) < LEAST_OWN:
        return surfels
    if street_noise(surfels, labels, cameras, path, points) <= NOISY_M:
        return surfels
    ground = fit_street(surfels, labels, cameras, path, points)
    if ground is None:
        return surfels
    means = surfels.means.double().numpy()
    street = path.to_street(means)
    over = ground.over(street)
    chosen = np.isin(surfels.labels.numpy(), wanted) & (over > -BELOW_M) & (over < ABOVE_M)
    chosen &= (np.abs(street[:, 1]) < WIDTH_M) & ground.inside(street[:, 0], street[:, 1])
    street[:, 2] -= over
    index = torch.from_numpy(np.flatnonzero(chosen))
    new_means, new_quats = surfels.means.clone(), surfels.quats.clone()
    new_means[index] = torch.from_numpy(path.to_world(street[chosen])).to(new_means.dtype)
    new_quats[index] = torch.from_numpy(quats_from_normals(_normals(ground, street[chosen]))).to(new_quats.dtype)
    return replace(surfels, means=new_means, quats=new_quats)


def _normals(ground: Ground, street: Float64) -> Float64:
    """(N, 3) unit normals of the ground at street coordinates (N, 3), upwards."""

    def at(ds: float, dt: float) -> Float64:
        s, t = street[:, 0] + ds, street[:, 1] + dt
        return ground.path.to_world(np.column_stack([s, t, ground.height_at(s, t)]))

    reach = 0.5  # metres: less than the ground's bends
    normal = np.cross(at(reach, 0) - at(-reach, 0), at(0, reach) - at(0, -reach))
    unit: Float64 = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return unit

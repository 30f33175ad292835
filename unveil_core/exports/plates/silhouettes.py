"""Which pixels of a frame show an object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from unveil_core.base.types import Float32, Labels
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Frame
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.objects import object_name
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.raster.spec import MAX_LABELS
from unveil_core.semantics.labels import frame_instances
from unveil_core.surfels.surfels import Surfels

__all__ = ["Silhouettes"]

MOSTLY = 0.5
"""Share of a pixel's light that an object stops where the pixel shows it."""


@dataclass(frozen=True)
class Silhouettes:
    """Of objects: by the drive's instance images where a frame has one, else by the scene's surfels.

    Attributes:
        job: whose objects these are.
        objects: entries of instances.json.
    """

    job: Job
    objects: list[dict[str, Any]]

    def of(self, frame: Frame) -> dict[str, Float32]:
        """(H, W) 0 to 1 by name of an object, at working size."""
        ids = frame_instances(frame)
        names = [object_name(entry) for entry in self.objects]
        if ids is not None:
            return {name: (ids == e["id"]).astype(np.float32) for name, e in zip(names, self.objects, strict=True)}
        found: dict[str, Float32] = {}
        instances = self.job.full_instances
        full = self.job.full
        # Label 0 is all else.
        for first in range(0, len(names), MAX_LABELS - 1):
            some = self.objects[first : first + MAX_LABELS - 1]
            weights = _weights(full, instances, [e["id"] for e in some], frame)
            found |= {names[first + k]: weights[..., k + 1] for k in range(len(some))}
        return found

    def numbers(self, frame: Frame) -> Labels:
        """(H, W) id of the object that a pixel shows, 0 none, at working size."""
        wanted = np.array([entry["id"] for entry in self.objects], dtype=np.int64)
        ids = frame_instances(frame)
        if ids is not None:
            return np.where(np.isin(ids, wanted), ids, 0)
        found = np.zeros((frame.camera.height, frame.camera.width), dtype=np.int64)
        for number, share in zip(wanted, self.of(frame).values(), strict=True):
            found[share > MOSTLY] = number
        return found


def _weights(full: Surfels, instances: Labels, ids: list[int], frame: Frame) -> Float32:
    """(H, W, 1 + len(ids)) the share of light that each object stops; first all else."""
    labels = np.zeros(len(full), dtype=np.int64)
    for k, number in enumerate(ids):
        labels[instances == number] = k + 1
    marked = Surfels(full.means, full.quats, full.log_scales, full.opacity_logits, full.sh, torch.from_numpy(labels))
    near = near_camera(marked, frame.camera)
    return array(
        rendered(near, frame.camera, ("semantics",), label_count=len(ids) + 1, near=NEAR_M, far=FAR_M).semantics
    )

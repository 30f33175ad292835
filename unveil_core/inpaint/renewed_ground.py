"""The ground of a street as surfels: new ones where it was filled, and which of the scene's these replace or were relit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.inpaint.by_stretch import FilledStreet
from unveil_core.inpaint.frames.new_ground import displaced_by, ground_relit, new_ground, seed_ground
from unveil_core.inpaint.stretches import Stretch
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.surfels.surfels import Surfels

__all__ = ["RenewedGround", "renew_ground"]


@dataclass(frozen=True, eq=False)
class RenewedGround:
    """Attributes:
    displaced: (N,) surfels of the full scene that new ones take the place of; relit: (N,) those that lost a shadow.
    added: the new ones of each stretch.
    """

    displaced: Mask
    relit: Mask
    added: list[Surfels]


def renew_ground(filled: FilledStreet, *, spacing_m: float) -> RenewedGround:
    """New surfels for the filled ground, ``spacing_m`` metres apart across the street, see ``seed_ground``."""
    street = filled.street
    surfels, gone, labels = street.removal.surfels, street.removal.gone, street.scene.labels
    label, level = labels.index("road") or 0, 0.0 if street.light is None else street.light.level
    displaced, relit = np.zeros((2, len(surfels)), dtype=bool)
    added = []
    for count, stretch in enumerate(street.stretches, start=1):

        def make(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
            chart, near = filled.own(stretch), street.near(stretch)
            local = surfels.select(torch.from_numpy(near))
            places = local.means.double().numpy()[gone[near]]
            masks = street.of_frames(stretch, street.views.removed)
            cameras = street.cameras_of(stretch)
            anew = new_ground(chart, places, cameras, masks)
            seeds = seed_ground(
                chart,
                anew,
                cameras,
                spacing=spacing_m,
                sh_degree=surfels.sh_degree,
                default_label=label,
                level=level,
            )
            old = displaced_by(chart, anew, local, labels.indices(GROUND_CLASSES))
            return {**seeds.arrays(), "displaced": near[old], "relit": near[ground_relit(chart, local)]}

        made = street.kept.within(stretch.name).once("renewed", make)
        displaced[made["displaced"]] = True
        relit[made["relit"]] = True
        added.append(Surfels.from_arrays(made))
        street.progress(count, len(street.stretches), "renewing the ground")
    return RenewedGround(displaced & ~gone, relit, added)

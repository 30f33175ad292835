"""What casts shadows on the ground, and where they fall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.mechanisms import on
from unveil_core.geometry.images import disc
from unveil_core.inpaint.chart.street_chart import StreetChart
from unveil_core.inpaint.light.shadow_map import Discs, in_shadow
from unveil_core.surfels.surfels import Surfels

__all__ = ["NO_KINDS", "Casters", "Kinds", "cast_on_chart", "lit_at_sunny_walls"]

CHINK_M = 0.25
"""Radius of lit gaps that are filled in cast shadows, metres: surfels leave holes that a wall has not."""
AT_FOOT_M = 1.2
"""Width of the ground at the foot of a wall that the wall cannot shade itself, metres: there its cast shadow is the roughness of
its surfels. Of 0.6, 1.2 and 1.8 the best on ten streets."""
COMPANY, COMPANY_M = 6, 0.75
"""How many others a surfel must have within so many metres to cast a shadow, unless it is solid: one that floats alone over the
street is a remainder of something, and as large as a car's hood."""
STANDS_M = 0.25
"""Height over the ground above which surfels cast shadows, metres: kerbs and the ground's own noise are lower."""


@dataclass(frozen=True)
class Kinds:
    """Labels by the shadows that they cast.

    Attributes:
        ground: casts none.
        solid: solid down to the ground, as houses and walls, though their feet may be hidden.
    """

    ground: tuple[int, ...] = ()
    solid: tuple[int, ...] = ()


NO_KINDS = Kinds()


@dataclass(frozen=True, eq=False)
class Casters:
    """What casts shadows: of what stays, and of what is removed."""

    kept: Surfels
    gone: Surfels

    @staticmethod
    def of(chart: StreetChart, kept: Surfels, gone: Surfels, kinds: Kinds) -> Casters:
        return Casters(*(_in_company(_standing(chart, surfels, kinds.ground), kinds.solid) for surfels in (kept, gone)))


def _standing(chart: StreetChart, surfels: Surfels, ground: Sequence[int]) -> Surfels:
    """What stands on the ground, and is not labelled as such."""
    street = chart.ground.path.to_street(surfels.means.detach().double().numpy())
    high = chart.ground.over(street) > STANDS_M
    return surfels.select(torch.from_numpy(high & ~np.isin(surfels.labels.numpy(), ground)))


def _in_company(surfels: Surfels, solid: Sequence[int]) -> Surfels:
    """Without surfels that float alone, unless they are solid: of walls that few frames show there are few."""
    places = surfels.means.detach().double().numpy()
    alone = np.full(len(places), on("caster_company"))
    if len(places) > COMPANY and on("caster_company"):
        alone = cKDTree(places).query(places, k=COMPANY + 1)[0][:, -1] > COMPANY_M
    return surfels.select(torch.from_numpy(~alone | np.isin(surfels.labels.numpy(), solid)))


def cast_on_chart(chart: StreetChart, casters: Surfels, towards: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(A, B) ground in the shadow of the casters, towards the sun (3,)."""
    shape = chart.source.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, shape[1]), np.tile(t, shape[0])).reshape(shape)
    rows, columns = np.nonzero(inside)
    plane = np.zeros(shape, dtype=bool)
    plane[rows, columns] = in_shadow(chart.world(rows, columns), Discs.of(casters), towards)
    # No light comes through chinks, nor between a wall and the ground at its foot.
    chinks = disc(CHINK_M / chart.texel)
    plane = cv2.morphologyEx((plane | ~inside).astype(np.uint8), cv2.MORPH_CLOSE, chinks).astype(bool) & inside
    return (
        lit_at_sunny_walls(chart, plane, inside, towards, round(AT_FOOT_M / chart.texel))
        if on("lit_wall_feet")
        else plane
    )


def lit_at_sunny_walls(
    chart: StreetChart, plane: NDArray[np.bool_], inside: NDArray[np.bool_], towards: NDArray[np.float64], width: int
) -> NDArray[np.bool_]:
    """The shadows (A, B) without those that lie only along the ground's border on the side away from the sun: a wall there, which
    is as rough as its surfels, cannot shade its own foot.

    Args:
        inside: (A, B) the ground; towards: (3,) the sun; width: of the border, texels.
    """
    path = chart.ground.path
    rows, columns = plane.shape
    s = chart.coordinates()[0]
    heading = path.heading_at(s)
    local = path.axes @ towards
    from_left = -local[0] * np.sin(heading) + local[1] * np.cos(heading) > 0
    first, last = inside.argmax(axis=1), columns - 1 - inside[:, ::-1].argmax(axis=1)
    # Lateral offsets grow to the left.
    edge = np.clip(np.where(from_left, first + width, last - width), 0, columns - 1)
    column = np.arange(columns)[None]
    border = np.where(from_left[:, None], column < edge[:, None], column > edge[:, None])
    return plane & (~border | plane[np.arange(rows), edge][:, None])

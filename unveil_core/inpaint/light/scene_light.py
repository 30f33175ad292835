"""The sun and the shadows that the scene casts on the chart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.inpaint.light.casters import NO_KINDS, Casters, Kinds, cast_on_chart
from unveil_core.inpaint.light.houses import flush_with_facades, solid_columns
from unveil_core.inpaint.light.shade import CONTACT_M, Light
from unveil_core.inpaint.light.shadow_map import Discs, in_shadow
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.light.sun_by_shadows import Evidence, sun_by_shadows
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Evidence", "light_of_scene", "sun_of_scene"]


def sun_of_scene(evidence: Evidence, kept: Surfels, gone: Surfels, kinds: Kinds = NO_KINDS) -> Sun | None:
    """The sun by its shadows; None where none explains the dark places.

    Args:
        evidence: the ground as read; kept, gone: surfels of what stays and of what is removed.
        kinds: labels by the shadows that they cast.
    """
    return sun_by_shadows(evidence, Casters.of(evidence.chart, kept, gone, kinds))


def light_of_scene(evidence: Evidence, kept: Surfels, gone: Surfels, kinds: Kinds, sun: Sun) -> Light:
    """The shadows of what stays and of what is removed, see :func:`sun_of_scene`."""
    casters = Casters.of(evidence.chart, kept, gone, kinds)
    # Between two cars there is little else than what lies beside them.
    observed = evidence.mask(CONTACT_M / 4)
    ground = evidence.light_seen(observed, evidence.dark(observed))
    solid_ones = casters.kept
    if on("houses"):
        solid_ones = _with_solid_houses(evidence, casters.kept, casters.gone, kinds.solid, sun, ground)
    of_kept, of_gone = (cast_on_chart(evidence.chart, surfels, sun.towards) for surfels in (solid_ones, casters.gone))
    return Light(sun, of_kept, of_gone)


def _with_solid_houses(
    evidence: Evidence,
    kept: Surfels,
    gone: Surfels,
    solid: Sequence[int],
    sun: Sun,
    ground: tuple[NDArray[np.float64], NDArray[np.bool_]],
) -> Surfels:
    """What stays, with houses as solid columns, those beyond the drive's ends chosen by the shadows that were observed.

    Args:
        ground: world points (P, 3) and whether it is dark there (P,), see :meth:`Evidence.light_seen`.
    """
    places, is_dark = ground
    kept = kept.select(torch.from_numpy(flush_with_facades(evidence.chart, kept, solid)))
    shaded = in_shadow(places, Discs.of(concatenate([kept, gone])), sun.towards)

    def judge(added: Surfels) -> float | None:
        more = in_shadow(places, Discs.of(added), sun.towards) & ~shaded
        # Of what only the added would darken, is more dark or light? Nothing added scores 0.
        return float(np.where(is_dark[more], 1.0, -1.0).sum()) if len(places) else None

    return concatenate([kept, solid_columns(evidence.chart, kept, solid, evidence.cameras, judge)])

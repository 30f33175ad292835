"""The sun and the shadows that the scene casts on the chart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.street_chart import StreetChart
from unveil_core.inpaint.light.casters import NO_KINDS, Casters, Kinds, cast_on_chart, in_shadow_of
from unveil_core.inpaint.light.houses import flush_with_facades, solid_columns
from unveil_core.inpaint.light.shade import CONTACT_M, Light
from unveil_core.inpaint.light.shadow_map import Discs
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.light.sun_by_shadows import Evidence, sun_by_shadows
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["light_of_scene", "sun_of_scene"]


def light_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    footprint: NDArray[np.bool_] | None = None,
    cameras: Sequence[Camera] = (),
    kinds: Kinds = NO_KINDS,
    sun: Sun | None = None,
) -> Light | None:
    """Find the sun by its shadows, and cast those of what stays and of what is removed.

    Args:
        chart: as read.
        kept, gone: surfels of what stays and of what is removed.
        footprint: (A, B) texels that removed objects stand on; None = unknown.
        cameras: of the drive.
        kinds: labels by the shadows that they cast.
        sun: instead of looking for it.
    Returns:
        None where no sun explains the dark places.
    """
    casters = Casters.of(chart, kept, gone, kinds)
    evidence = Evidence(chart, footprint, cameras)
    sun = sun or sun_by_shadows(evidence, casters)
    if sun is None:
        return None
    # Between two cars there is little else than what lies beside them.
    observed = evidence.mask(CONTACT_M / 4)
    ground = evidence.light_seen(observed, evidence.dark(observed))
    solid_ones = casters.kept
    if on("houses"):
        solid_ones = _with_solid_houses(evidence, casters.kept, casters.gone, kinds.solid, sun, ground)
    of_kept, of_gone = (cast_on_chart(chart, surfels, sun.towards) for surfels in (solid_ones, casters.gone))
    return Light(sun, of_kept, of_gone)


def sun_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    footprint: NDArray[np.bool_] | None = None,
    cameras: Sequence[Camera] = (),
    kinds: Kinds = NO_KINDS,
) -> Sun | None:
    """The sun by its shadows alone, see :func:`light_of_scene`."""
    return sun_by_shadows(Evidence(chart, footprint, cameras), Casters.of(chart, kept, gone, kinds))


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
    shaded = in_shadow_of(places, Discs.of(concatenate([kept, gone])), sun.towards)

    def judge(added: Surfels) -> float | None:
        more = in_shadow_of(places, Discs.of(added), sun.towards) & ~shaded
        # Of what only the added would darken, is more dark or light? Nothing added scores 0.
        return float(np.where(is_dark[more], 1.0, -1.0).sum()) if len(places) else None

    return concatenate([kept, solid_columns(evidence.chart, kept, solid, evidence.cameras, judge)])

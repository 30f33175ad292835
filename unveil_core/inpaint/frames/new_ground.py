"""New surfels for the ground that nobody saw, and which of the scene's surfels they replace."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc
from unveil_core.inpaint.chart.street_chart import INVENTED, RELIT_GAIN, StreetChart
from unveil_core.inpaint.chart.surface import surfels_on
from unveil_core.inpaint.frames.long_surfels import longest_in_view, together
from unveil_core.inpaint.light.view_light import lit
from unveil_core.surfels.surfels import Surfels

__all__ = ["displaced_by", "ground_relit", "new_ground", "seed_ground", "texels_in_pixels"]

AROUND_M = 0.75
"""Reach around the removed surfels within which invented ground gets new ones, metres: their outline is uncertain by about half
of that. Chosen on the two sample streets."""
LOW_M = 0.15
"""Height over or under the ground within which a surfel counts as ground, metres: a kerb."""


def new_ground(
    chart: StreetChart, removed: NDArray[np.float64], cameras: Sequence[Camera], masks: Sequence[Mask]
) -> Mask:
    """(A, B) invented texels that need surfels: under and around what was removed, and wherever a view looks through it.

    Args:
        removed: (M, 3) world places of removed surfels.
        masks: (H, W) removed pixels, one a camera.
    """
    row, column, inside = chart.index_of(chart.ground.path.to_street(removed))
    near = np.zeros(chart.source.shape, dtype=np.uint8)
    near[row[inside], column[inside]] = 1
    near = cv2.dilate(near, disc(max(1, int(2 * AROUND_M / chart.texel) // 2)))
    # An object that is seen from one side only hides ground far behind it; without surfels the sky would show there.
    in_view = texels_in_pixels(chart, cameras, masks) if on("ground_in_view") else False
    return (chart.source == INVENTED) & ((near > 0) | in_view)


def displaced_by(chart: StreetChart, region: Mask, surfels: Surfels, ground_labels: Sequence[int]) -> Mask:
    """(N,) surfels of the ground, at whatever height, over the texels that get new ones.

    No view saw the ground there: what the reconstruction put there is the dark of an object's underside, and loose ends that
    the object hid. From the recorded cameras the new surfels cover them, from others they would show.

    Args:
        region: (A, B), of :func:`new_ground`; ground_labels: compact labels.
    """
    row, column, inside = chart.index_of(chart.ground.path.to_street(surfels.means.double().numpy()))
    return inside & region[row, column] & np.isin(surfels.labels.numpy(), list(ground_labels))


def ground_relit(chart: StreetChart, surfels: Surfels) -> Mask:
    """(N,) surfels that lie on ground from which a shadow was taken."""
    street = chart.ground.path.to_street(surfels.means.double().numpy())
    row, column, inside = chart.index_of(street)
    low = np.abs(chart.ground.over(street)) < LOW_M
    return inside & low & (chart.gain[row, column].max(axis=1) > RELIT_GAIN)


def seed_ground(
    chart: StreetChart,
    region: Mask,
    cameras: Sequence[Camera],
    *,
    spacing: float,
    sh_degree: int,
    default_label: int,
    level: float = 0.0,
) -> Surfels:
    """Surfels for invented ground, longer along the street where all views see it from afar.

    Args:
        region: (A, B) texels to consider; of them those that are invented get surfels.
        cameras: of all views.
        spacing: distance between surfels, metres, along the street up to ``LONGEST`` times that.
        level: logarithm by which the ground is brighter when it is seen from near, see ``light.view_light``.
    """
    step = max(1, round(spacing / chart.texel))
    middles = np.s_[step // 2 :: step, step // 2 :: step]
    cells = (region & (chart.source == INVENTED))[middles]
    row, column, count = together(cells, longest_in_view(chart, cells.shape, step, cameras))
    rows, columns = row * step + (count * step) // 2, column * step + step // 2
    smooth = cv2.GaussianBlur(chart.color, (0, 0), max(0.3, 0.4 * step))[middles]
    below = np.cumsum(np.pad(smooth, ((1, 0), (0, 0), (0, 0))), axis=0, dtype=np.float64)
    colors = ((below[row + count, column] - below[row, column]) / count[:, None]).astype(np.float32)
    colors = colors if level == 0 else lit(np.maximum(colors, 0), np.full(3, level, np.float32))
    label = chart.label[middles][row + count // 2, column].astype(np.int64)
    label = np.where(label >= 0, label, default_label)
    size = step * chart.texel * np.stack([count, np.ones_like(count)], axis=1)
    return surfels_on(chart, rows, columns, colors, label, spacing=size, sh_degree=sh_degree)


def texels_in_pixels(chart: StreetChart, cameras: Sequence[Camera], masks: Sequence[Mask]) -> Mask:
    """(A, B) invented texels that fall into the pixels of some view's mask.

    Args:
        masks: (H, W) one a camera.
    """
    rows, columns = np.nonzero(chart.source == INVENTED)
    fall = np.zeros(len(rows), dtype=bool)
    places = chart.world(rows, columns)
    for camera, mask in zip(cameras, masks, strict=True):
        if len(rows) and mask.any():
            fall |= camera.fall_in(places, mask)[1]
    found = np.zeros(chart.source.shape, dtype=bool)
    found[rows[fall], columns[fall]] = True
    return found

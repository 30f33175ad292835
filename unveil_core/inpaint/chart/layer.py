"""The ground of the empty street, sampled per pixel from the filled chart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT
from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.fields.picture_field import PictureField
from unveil_core.geometry.images import border_px
from unveil_core.inpaint.chart.sampling import blur_levels, sample_levels
from unveil_core.inpaint.chart.street_chart import OUTSIDE, RELIT_GAIN, StreetChart
from unveil_core.inpaint.light.view_light import lit

__all__ = ["GroundLayer", "GroundPixels"]

LEAST_SINE = 0.01
"""Sine of the angle between ray and ground that a footprint is computed with at least: flatter, it would be without end."""
SMALL_TEXEL_PX = 4
"""Texels no larger than this in a picture are drawn as points: with what lies between points closed, all that they cover."""


@dataclass(frozen=True, eq=False)
class GroundPixels:
    """What a view would see of the ground if nothing stood on it; planes (H, W…), nothing outside ``hit``.

    Attributes:
        hit: (H, W) bool, the ray meets the ground.
        depth: (H, W) along the optical axis, inf where not hit.
        color: (H, W, 3) float32; gain: (H, W, 3) float32, see StreetChart.
        covered: (H, W) bool, the chart has a colour there.
        shadow: (H, W) bool, ground in the shadow of something removed; replaced: (H, W) bool, ground whose seen colour
            was given up, see StreetChart; unseen: (H, W) bool, ground that no frame shows.
        extent: (H, W) length of a pixel's footprint along its ray on the ground, texels of the chart.
        source: (H, W) uint8, where the chart has its colour from, see StreetChart; OUTSIDE where not covered.
    """

    hit: NDArray[np.bool_]
    depth: NDArray[np.float64]
    color: Float32
    gain: Float32
    covered: NDArray[np.bool_]
    shadow: NDArray[np.bool_]
    replaced: NDArray[np.bool_]
    unseen: NDArray[np.bool_]
    extent: Float32
    source: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class GroundLayer:
    """A filled chart as frames sample it.

    Attributes:
        chart: filled.
        ground_labels: compact labels of the ground; none where the scene has no classes.
    """

    chart: StreetChart
    ground_labels: tuple[int, ...] = ()

    @cached_property
    def _colors(self) -> list[Float32]:
        return blur_levels(self.chart.color)

    @cached_property
    def _gains(self) -> list[Float32]:
        return blur_levels(self.chart.gain)

    @cached_property
    def _relit(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Float64]:
        """Rows and columns of relit texels, and their world positions."""
        rows, columns = np.nonzero((self.chart.gain.max(axis=2) > RELIT_GAIN) | self.chart.replaced)
        return rows, columns, self.chart.world(rows, columns)

    def shadow_pixels(self, camera: Camera) -> NDArray[np.bool_]:
        """(H, W) pixels that may show relit ground, found by projecting its texels."""
        mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
        rows, columns, places = self._relit
        if len(rows):
            _, pixel, _ = camera.shown(places, nearest=0.3)
            mask[pixel[:, 1].astype(int), pixel[:, 0].astype(int)] = 1
            depth = places @ camera.forward - camera.centre @ camera.forward
            large = (depth > 0) & (depth * SMALL_TEXEL_PX < max(camera.fx, camera.fy) * self.chart.texel)
            self._draw_texels(camera, rows[large], columns[large], mask)
            # Texels that are drawn as points lie some pixels apart.
            mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
            side = 2 * border_px(camera.width, 1) + 1
            mask = cv2.dilate(mask, np.ones((side, side), np.uint8))
        return mask.astype(bool)

    def _draw_texels(
        self, camera: Camera, rows: NDArray[np.int64], columns: NDArray[np.int64], mask: NDArray[np.uint8]
    ) -> None:
        """Mark the pixels (H, W) to which texels reach: half of the next one too, for colours are read between centres."""
        low, high = np.full((len(rows), 2), np.inf), np.full((len(rows), 2), -np.inf)
        before = np.ones(len(rows), dtype=bool)
        for down, right in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            pixel, depth = camera.project(self.chart.world(rows + down, columns + right))
            before &= depth > self.chart.texel
            low, high = np.minimum(low, pixel), np.maximum(high, pixel)
        size = np.array([camera.width, camera.height])
        seen = before & (high > 0).all(axis=1) & (low < size).all(axis=1)
        _fill_boxes(
            np.floor(np.clip(low[seen], 0, size - 1)).astype(np.int64),
            np.floor(np.clip(high[seen], 0, size - 1)).astype(np.int64),
            mask,
        )

    def sample(self, camera: Camera, wanted: NDArray[np.bool_], light: PictureField | None = None) -> GroundPixels:
        """The ground that ``camera`` would see in the ``wanted`` (H, W) pixels if nothing stood on it.

        Args:
            light: of its pictures, see :mod:`unveil_core.inpaint.light.view_light`; None = as the chart has it.
        """
        shape = wanted.shape
        rays = camera.rays()[wanted]
        depth, street = self.chart.ground.intersect(camera, rays)
        hit = np.isfinite(depth)
        color = np.zeros((len(rays), 3), dtype=np.float32)
        gain = np.ones((len(rays), 3), dtype=np.float32)
        covered = np.zeros(len(rays), dtype=bool)
        replaced, unseen = np.zeros((2, len(rays)), dtype=bool)
        extent = np.zeros(len(rays), dtype=np.float32)
        source = np.full(len(rays), OUTSIDE, dtype=np.uint8)
        if hit.any():
            z = depth[hit]
            # A pixel's extent on the ground: z/f across the view, and stretched by the grazing angle along it.
            ground, at = self.chart.ground, street[hit]
            direction = ground.path.along_street(at[:, 0], rays[hit] / np.linalg.norm(rays[hit], axis=1, keepdims=True))
            ahead, aside = ground.slope_at(at[:, 0], at[:, 1])
            steep = np.abs(direction[:, 2] - ahead * direction[:, 0] - aside * direction[:, 1])
            grazing = np.maximum(steep / np.sqrt(1 + ahead**2 + aside**2), LEAST_SINE)
            across = z / camera.fx
            extent[hit] = reach = across / grazing / self.chart.texel
            level = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-6)
            footprint = direction[:, :2] * (reach / level)[:, None]
            place = (at[:, :2] - (self.chart.s_start, self.chart.t_start)) / self.chart.texel
            width = across / self.chart.texel
            color[hit] = sample_levels(self._colors, place, footprint, width)
            if light is not None:
                color[hit] = lit(np.maximum(color[hit], 0), light.plane()[wanted][hit])
            gain[hit] = sample_levels(self._gains, place, footprint, width)
            row, column, on_chart = self.chart.index_of(street[hit])
            source[hit] = np.where(on_chart, self.chart.source[row, column], OUTSIDE)
            covered = source != OUTSIDE
            replaced[hit] = on_chart & self.chart.replaced[row, column]
            unseen[hit] = on_chart & np.isinf(self.chart.nearest[row, column])

        def spread(values: Any, default: float | bool) -> Any:
            plane = np.full((*shape, *values.shape[1:]), default, dtype=values.dtype)
            plane[wanted] = values
            return plane

        gain = np.maximum(gain, 1.0)
        return GroundPixels(
            hit=spread(hit, False),
            depth=spread(np.where(hit, depth, np.inf), np.inf),
            color=spread(np.maximum(color, 0), 0.0),
            gain=spread(gain, 1.0),
            covered=spread(covered, False),
            shadow=spread((gain.max(axis=1) > RELIT_GAIN) | replaced, False),
            replaced=spread(replaced, False),
            unseen=spread(unseen, False),
            extent=spread(extent, 0.0),
            source=spread(source, OUTSIDE),
        )


@njit(**EXACT)
def _fill_boxes(low, high, mask):  # type: ignore[no-untyped-def]
    """Mark (H, W) the pixels of boxes (N, 2) as columns and rows, both ends included."""
    for i in range(low.shape[0]):
        mask[low[i, 1] : high[i, 1] + 1, low[i, 0] : high[i, 0] + 1] = 1

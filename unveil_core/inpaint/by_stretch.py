"""The ground of the empty street as far as it follows from what was seen, stretch by stretch: read, relit and filled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import stdtrit

from unveil_core.base.evenly import evenly
from unveil_core.base.frame_cache import FrameCache, subset
from unveil_core.base.mechanisms import on
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.fields.picture_field import PictureField
from unveil_core.geometry.images import border_px, grow
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.files import ChartSources
from unveil_core.inpaint.chart.footprint import footprint_of
from unveil_core.inpaint.chart.looks import read_looks
from unveil_core.inpaint.chart.planted import crossed_errors
from unveil_core.inpaint.chart.street_chart import PLANES, TEXEL_M, StreetChart, read_chart, rows_of, usable_pixels
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M, fill_chart
from unveil_core.inpaint.light.casters import Kinds
from unveil_core.inpaint.light.scene_light import Evidence, light_of_scene, sun_of_scene
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.light.view_light import GroundLooks, ViewLight, light_by_view, unlit
from unveil_core.inpaint.street_scene import Removal, Views
from unveil_core.inpaint.stretches import CASTS_M, Stretch, seen_rows
from unveil_core.semantics.classes import GROUND_CLASSES, SOLID_CLASSES
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.surfels import Surfels

__all__ = ["FilledStreet", "StreetFill"]

T = TypeVar("T")

SEEN_M = 60.0
"""How far beyond its ends a stretch's frames sample the ground of the next ones, metres: farther off it fills few pixels."""
CLEAR_SCORE = 0.6
"""Correlation of dark ground with a sun's shadows, at their borders, from which on nobody doubts it. The drawn samples have 0.73 to
0.86; real streets where houses and trees shade the kerbs 0.38 to 0.47, for directions a right angle apart as cars come and go."""
JUDGES = 3
"""Stretches at most that judge a sun that was found on another: each is filled three times, and has a block in 15 m."""
LEAST_BLOCKS = 3
"""Blocks of street with planted holes fewer than which decide nothing."""
SURE = 0.975
"""Probability, by Student's t, with which they must."""
LIGHT_STRETCHES, LIGHT_FRAMES = 3, 60
"""From so many stretches and so many frames of each the light by view is read: 300,000 looks, for 221 unknowns a camera."""


class StreetFill:
    """The street of a drive in stretches.

    Args:
        drive: whose frames these are; scene: its labels; ground: its street's.
        removal: what is removed; views: what the frames show.
        stretches: of the whole street, in order.
        cache: room for the frames; kept: where what was read and filled is kept.
    """

    def __init__(
        self,
        drive: Drive,
        scene: SceneLabels,
        ground: Ground,
        removal: Removal,
        views: Views,
        stretches: Sequence[Stretch],
        *,
        cache: FrameCache,
        kept: Kept,
        progress: Progress = no_progress,
    ) -> None:
        self.cameras = [f.camera for f in drive.frames]
        # Pictures of one camera may be of several sizes; each has its own light.
        taken = [(f.camera_name, (f.camera.width, f.camera.height)) for f in drive.frames]
        kinds = sorted(set(taken))
        self._which = [kinds.index(kind) for kind in taken]
        self._sizes = [size for _, size in kinds]
        self.scene, self.ground, self.removal, self.views = scene, ground, removal, views
        self.stretches = [stretch for stretch in stretches if stretch.has_ground]
        self.cache, self.kept, self.progress = cache, kept, progress
        known = scene.labels.indices
        self._kinds = Kinds(known(GROUND_CLASSES), known(SOLID_CLASSES))

    @cached_property
    def _s_of_surfels(self) -> Float64:
        """(N,) arc lengths of the full scene's surfels."""
        return self.s_of(self.removal.surfels)

    def s_of(self, surfels: Surfels) -> Float64:
        """(N,) arc lengths of surfels."""
        return self.ground.path.to_street(surfels.means.double().numpy())[:, 0]

    @cached_property
    def _s_of_cameras(self) -> Float64:
        """(V,) arc lengths of the cameras."""
        return self.ground.path.to_street(centres_of(self.cameras))[:, 0]

    def _asked(self, stretch: Stretch) -> list[int]:
        """The frames that may show what lights or shades a stretch, and the first and the last of the way, from which to which the
        ground was seen."""
        s = self._s_of_cameras
        asked = stretch.near(s, CASTS_M + ASKED_M)
        asked[[s.argmin(), s.argmax()]] = True
        return np.flatnonzero(asked).tolist()

    def _evidence(self, stretch: Stretch, chart: StreetChart, footprint: Mask) -> Evidence:
        """What tells of the sun."""
        return Evidence(chart, footprint, [self.cameras[i] for i in self._asked(stretch)])

    def _hidden(self, frame: int) -> Mask:
        """(H, W) pixels of a frame that show something that goes, with their borders."""
        return grow(self.views.removed[frame], border_px(self.cameras[frame].width, 1))

    def near(self, stretch: Stretch) -> NDArray[np.int64]:
        """Indices, rising, of the full scene's surfels near a stretch."""
        return np.flatnonzero(stretch.near(self._s_of_surfels))

    # ----------------------------------------------------------------------------------------------------------- light

    @cached_property
    def light(self) -> ViewLight | None:
        """How bright the ground looks by the place in the picture; None where that changes nothing."""
        if not on("light_by_view"):
            return None

        def look() -> dict[str, NDArray[Any]]:
            found = light_by_view(self._looks(), self._sizes)
            if found is None:
                return {"figures": np.zeros(0)}
            return {
                "fields": np.stack([f.values for f in found.fields]),
                "tops": np.array([f.top for f in found.fields]),
                "figures": np.array([found.level, found.error, found.error_without]),
            }

        kept = self.kept.once("light", look)
        if not len(kept["figures"]):
            return None
        fields = zip(kept["fields"], self._sizes, kept["tops"], strict=True)
        return ViewLight(tuple(PictureField(v, size, float(top)) for v, size, top in fields), *kept["figures"].tolist())

    def light_in(self, frame: int) -> PictureField | None:
        """That of a frame's camera."""
        return None if self.light is None else self.light.fields[self._which[frame]]

    def _looks(self) -> GroundLooks:
        """Ground as seen from several places, of some stretches from the first to the last."""
        parts = []
        for stretch in [self.stretches[k] for k in evenly(len(self.stretches), LIGHT_STRETCHES)]:
            frames = [stretch.frames[k] for k in evenly(len(stretch.frames), LIGHT_FRAMES)]
            parts.append(
                read_looks(
                    self.ground,
                    [self.cameras[i] for i in frames],
                    [self._which[i] for i in frames],
                    subset(self.views.images, frames),
                    subset(self.usable, frames),
                    stretch.rows,
                )
            )
            self.told(stretch, "comparing views")
        names = [f.name for f in fields(GroundLooks)]
        return GroundLooks(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    # ----------------------------------------------------------------------------------------------------------- ground

    def find_sun(self) -> Sun | None:
        """The sun: of what the stretches tell the surest. One that explains the dark ground by half only has to fill the street
        better than none."""
        found = []
        for stretch in self.stretches if on("sun") else ():

            def look(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
                chart = self._read(stretch)
                kept, gone = self._near(stretch)
                sun = sun_of_scene(
                    self._evidence(stretch, chart, self._footprint(stretch, chart)), kept, gone, self._kinds
                )
                return {"sun": np.array([] if sun is None else [sun.score, sun.azimuth, sun.elevation, *sun.towards])}

            numbers = self.kept.within(stretch.name).once("sun", look)["sun"]
            self.told(stretch, "looking for the sun")
            if len(numbers):
                score, azimuth, elevation, *towards = numbers.tolist()
                found.append((Sun(np.array(towards), score, azimuth, elevation), stretch))
        if not found:
            return None
        sun, stretch = max(found, key=lambda one: one[0].score)
        if sun.score >= CLEAR_SCORE or not on("sun_by_holes"):
            return sun
        # Where the sun was found it explains what was seen, as it would if it were wrong: other ground judges it.
        others = [other for other in self.stretches if other is not stretch]
        judged = [self._on_planted_holes(others[k], sun) for k in evenly(len(others), JUDGES)]
        if not any(len(errors) for errors, _ in judged):
            judged = [self._on_planted_holes(stretch, None)]
        with_sun, without = (np.concatenate(errors) for errors in zip(*judged, strict=True))
        return sun if _surely_more(without, with_sun) else None

    def _on_planted_holes(self, stretch: Stretch, sun: Sun | None) -> tuple[Float64, Float64]:
        """Errors by block (M,) of a stretch's street filled with a sun and without.

        Args:
            sun: found elsewhere; None = for each hole the one that is found on the stretch without its block.
        """
        kept, gone = self._near(stretch)

        def fill() -> dict[str, NDArray[Any]]:
            chart = self._read(stretch)
            footprint = self._footprint(stretch, chart)

            def find(seen: StreetChart) -> Sun | None:
                if sun is not None:
                    return sun
                return sun_of_scene(self._evidence(stretch, seen, footprint), kept, gone, self._kinds)

            def filled(holed: StreetChart, planted: Mask, found: Sun | None) -> StreetChart:
                return self._fill(stretch, holed, planted, found, shadows=True)

            with_sun, without = crossed_errors(chart, footprint, find, filled)
            return {"sun": with_sun, "none": without}

        errors = self.kept.within(stretch.name).once("planted", fill)
        return errors["sun"], errors["none"]

    def fill(self, sun: Sun | None, *, shadows: bool) -> FilledStreet:
        """Relight and fill the ground of all stretches.

        Args:
            sun: None where none explains the shadows.
            shadows: whether the removed objects' shadows are removed too.
        """
        filled = FilledStreet(self, sun, shadows)
        for stretch in self.stretches:
            filled.own(stretch)
        return filled

    def fill_own(self, stretch: Stretch, sun: Sun | None, *, shadows: bool) -> StreetChart:
        """The rows that a stretch owns, relit and filled, see :meth:`fill`."""

        def make() -> dict[str, NDArray[Any]]:
            chart = self._read(stretch)
            filled = self._fill(stretch, chart, self._footprint(stretch, chart), sun, shadows=shadows)
            first = stretch.rows[0] - stretch.around[0]
            return filled.part(first, first + stretch.rows[1] - stretch.rows[0]).arrays()

        return StreetChart.from_arrays(self.ground, self.kept.within(stretch.name).once("filled", make))

    def _fill(
        self, stretch: Stretch, chart: StreetChart, footprint: Mask, sun: Sun | None, *, shadows: bool
    ) -> StreetChart:
        """A chart of a stretch and its surroundings, relit and filled.

        Args:
            footprint: (A, B) texels under removed objects.
        """
        light = None
        if sun is not None:
            kept, gone = self._near(stretch)
            light = light_of_scene(self._evidence(stretch, chart, footprint), kept, gone, self._kinds, sun)
        reach = SHADOW_REACH_M if shadows else 0.0
        return fill_chart(chart, footprint, light=light, shadow_reach_m=reach, progress=self._progress(stretch))

    def gathered(self, chart_of: Callable[[Stretch], StreetChart], first: int, end: int) -> StreetChart:
        """Rows of the drive's chart from ``first`` up to ``end``, as far as there are such, from the stretches that own them."""
        own = [s for s in self.stretches if max(s.rows[0], first) < min(s.rows[1], end)]
        first, end = max(first, own[0].rows[0]), min(end, own[-1].rows[1])
        planes: dict[str, NDArray[Any]] = {}
        for stretch in own:  # only one chart at a time is held beside what is gathered
            chart = chart_of(stretch)
            low, high = max(stretch.rows[0], first), min(stretch.rows[1], end)
            part = chart.part(low - stretch.rows[0], high - stretch.rows[0])
            if len(own) == 1:
                return part
            for name in PLANES:
                plane = getattr(part, name)
                if name not in planes:
                    planes[name] = np.empty((end - first, *plane.shape[1:]), plane.dtype)
                planes[name][low - first : high - first] = plane
        s_start = self.ground.s_start + TEXEL_M * first
        return StreetChart(self.ground, chart.texel, s_start, chart.t_start, **planes)

    def told(self, stretch: Stretch, message: str) -> None:
        """Tell that a part of the work is done for a stretch."""
        self.progress(self.stretches.index(stretch) + 1, len(self.stretches), message)

    def _progress(self, stretch: Stretch) -> Progress:
        if len(self.stretches) == 1:
            return self.progress
        return part_of(self.progress, stretch.number, len(self.stretches))

    def _read(self, stretch: Stretch) -> StreetChart:
        """The ground of a stretch and of its surroundings as the frames show it."""
        return self.gathered(self._read_own, *stretch.around)

    def _read_own(self, stretch: Stretch) -> StreetChart:
        """The ground of a stretch as the frames show it."""

        def make() -> dict[str, NDArray[Any]]:
            return read_chart(
                self.ground,
                self.cameras_of(stretch),
                self.of_frames(stretch, self._pictures()),
                self.of_frames(stretch, self.views.labels),
                self.of_frames(stretch, self.usable),
                rows=stretch.rows,
                robust=on("robust_chart"),
                progress=self._progress(stretch),
            ).arrays()

        return StreetChart.from_arrays(self.ground, self.kept.within(stretch.name).once("read", make))

    @cached_property
    def usable(self) -> Sequence[Mask]:
        """(H, W) by frame, pixels that show nothing but ground."""

        def of(i: int) -> Mask:
            views, hidden = self.views, self._hidden(i)
            return usable_pixels(
                self.ground, self.cameras[i], views.labels[i], self.scene.labels, hidden, views.depths[i]
            )

        return self.cache.frames(len(self.cameras), of)

    def _pictures(self) -> Sequence[NDArray[Any]]:
        """(H, W, 3) by frame, levels up to 255, with the light by view taken away."""
        light = self.light  # looked for by all threads, before several ask for pictures
        if light is None:
            return self.views.images
        return self.cache.frames(len(self.cameras), lambda i: unlit(self.views.images[i], light.fields[self._which[i]]))

    def cameras_of(self, stretch: Stretch) -> list[Camera]:
        """Of the frames that see a stretch."""
        return [self.cameras[i] for i in stretch.frames]

    def of_frames(self, stretch: Stretch, frames: Sequence[T]) -> Sequence[T]:
        """What of all frames belongs to those that see a stretch."""
        return subset(frames, stretch.frames)

    def _near(self, stretch: Stretch) -> tuple[Surfels, Surfels]:
        """Surfels whose shadows stay, and those whose shadows go, near a stretch."""
        near, surfels = self.near(stretch), self.removal.surfels
        gone = self.removal.casts(near)
        return surfels.select(torch.from_numpy(near[~gone])), surfels.select(torch.from_numpy(near[gone]))

    def _footprint(self, stretch: Stretch, chart: StreetChart) -> Mask:
        near = self.near(stretch)
        return footprint_of(chart, self.removal.objects(near), self.removal.loose(near))


@dataclass(frozen=True, eq=False)
class FilledStreet:
    """A street whose ground is relit and filled.

    Attributes:
        street: as it was read; sun: see :meth:`StreetFill.fill`; shadows: likewise.
    """

    street: StreetFill
    sun: Sun | None
    shadows: bool

    def own(self, stretch: Stretch) -> StreetChart:
        """The filled rows of a stretch."""
        return self.street.fill_own(stretch, self.sun, shadows=self.shadows)

    def seen_from(self, stretch: Stretch) -> StreetChart:
        """The filled ground that a stretch's frames see: of its own, and what of the next ones is near."""
        ground, cameras = self.street.ground, self.street.cameras
        reach = round(SEEN_M / TEXEL_M)
        near = max(stretch.rows[0] - reach, 0), min(stretch.rows[1] + reach, rows_of(ground))
        return self.street.gathered(self.own, *seen_rows(ground, [cameras[i] for i in stretch.own], *near))

    def sources(self) -> ChartSources:
        """Where the texels of the whole street come from."""
        stretches = self.street.stretches
        sources, labels = [], []
        for stretch in stretches:  # one chart at a time: these are a tenth of it
            chart = self.own(stretch)
            sources.append(chart.source)
            labels.append(chart.label)
        start = self.street.ground.s_start + TEXEL_M * stretches[0].rows[0]
        return ChartSources(np.concatenate(sources), np.concatenate(labels), start, chart.t_start, chart.texel)


def _surely_more(one: Float64, other: Float64) -> bool:
    """Whether independent errors (M,) are surely larger than others (M,), paired."""
    if len(one) < LEAST_BLOCKS:
        return False
    more = one - other
    by_chance = more.std(ddof=1) / np.sqrt(len(more))
    return bool(more.mean() > stdtrit(len(more) - 1, SURE) * by_chance)

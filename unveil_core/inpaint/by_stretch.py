"""The empty street as far as it follows from what was seen, stretch by stretch: its ground, read, relit and filled, and completed
facades and poles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.progress import Progress, no_progress, part_of
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import ASKED_M, FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.files import ChartSources
from unveil_core.inpaint.chart.footprint import footprint_of
from unveil_core.inpaint.chart.seen_rows import seen_rows
from unveil_core.inpaint.chart.street_chart import PLANES, TEXEL_M, StreetChart, read_chart, rows_of, usable_pixels
from unveil_core.inpaint.facade.copies import FacadeCopies
from unveil_core.inpaint.facade.facade_chart import (
    FacadeChart,
    FacadeView,
    InventedFacades,
    invented_facades,
    read_facade,
    replaced_by,
)
from unveil_core.inpaint.facade.half_trees import complete_trees
from unveil_core.inpaint.facade.offsets import share_facing
from unveil_core.inpaint.facade.poles import feet_of_poles
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M, fill_chart
from unveil_core.inpaint.light.casters import Kinds
from unveil_core.inpaint.light.scene_light import light_of_scene, sun_of_scene
from unveil_core.inpaint.light.sun import Sun
from unveil_core.inpaint.street_scene import Removal, Views
from unveil_core.inpaint.stretches import CASTS_M, Stretch
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import GROUND_CLASSES, SOLID_CLASSES, UPRIGHT_CLASSES
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Completed", "StreetFill", "sky_behind"]

T = TypeVar("T")

SEEN_M = 60.0
"""How far beyond its ends a stretch's frames sample the ground of the next ones, metres: farther off it fills few pixels."""
COMPLETED = ("walls", "feet", "trees", "curtains")
COPIES = ("copies of the right side", "copies of the left side")
COVERED = 0.5
"""Alpha from which on a pixel shows what was rendered: half of the light comes from it."""


@dataclass(frozen=True, eq=False)
class Completed:
    """What completes things that were seen in part.

    Attributes:
        walls: surfels of houses where something of them is missing; feet: of poles; trees: of trees; None where nothing is.
        curtains: surfels in facades' planes over which the sky goes on, None where none does.
        sides: of the street along which houses stand, 0 to 2, whether anything of them is missing or not; mended: of them those
            where something is.
        facing: share of the houses' surfels that face the street, 0 to 1; None where there are no houses.
        displaced: (N,) which of the remaining surfels the walls replace.
        copies: where the missing parts of houses were copied from.
    """

    walls: Surfels | None
    feet: Surfels | None
    trees: Surfels | None
    curtains: Surfels | None
    sides: int
    mended: int
    facing: float | None
    displaced: Mask
    copies: Sequence[FacadeCopies] = ()

    def surfels(self) -> list[Surfels]:
        """Those that become part of the scene."""
        return [part for part in (self.walls, self.feet, self.trees) if part is not None]


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
        self.scene, self.ground, self.removal, self.views = scene, ground, removal, views
        self.stretches = [stretch for stretch in stretches if stretch.has_ground]
        self.cache, self.kept, self.progress = cache, kept, progress
        names = scene.labels.indices
        self._kinds = Kinds(names(GROUND_CLASSES), names(SOLID_CLASSES), names(("vegetation",)))

    @cached_property
    def _s_of_surfels(self) -> Float64:
        """(N,) arc lengths of the full scene's surfels."""
        return self._s_of(self.removal.surfels)

    def _s_of(self, surfels: Surfels) -> Float64:
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

    def _looking(self, stretch: Stretch) -> list[Camera]:
        """The cameras of these frames."""
        return [self.cameras[i] for i in self._asked(stretch)]

    def _hidden(self, frame: int) -> Mask:
        """(H, W) pixels of a frame that show something that goes, with their borders."""
        return grow(self.views.removed[frame], border_px(self.cameras[frame].width, 1))

    def near(self, stretch: Stretch) -> NDArray[np.int64]:
        """Indices, rising, of the full scene's surfels near a stretch."""
        return np.flatnonzero(stretch.near(self._s_of_surfels))

    # ----------------------------------------------------------------------------------------------------------- ground

    def find_sun(self) -> Sun | None:
        """The sun: of what the stretches tell the surest."""
        found = []
        for stretch in self.stretches:

            def look(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
                chart = self._read(stretch)
                kept, gone = self._near(stretch)
                sun = sun_of_scene(
                    chart,
                    kept,
                    gone,
                    footprint=self._footprint(stretch, chart),
                    cameras=self._looking(stretch),
                    kinds=self._kinds,
                )
                return {"sun": np.array([] if sun is None else [sun.score, sun.azimuth, sun.elevation, *sun.towards])}

            numbers = self.kept.within(stretch.name).once("sun", look)["sun"]
            self._told(stretch, "looking for the sun")
            if len(numbers):
                found.append(numbers)
        if not found:
            return None
        score, azimuth, elevation, *towards = max(found, key=lambda numbers: float(numbers[0]))
        return Sun(np.array(towards), float(score), float(azimuth), float(elevation))

    def fill(self, sun: Sun | None, *, shadows: bool) -> None:
        """Relight and fill the ground of all stretches.

        Args:
            sun: None where none explains the shadows.
            shadows: whether the removed objects' shadows are removed too.
        """
        for stretch in self.stretches:
            self._filled(stretch, sun, shadows)
        self._sun, self._shadows = sun, shadows

    def _filled(self, stretch: Stretch, sun: Sun | None, shadows: bool) -> StreetChart:
        """The filled rows that a stretch owns."""

        def make() -> dict[str, NDArray[Any]]:
            chart = self._read(stretch)
            kept, gone = self._near(stretch)
            footprint = self._footprint(stretch, chart)
            light = None
            if sun is not None:
                asked = self._asked(stretch)
                light = light_of_scene(
                    chart,
                    kept,
                    gone,
                    footprint=footprint,
                    cameras=self._looking(stretch),
                    kinds=self._kinds,
                    sun=sun,
                    hidden=Frames(len(asked), lambda k: self._hidden(asked[k])),
                )
            reach = SHADOW_REACH_M if shadows else 0.0
            filled = fill_chart(chart, footprint, light=light, shadow_reach_m=reach, progress=self._progress(stretch))
            first = stretch.rows[0] - stretch.around[0]
            return filled.part(first, first + stretch.rows[1] - stretch.rows[0]).arrays()

        return StreetChart.from_arrays(self.ground, self.kept.within(stretch.name).once("filled", make))

    def own(self, stretch: Stretch) -> StreetChart:
        """The filled rows of a stretch."""
        return self._filled(stretch, self._sun, self._shadows)

    def seen_from(self, stretch: Stretch) -> StreetChart:
        """The filled ground that a stretch's frames see: of its own, and what of the next ones is near."""
        reach = round(SEEN_M / TEXEL_M)
        near = max(stretch.rows[0] - reach, 0), min(stretch.rows[1] + reach, rows_of(self.ground))
        return self._gathered(self.own, *seen_rows(self.ground, [self.cameras[i] for i in stretch.own], *near))

    def _gathered(self, chart_of: Callable[[Stretch], StreetChart], first: int, end: int) -> StreetChart:
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

    def sources(self) -> ChartSources:
        """Where the texels of the whole street come from."""
        sources, labels = [], []
        for stretch in self.stretches:  # one chart at a time: these are a tenth of it
            chart = self.own(stretch)
            sources.append(chart.source)
            labels.append(chart.label)
        start = self.ground.s_start + TEXEL_M * self.stretches[0].rows[0]
        return ChartSources(np.concatenate(sources), np.concatenate(labels), start, chart.t_start, chart.texel)

    def _told(self, stretch: Stretch, message: str) -> None:
        """Tell that a part of the work is done for a stretch."""
        self.progress(self.stretches.index(stretch) + 1, len(self.stretches), message)

    def _progress(self, stretch: Stretch) -> Progress:
        if len(self.stretches) == 1:
            return self.progress
        return part_of(self.progress, stretch.number, len(self.stretches))

    def _read(self, stretch: Stretch) -> StreetChart:
        """The ground of a stretch and of its surroundings as the frames show it."""
        return self._gathered(self._read_own, *stretch.around)

    def _read_own(self, stretch: Stretch) -> StreetChart:
        """The ground of a stretch as the frames show it."""

        def make() -> dict[str, NDArray[Any]]:
            frames, views = stretch.frames, self.views

            def usable(k: int) -> Mask:
                i = frames[k]
                labels, hidden = self.scene.labels, self._hidden(i)
                return usable_pixels(self.ground, self.cameras[i], views.labels[i], labels, hidden, views.depths[i])

            return read_chart(
                self.ground,
                self.cameras_of(stretch),
                self.of_frames(stretch, views.images),
                self.of_frames(stretch, views.labels),
                Frames(len(frames), usable),
                rows=stretch.rows,
                progress=self._progress(stretch),
            ).arrays()

        return StreetChart.from_arrays(self.ground, self.kept.within(stretch.name).once("read", make))

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

    # ------------------------------------------------------------------------------------------------- what stands beside

    def complete(self, remaining: Surfels) -> Completed:
        """Facades, poles and the sky over facades, of all stretches.

        Args:
            remaining: the scene without what is removed.
        """
        s = self._s_of(remaining)
        found: dict[str, list[Surfels]] = {name: [] for name in COMPLETED}
        sides, mended = np.zeros(2, dtype=bool), np.zeros(2, dtype=bool)
        displaced = np.zeros(len(remaining), dtype=bool)
        copies = []
        for stretch in self.stretches:

            def make(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
                near = np.flatnonzero(stretch.near(s))
                return self._completed(stretch, remaining.select(torch.from_numpy(near)), near)

            arrays = self.kept.within(stretch.name).once("completed", make)
            self._told(stretch, "completing facades")
            sides |= arrays["sides"]
            mended |= arrays["mended"]
            displaced[arrays["displaced"]] = True
            named = {name: _named(arrays, name) for name in (*COMPLETED, *COPIES)}
            for name, parts in found.items():
                parts += [Surfels.from_arrays(named[name])] if named[name] else []
            copies += [FacadeCopies(**named[name]) for name in COPIES if named[name]]
        walls, feet, trees, curtains = (concatenate(parts) if parts else None for parts in found.values())
        house = self.scene.labels.index("building")
        facing = None if house is None else share_facing(remaining.select(remaining.labels == house), self.ground)
        return Completed(walls, feet, trees, curtains, int(sides.sum()), int(mended.sum()), facing, displaced, copies)

    def _completed(self, stretch: Stretch, local: Surfels, near: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """What a stretch owns of that, the arrays of :data:`COMPLETED` by name; (2,) whether houses stand on
        its ``sides``, and which of these are ``mended``; and indices ``displaced``.

        Args:
            local: the surfels near the stretch; near: (N,) their indices.
        """
        found: dict[str, list[Surfels]] = {name: [] for name in COMPLETED}
        add = self._owned_into(stretch, found)
        copies: dict[str, NDArray[Any]] = {}
        told = []
        house = self.scene.labels.index("building")
        of_walls = np.flatnonzero(np.isin(local.labels.numpy(), self.scene.labels.indices(("building",))))
        walls = local.select(torch.from_numpy(of_walls))
        owned = stretch.owns(self._s_of(walls))
        displaced = [np.zeros(0, dtype=np.int64)]
        for name, left in zip(COPIES, (False, True), strict=True):
            side = None if house is None else self._complete_side(stretch, walls, house, left=left)
            told.append((side is not None, side is not None and side[1].walls is not None))
            if side is None:
                continue
            chart, invented = side
            displaced.append(near[of_walls[owned & replaced_by(chart, invented.filled, walls)]])
            add("walls", invented.walls)
            add("curtains", invented.open)
            own = None if invented.copies is None else invented.copies.part(stretch.owns(invented.copies.s))
            copies |= {} if own is None else {f"{name}.{key}": array for key, array in vars(own).items()}
        add("feet", self._feet(stretch, local))
        add("trees", self._trees(stretch, local))
        arrays = {
            f"{name}.{key}": array
            for name, parts in found.items()
            if parts
            for key, array in concatenate(parts).arrays().items()
        }
        sides, mended = np.array(told).T
        return {"sides": sides, "mended": mended, "displaced": np.concatenate(displaced), **arrays, **copies}

    def _owned_into(self, stretch: Stretch, found: dict[str, list[Surfels]]) -> Callable[[str, Surfels | None], None]:
        """Adds what a stretch owns of some surfels to what was found."""

        def add(name: str, surfels: Surfels | None) -> None:
            if surfels is None:
                return
            own = stretch.owns(self._s_of(surfels))
            if own.any():
                found[name].append(surfels.select(torch.from_numpy(own)))

        return add

    def _complete_side(
        self, stretch: Stretch, walls: Surfels, house: int, *, left: bool
    ) -> tuple[FacadeChart, InventedFacades] | None:
        """The facades of one side, and what completes them; None where no house stands.

        Args:
            walls: surfels of houses; house: their label.
        """
        sky = self.scene.labels.indices(("sky",))
        views = self.views

        def facade_view(k: int) -> FacadeView:
            i = stretch.frames[k]
            label = views.labels[i]
            on_wall, shows_sky = label == house, np.isin(label, sky)
            return FacadeView(self.cameras[i], views.images[i], on_wall, shows_sky, views.depths[i], views.removed[i])

        seen = Frames(len(stretch.frames), facade_view)
        chart = read_facade(self.ground, walls, seen, left=left, along=stretch.s_around)
        if chart is None:
            return None
        return chart, invented_facades(chart, label=house, sh_degree=walls.sh_degree)

    def _feet(self, stretch: Stretch, local: Surfels) -> Surfels | None:
        """The hidden feet of poles beside a stretch."""
        names = self.scene.labels.indices
        kinds = torch.tensor(names(UPRIGHT_CLASSES), dtype=local.labels.dtype)
        return feet_of_poles(
            local.select(torch.isin(local.labels, kinds)),
            self.ground,
            self.cameras_of(stretch),
            self.of_frames(stretch, self.views.depths),
            self.of_frames(stretch, self.views.removed),
            plates=names(("traffic sign", "traffic light")),
            poles=names(("pole",)),
        )

    def _trees(self, stretch: Stretch, local: Surfels) -> Surfels | None:
        """The hidden parts of trees beside a stretch."""
        plant = self.scene.labels.index("vegetation")
        if plant is None:
            return None
        sky, labels = self.scene.labels.indices(("sky",)), self.of_frames(stretch, self.views.labels)
        return complete_trees(
            local.select(local.labels == plant),
            self.ground,
            self.cameras_of(stretch),
            self.of_frames(stretch, self.views.depths),
            self.of_frames(stretch, self.views.removed),
            on_plant=Frames(len(labels), lambda k: labels[k] == plant),
            sky=Frames(len(labels), lambda k: np.isin(labels[k], sky)),
        )


def _named(arrays: Mapping[str, NDArray[Any]], name: str) -> dict[str, NDArray[Any]]:
    """The arrays of one name."""
    return {key.removeprefix(f"{name}."): array for key, array in arrays.items() if key.startswith(f"{name}.")}


def sky_behind(curtains: Surfels | None, cameras: Sequence[Camera], cache: FrameCache) -> Sequence[Mask] | None:
    """(H, W) per camera, where it looks through ``curtains``; None where there are none."""
    if curtains is None:
        return None
    return cache.frames(
        len(cameras), lambda i: render_numpy(curtains, cameras[i], near=NEAR_M, far=FAR_M)["alpha"] > COVERED
    )

"""Facades, trunks and posts that were seen in part, completed stretch by stretch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.mechanisms import on
from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.by_stretch import StreetFill
from unveil_core.inpaint.facade.facade_chart import FacadeView, invented_facades, read_facade, replaced_by
from unveil_core.inpaint.facade.offsets import share_facing
from unveil_core.inpaint.facade.stems import carried_down
from unveil_core.inpaint.stretches import Stretch
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import THIN_CLASSES
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Completed", "complete_upright", "sky_behind"]

COMPLETED = ("walls", "curtains")
COVERED = 0.5
"""Alpha from which on a pixel shows what was rendered: half of the light comes from it."""


@dataclass(frozen=True, eq=False)
class Completed:
    """What completes things that were seen in part.

    Attributes:
        walls: surfels of houses, trunks and posts where something of them is missing; None where nothing is.
        curtains: surfels in facades' planes over which the sky goes on, None where none does.
        sides: of the street along which houses stand, 0 to 2, whether anything of them is missing or not; mended: of them those
            where something is.
        facing: share of the houses' surfels that face the street, 0 to 1; None where there are no houses.
        displaced: (N,) which of the remaining surfels the walls replace.
    """

    walls: Surfels | None
    curtains: Surfels | None
    sides: int
    mended: int
    facing: float | None
    displaced: Mask


def complete_upright(fill: StreetFill, remaining: Surfels) -> Completed:
    """Facades and the sky over them, of all stretches.

    Args:
        fill: the street; remaining: the scene without what is removed.
    """
    s = fill.s_of(remaining)
    found: dict[str, list[Surfels]] = {name: [] for name in COMPLETED}
    sides, mended = np.zeros(2, dtype=bool), np.zeros(2, dtype=bool)
    displaced = np.zeros(len(remaining), dtype=bool)
    for stretch in fill.stretches:

        def make(stretch: Stretch = stretch) -> dict[str, NDArray[Any]]:
            near = np.flatnonzero(stretch.near(s))
            return _Beside(fill, stretch, remaining.select(torch.from_numpy(near)), near).completed()

        arrays = fill.kept.within(stretch.name).once("completed", make)
        fill.told(stretch, "completing facades")
        sides |= arrays["sides"]
        mended |= arrays["mended"]
        displaced[arrays["displaced"]] = True
        for name, parts in found.items():
            named = _named(arrays, name)
            parts += [Surfels.from_arrays(named)] if named else []
    walls, curtains = (concatenate(parts) if parts else None for parts in found.values())
    house = fill.scene.labels.index("building")
    facing = None if house is None else share_facing(remaining.select(remaining.labels == house), fill.ground)
    return Completed(walls, curtains, int(sides.sum()), int(mended.sum()), facing, displaced)


class _Beside:
    """What stands beside one stretch.

    Args:
        fill: the street; stretch: of it.
        local: the surfels near the stretch; near: (N,) their indices.
    """

    def __init__(self, fill: StreetFill, stretch: Stretch, local: Surfels, near: NDArray[np.int64]) -> None:
        self.fill, self.stretch, self.local, self.near = fill, stretch, local, near
        self.found: dict[str, list[Surfels]] = {name: [] for name in COMPLETED}
        self.displaced = [np.zeros(0, dtype=np.int64)]

    def completed(self) -> dict[str, NDArray[Any]]:
        """What the stretch owns of that: the arrays of :data:`COMPLETED` by name; (2,) whether houses stand on
        its ``sides``, and which of these are ``mended``; and indices ``displaced``."""
        told = self._houses()
        self._add("walls", self._stems())
        arrays = {
            f"{name}.{key}": array
            for name, parts in self.found.items()
            if parts
            for key, array in concatenate(parts).arrays().items()
        }
        sides, mended = np.array(told).T
        displaced = np.concatenate(self.displaced)
        return {"sides": sides, "mended": mended, "displaced": displaced, **arrays}

    def _add(self, name: str, surfels: Surfels | None) -> None:
        """Add what the stretch owns of some surfels to what was found."""
        if surfels is None:
            return
        own = self._owned(surfels)
        if own.any():
            self.found[name].append(surfels.select(torch.from_numpy(own)))

    def _displace(self, those: NDArray[np.int64]) -> None:
        """Let surfels near the stretch, by number (K,), make room for what completes them."""
        if on("replaced_walls"):
            self.displaced.append(self.near[those])

    def _of(self, labels: Sequence[int]) -> tuple[Surfels, NDArray[np.int64]]:
        """The surfels of some labels, and which they are of those near the stretch."""
        those = np.flatnonzero(np.isin(self.local.labels.numpy(), labels))
        return self.local.select(torch.from_numpy(those)), those

    def _owned(self, surfels: Surfels) -> Mask:
        """(N,) which surfels the stretch owns."""
        return self.stretch.owns(self.fill.s_of(surfels))

    def _houses(self) -> list[tuple[bool, bool]]:
        """Complete the facades; returns of each side whether houses stand there, and whether anything of them was missing."""
        house = self.fill.scene.labels.index("building")
        if house is None or not on("facades"):
            return [(False, False)] * 2
        (walls, those), seen, told = self._of((house,)), self._views((house,)), []
        owned = self._owned(walls)
        for left in (False, True):
            chart = read_facade(self.fill.ground, walls, seen, left=left, along=self.stretch.s_around)
            if chart is None:
                told.append((False, False))
                continue
            invented = invented_facades(chart, label=house, sh_degree=walls.sh_degree)
            told.append((True, invented.walls is not None))
            self._displace(those[owned & replaced_by(chart, invented.filled, walls)])
            self._add("walls", invented.walls)
            self._add("curtains", invented.open if on("sky_over_facades") else None)
        return told

    def _stems(self) -> Surfels | None:
        """The hidden feet of trunks and posts."""
        labels = self.fill.scene.labels
        plants = labels.indices(("vegetation",))
        standing, _ = self._of((*plants, *labels.indices(THIN_CLASSES)))
        if not on("carried_stems") or not len(standing):
            return None
        return carried_down(standing, plants, self.fill.ground, self._views(()))

    def _views(self, labels: Sequence[int]) -> Sequence[FacadeView]:
        """What the frames that see the stretch show of upright surfaces of some ``labels``."""
        fill, frames = self.fill, self.stretch.frames
        sky, views = fill.scene.labels.indices(("sky",)), fill.views

        def view(k: int) -> FacadeView:
            i = frames[k]
            label = views.labels[i]
            on_wall, shows_sky = np.isin(label, labels), np.isin(label, sky)
            return FacadeView(fill.cameras[i], views.images[i], on_wall, shows_sky, views.depths[i], views.removed[i])

        return Frames(len(frames), view)


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

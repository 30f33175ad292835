"""The empty street as far as it follows from what was seen: its ground as a filled chart, and completed facades and poles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Labels, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import StreetChart, read_chart, usable_pixels
from unveil_core.inpaint.facade.facade_chart import FacadeView, invented_facades, read_facade
from unveil_core.inpaint.facade.poles import feet_of_poles
from unveil_core.inpaint.fill.chart_fill import SHADOW_REACH_M, fill_chart
from unveil_core.inpaint.light.scene_light import light_of_scene
from unveil_core.inpaint.light.sun import Sun
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import SOLID_CLASSES, UPRIGHT_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_labels
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Completed", "Removal", "Views", "complete_scene", "drive_views", "empty_ground_chart"]

LOWEST_M, HIGHEST_M = -0.5, 2.5
"""Heights over the ground between which an object's surfels say where it stands, metres: not the roof of a lorry, nor strays below
the road."""
LONGEST_M = 6.0
"""Length from which on an object gets a hull for each so long piece of it, metres: longer than a car, it is an articulated lorry in
a bend, or several that touch."""
JOIN_M = 0.3
"""Side of the gaps that are closed between texels of an object before its parts are compared, metres. Chosen on the two sample
streets."""
COVERED = 0.5
"""Alpha from which on a pixel shows what was rendered: half of the light comes from it."""
LEAST_PART_M2, LEAST_PART = 0.15, 0.25
"""Smallest area of a part of an object that counts for its hull, square metres and as a share of the largest: strays would stretch
it. Chosen on the two sample streets."""


@dataclass(frozen=True, eq=False)
class Views:
    """What each frame shows.

    Attributes:
        images: (H, W, 3) uint8; labels: (H, W) compact; depths: (H, W) of the full scene; removed: (H, W) bool.
    """

    images: Sequence[NDArray[np.uint8]]
    labels: Sequence[NDArray[np.int64]]
    depths: Sequence[NDArray[np.float32]]
    removed: Sequence[NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Removal:
    """What is removed from a scene.

    Attributes:
        surfels: the full scene of N surfels.
        gone: (N,) those that are removed; instance: (N,) the object that each belongs to.
    """

    surfels: Surfels
    gone: Mask
    instance: Labels

    def objects(self) -> list[NDArray[np.float64]]:
        """(M, 3) positions of the removed surfels, one array per object."""
        means = self.surfels.means.double().numpy()
        instance = np.where(self.gone, self.instance, 0)
        return [means[instance == i] for i in np.unique(instance) if i > 0]

    def loose(self) -> NDArray[np.float64]:
        """(M, 3) positions of the removed surfels that belong to no object."""
        return self.surfels.means.double().numpy()[self.gone & (self.instance == 0)]


@dataclass(frozen=True, eq=False)
class Completed:
    """What completes things that were seen in part.

    Attributes:
        facades: surfels, one scene per side of the street where something is missing.
        feet: surfels of the feet of poles, None where none is hidden.
        sky: (H, W) bool per frame, where the sky goes on over completed facades; None where none goes on.
        sides: of the street along which houses stand, 0 to 2, whether anything of them is missing or not.
    """

    facades: list[Surfels]
    feet: Surfels | None
    sky: Sequence[Mask] | None
    sides: int


def drive_views(
    drive: Drive,
    scene: SceneLabels,
    surfels: Surfels,
    images: Sequence[NDArray[np.uint8]],
    removed: Sequence[NDArray[np.bool_]],
    cache: FrameCache,
    scratch: Path,
) -> Views:
    """The frames of a drive with what is known of them.

    Args:
        cache: room for the frames; scratch: folder for rendered depths.
    """
    frames = drive.frames
    small = cache.frames(len(frames), lambda i: frame_labels(frames[i], scene).astype(np.int16))
    labels = Frames(len(frames), lambda i: small[i].astype(np.int64))
    depths = cache.stored(
        scratch, len(frames), lambda i: (render_numpy(surfels, frames[i].camera, near=NEAR_M, far=FAR_M)["depth"],)
    )
    return Views(images, labels, Frames(len(frames), lambda i: depths[i][0]), removed)


def empty_ground_chart(
    drive: Drive,
    scene: SceneLabels,
    ground: Ground,
    removal: Removal,
    views: Views,
    *,
    shadows: bool = True,
    sun: tuple[float, float] | None = None,
    progress: Progress = no_progress,
) -> tuple[StreetChart, Sun | None]:
    """The chart of the empty street: read from the frames, relit and filled.

    Args:
        ground: the street's.
        shadows: whether the removed objects' shadows are removed too.
        sun: its azimuth and elevation, degrees; None = looked for.
    Returns:
        the chart, and the sun, None where none explains the shadows.
    """
    cameras = [f.camera for f in drive.frames]

    def usable_in(i: int) -> Mask:
        hidden = grow(views.removed[i], border_px(cameras[i].width, 1))
        return usable_pixels(ground, cameras[i], views.labels[i], scene.labels, hidden, views.depths[i])

    usable = Frames(len(cameras), usable_in)
    chart = read_chart(ground, cameras, views.images, views.labels, usable, progress=progress)
    footprint = _footprint(chart, removal.objects(), removal.loose())
    keep = torch.from_numpy(~removal.gone)
    light = light_of_scene(
        chart,
        removal.surfels.select(keep),
        removal.surfels.select(~keep),
        footprint=footprint,
        cameras=cameras,
        solid=scene.labels.indices(SOLID_CLASSES),
        plants=scene.labels.indices(("vegetation",)),
        given=sun,
    )
    reach = SHADOW_REACH_M if shadows else 0.0
    filled = fill_chart(chart, footprint, light=light, shadow_reach_m=reach, progress=progress)
    return filled, None if light is None else light.sun


def complete_scene(
    drive: Drive, scene: SceneLabels, ground: Ground, remaining: Surfels, views: Views, cache: FrameCache
) -> Completed:
    """What completes things that were seen in part.

    Args:
        ground: the street's.
        remaining: the scene without what is removed.
        cache: room for the frames.
    """
    cameras = [f.camera for f in drive.frames]
    facades: list[Surfels] = []
    curtains: list[Surfels] = []
    sides = 0
    house = scene.labels.index("building")
    if house is not None:
        walls = remaining.select(remaining.labels == house)
        sky = scene.labels.indices(("sky",))

        def facade_view(i: int) -> FacadeView:
            label = views.labels[i]
            on_wall, shows_sky = label == house, np.isin(label, sky)
            return FacadeView(cameras[i], views.images[i], on_wall, shows_sky, views.depths[i], views.removed[i])

        seen = Frames(len(cameras), facade_view)
        for left in (False, True):
            chart = read_facade(ground, walls, seen, left=left)
            if chart is not None:
                sides += 1
                found = invented_facades(chart, label=house, sh_degree=remaining.sh_degree)
                facades += [] if found.walls is None else [found.walls]
                curtains += [] if found.open is None else [found.open]
    kinds = torch.tensor(scene.labels.indices(UPRIGHT_CLASSES), dtype=remaining.labels.dtype)
    standing = remaining.select(torch.isin(remaining.labels, kinds))
    plates, poles = (scene.labels.indices(names) for names in (("traffic sign", "traffic light"), ("pole",)))
    feet = feet_of_poles(standing, ground, cameras, views.depths, views.removed, plates=plates, poles=poles)
    return Completed(facades, feet, _skies(cameras, curtains, cache), sides)


def _skies(cameras: Sequence[Camera], curtains: Sequence[Surfels], cache: FrameCache) -> Sequence[Mask] | None:
    """(H, W) per camera, where it looks through ``curtains``; None where there are none."""
    if not curtains:
        return None
    planes = concatenate(list(curtains))
    return cache.frames(
        len(cameras), lambda i: render_numpy(planes, cameras[i], near=NEAR_M, far=FAR_M)["alpha"] > COVERED
    )


def _footprint(
    chart: StreetChart, removed: Sequence[NDArray[np.float64]], loose: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    """(A, B) texels that removed objects stand on: the hull of each object's low surfels, of a long one's piece by piece.

    Args:
        removed: (M, 3) positions of each object's surfels; loose: (L, 3) of those that belong to none and have no hull.
    """
    footprint = np.zeros(chart.source.shape, dtype=np.uint8)
    if loose is not None:
        footprint |= _low_texels(chart, loose)
    for means in removed:
        texels = _low_texels(chart, means)
        if np.count_nonzero(texels) < 3:
            footprint |= texels
            continue
        dense = _dense(texels, chart.texel)
        rows, columns = np.nonzero(dense)
        for inside in _pieces(rows, LONGEST_M / chart.texel):
            if np.count_nonzero(inside) >= 3:
                hull = cv2.convexHull(np.stack([columns[inside], rows[inside]], axis=1).astype(np.int32))
                cv2.fillConvexPoly(footprint, hull, 1)
        footprint |= texels
    return footprint.astype(bool)


def _low_texels(chart: StreetChart, means: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(A, B) texels over which surfels (M, 3) of an object lie low enough to tell where it stands."""
    texels = np.zeros(chart.source.shape, dtype=np.uint8)
    street = chart.ground.path.to_street(means)
    above = chart.ground.over(street)
    row, column, on_chart = chart.index_of(street)
    low = on_chart & (above < HIGHEST_M) & (above > LOWEST_M)
    texels[row[low], column[low]] = 1
    return texels


def _dense(texels: NDArray[np.uint8], texel: float) -> Mask:
    """(A, B) of an object's texels those with company: strays would stretch its hull."""
    closed = cv2.morphologyEx(texels, cv2.MORPH_CLOSE, np.ones((2 * int(JOIN_M / texel) + 1,) * 2, np.uint8))
    count, component, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA] * texel**2
    least = max(LEAST_PART_M2, LEAST_PART * areas[1:].max(initial=0.0))
    return np.isin(component, [k for k in range(1, count) if areas[k] > least])


def _pieces(rows: NDArray[np.int64], longest: float) -> list[Mask]:
    """Which texels (N,), by their rows along the street, belong to each piece of an object; pieces of a long one overlap by
    half, so that none ends where it is widest."""
    if not len(rows) or np.ptp(rows) < longest:
        return [np.ones(len(rows), dtype=bool)]
    starts = np.arange(rows.min(), rows.max(), longest / 2)
    return [(rows >= start) & (rows <= start + longest) for start in starts]

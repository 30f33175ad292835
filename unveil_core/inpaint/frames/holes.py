"""The background of one frame: what the remaining scene and the chart show behind what is removed, and the holes where neither has
a surface, at the depth that is expected there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Levels, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.fields.picture_field import PictureField
from unveil_core.geometry.images import border_px, grow
from unveil_core.inpaint.chart.layer import GroundLayer, GroundPixels
from unveil_core.inpaint.frames.depth import complete_depth
from unveil_core.raster.picture import render_numpy
from unveil_core.surfels.surfels import Surfels

__all__ = [
    "CARRIED_M",
    "BackgroundLayers",
    "FrameTask",
    "Hole",
    "background_layers",
    "hole_in_frame",
    "missing_depth",
    "open_hole",
]

CARRIED_M = 30.0
"""Depth up to which what one frame invents is carried to others, metres. What is continued from around a hole is off by a share of
the depth that grows with it, and the pixels are as large as bricks there: what was meant for a house 150 m away hangs in the
street as fog, before frames that come by. Those see the place from near and invent it themselves. On eight streets by seed the
inpainted frames gain 0 to 0.9 dB over 60 m, and 15 m are as good."""
SOLID = 0.6
"""Alpha of the remaining scene above which a pixel shows a surface. Chosen on the two sample streets."""
IN_FRONT_ALPHA = 0.5
"""Alpha above which the rendered depth is that of something: half of the light comes from it."""
KNEE_SHARE = 0.28
"""Height over the ground, as a share of the camera's, below which what renders in front of it is the remains of a removed object,
unless its label says otherwise: 0.45 m at 1.6 m, a knee."""
FOOT_SHARE = 0.05
"""The same for surfels whose label is not ground: 0.08 m at 1.6 m."""


@dataclass(frozen=True, eq=False)
class FrameTask:
    """One frame to clean.

    Attributes:
        camera: its camera; image: (H, W, 3) levels of 255, as photographed.
        removed: (H, W) bool, pixels of removed objects with their borders.
        unobserved: (H, W) bool, of them those behind which lies what no frame shows.
        kept: (H, W) bool, pixels of objects that stay, on which no ground is relit; None where they are not known.
        sky: (H, W) bool, pixels behind which facades end below the sky; None where they are not known.
        ground: (H, W) bool, pixels whose photograph shows ground; None where no labels tell.
        light: of the camera's pictures, see :mod:`unveil_core.inpaint.light.view_light`; None where it is even.
    """

    camera: Camera
    image: Levels
    removed: Mask
    unobserved: Mask
    kept: Mask | None = None
    sky: Mask | None = None
    ground: Mask | None = None
    light: PictureField | None = None


@dataclass(frozen=True, eq=False)
class BackgroundLayers:
    """What a frame shows without the removed objects, as far as the scene and the chart know it; planes (H, W…).

    Attributes:
        rendered: rgb, alpha, depth of the remaining scene.
        solid: bool, the scene shows a surface.
        chart: the ground as the chart has it, None without a chart.
        in_front: bool, the scene shows something in front of the ground.
        from_chart: bool, removed pixels that the chart fills.
        below_horizon: bool, pixels that cannot show the sky.
    """

    rendered: dict[str, NDArray[np.float32]]
    solid: Mask
    chart: GroundPixels | None
    in_front: Mask
    from_chart: Mask
    below_horizon: Mask

    @property
    def ceiling(self) -> NDArray[np.float64]:
        """(H, W) depth of the ground, behind which nothing can lie; inf where there is none."""
        return np.full(self.solid.shape, np.inf) if self.chart is None else self.chart.depth


@dataclass(frozen=True, eq=False)
class Hole:
    """A frame's hole on its completed depth.

    Attributes:
        camera: of the frame.
        mask: (H, W) bool, pixels without a surface.
        depth: (P,) of the mask's pixels, in the order of ``np.nonzero``, along the optical axis.
    """

    camera: Camera
    mask: Mask
    depth: NDArray[np.float64]

    def points(self) -> NDArray[np.float64]:
        """(P, 3) world points of the pixels."""
        points: NDArray[np.float64] = self.camera.centre + self.depth[:, None] * self.camera.rays()[self.mask]
        return points

    def area(self) -> NDArray[np.float64]:
        """(P,) of the pixels, facing the camera, square metres."""
        return self.depth**2 / (self.camera.fx * self.camera.fy)


def background_layers(
    task: FrameTask, surfels: Surfels, layer: GroundLayer | None, around: Mask | None = None
) -> BackgroundLayers:
    """The background of a frame.

    Args:
        surfels: the remaining scene, with what was invented so far.
        layer: the ground; None where the scene has none.
        around: (H, W) pixels beside the removed ones that the chart is sampled for as well.
    """
    ground_labels = () if layer is None else layer.ground_labels
    rendered = render_numpy(surfels, task.camera, near=NEAR_M, far=FAR_M, apart=ground_labels)
    # A half-covered pixel in the removed region lacks surfels; it does not show the sky.
    solid = rendered["alpha"] > SOLID
    if layer is None:
        nothing = np.zeros_like(task.removed)
        return BackgroundLayers(rendered, solid, None, nothing, nothing, task.unobserved)
    chart = layer.sample(task.camera, task.removed if around is None else task.removed | around, task.light)
    # Lower than a knee above the ground, what renders is the underside of a removed object. Where there are labels, only surfels
    # that are labelled as ground: a bush goes down to its foot.
    ground = layer.chart.ground
    least = np.full(
        task.removed.shape, KNEE_SHARE * float(ground.over(ground.path.to_street(task.camera.centre[None]))[0])
    )
    if ground_labels:
        least[rendered["kinds"][..., 0] > rendered["kinds"][..., 1]] *= FOOT_SHARE / KNEE_SHARE
    in_front = (rendered["alpha"] > IN_FRONT_ALPHA) & (rendered["depth"] < chart.depth)
    over_ground = in_front & chart.hit
    places = task.camera.centre + rendered["depth"][over_ground, None] * task.camera.rays()[over_ground]
    in_front[over_ground] = ground.over(ground.path.to_street(places)) > least[over_ground]
    from_chart = chart.covered & ~in_front & task.removed
    below_horizon = task.camera.below_horizon(ground.path.axes[2])
    return BackgroundLayers(rendered, solid, chart, in_front, from_chart, below_horizon)


def hole_in_frame(task: FrameTask, background: BackgroundLayers) -> Mask:
    """(H, W) pixels of the frame that still lack a surface."""
    # The mask's border, beyond the object's pixels, shows what lies beside them: a wider border contains it.
    unseen = grow(task.unobserved, border_px(task.camera.width, 3)) & task.removed
    # Surfels carried from another frame close the hole.
    empty = (unseen | (task.removed & background.below_horizon)) & ~background.from_chart & ~background.solid
    return empty if task.sky is None else empty & ~task.sky


def missing_depth(task: FrameTask, background: BackgroundLayers, empty: Mask) -> NDArray[np.float64]:
    """(H, W) depth of the scene, continued into ``empty`` from around it, before the ground."""
    rendered = background.rendered
    return complete_depth(rendered["depth"], rendered["alpha"] > IN_FRONT_ALPHA, empty, background.ceiling)


def open_hole(task: FrameTask, surfels: Surfels, layer: GroundLayer | None) -> Hole:
    """The hole that ``surfels`` and the chart leave in a frame, see :func:`hole_in_frame`, as far as it is carried to others."""
    background = background_layers(task, surfels, layer)
    empty = hole_in_frame(task, background)
    if not empty.any():
        return Hole(task.camera, empty, np.zeros(0))
    depth = missing_depth(task, background, empty)
    carried = empty & (depth <= CARRIED_M)
    return Hole(task.camera, carried, depth[carried])

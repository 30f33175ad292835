"""Holes of the empty street in one frame: pixels behind what is removed for which neither the scene nor the street chart has a
surface, and the depth at which the missing surface is thought to lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.inpaint.chart.layer import GroundLayer, GroundPixels
from unveil_core.inpaint.frames.depth import complete_depth
from unveil_core.raster.picture import render_numpy
from unveil_core.surfels.surfels import Surfels

__all__ = ["Behind", "FrameTask", "Hole", "hole_in_frame", "look_behind", "missing_depth", "open_hole"]

SOLID = 0.6
"""A pixel of the empty scene with more alpha than this shows a surface."""
KNEE_SHARE = 0.28
"""Height of a knee as a share of the camera's height over the ground."""
FOOT_SHARE = 0.05
"""What bears no label of the ground and is lower than this is taken for ground all the same."""


@dataclass(frozen=True, eq=False)
class FrameTask:
    """One frame to clean.

    Attributes:
        camera: its camera; image: (H, W, 3) uint8 as photographed.
        removed: (H, W) bool, pixels of removed objects with their borders.
        unobserved: (H, W) bool, of them those that nobody saw.
        stands: (H, W) bool, pixels of objects that stay, on which no ground is relit; None where nothing tells.
    """

    camera: Camera
    image: NDArray[np.uint8]
    removed: Mask
    unobserved: Mask
    stands: Mask | None = None


@dataclass(frozen=True, eq=False)
class Behind:
    """What the scene and the street chart know of a frame without the removed; planes (H, W…).

    Attributes:
        out: rgb, alpha, depth of the scene.
        solid: bool, the scene shows a surface.
        look: the street chart's ground, None without a chart.
        in_front: bool, the scene shows something that stands before the ground.
        ground: bool, removed pixels that the street chart fills.
        below: bool, pixels that cannot show the sky.
    """

    out: dict[str, NDArray[np.float32]]
    solid: Mask
    look: GroundPixels | None
    in_front: Mask
    ground: Mask
    below: Mask

    @property
    def ceiling(self) -> NDArray[np.float64]:
        """(H, W) depth of the ground, which nothing can lie behind; inf where there is none."""
        return np.full(self.solid.shape, np.inf) if self.look is None else self.look.depth


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


def look_behind(
    task: FrameTask, scene: Surfels, layer: GroundLayer | None, around: Mask | None = None, *, near: float, far: float
) -> Behind:
    """Look at ``scene``, which lacks the removed, and at the street chart.

    Args:
        around: (H, W) pixels beside the removed ones for which the chart is asked, too.
        near, far: metres.
    """
    ground_labels = () if layer is None else layer.ground_labels
    out = render_numpy(scene, task.camera, near=near, far=far, apart=ground_labels)
    # A half-covered pixel in the removed region lacks surfels; it is no window to the sky.
    solid = out["alpha"] > SOLID
    if layer is None:
        nothing = np.zeros_like(task.removed)
        return Behind(out, solid, None, nothing, nothing, task.unobserved)
    look = layer.sample(task.camera, task.removed if around is None else task.removed | around)
    # Lower than a knee above the ground nothing is left that stands on the street: what renders there is the
    # underside of what went. Where labels tell, only what bears one of the ground is, and a bush goes down to its foot.
    ground = layer.chart.ground
    least = np.full(
        task.removed.shape, KNEE_SHARE * float(ground.over(ground.path.to_street(task.camera.centre[None]))[0])
    )
    if ground_labels:
        least[out["kinds"][..., 0] > out["kinds"][..., 1]] *= FOOT_SHARE / KNEE_SHARE
    in_front = (out["alpha"] > 0.5) & (out["depth"] < look.depth)
    there = in_front & look.hit
    places = task.camera.centre + out["depth"][there, None] * task.camera.rays()[there]
    in_front[there] = ground.over(ground.path.to_street(places)) > least[there]
    in_front |= layer.foot_pixels(task.camera, out["depth"])
    filled = look.covered & ~in_front & task.removed
    below = task.camera.rays() @ ground.path.axes[2] < 0
    return Behind(out, solid, look, in_front, filled, below)


def hole_in_frame(task: FrameTask, behind: Behind, filled: Mask | None = None) -> Mask:
    """(H, W) pixels of the frame that still lack a surface; ``filled``: pixels that something else has filled."""
    # The mask's border, beyond the object's own pixels, shows what lies beside them: a wider border contains it.
    unseen = grow(task.unobserved, border_px(task.camera.width, 3)) & task.removed
    # Where surfels carried from another frame cover the hole, it is no hole any more.
    empty = (unseen | (task.removed & behind.below)) & ~behind.ground & ~behind.solid
    return empty if filled is None else empty & ~filled


def missing_depth(behind: Behind, empty: Mask) -> NDArray[np.float64]:
    """(H, W) depth of the scene, continued into ``empty`` from around it, before the ground."""
    return complete_depth(behind.out["depth"], behind.out["alpha"] > 0.5, empty, behind.ceiling)


def open_hole(
    task: FrameTask, scene: Surfels, layer: GroundLayer | None, filled: Mask | None = None, *, near: float, far: float
) -> Hole:
    """The hole that ``scene`` and the street chart leave in a frame, see :func:`hole_in_frame`."""
    behind = look_behind(task, scene, layer, near=near, far=far)
    empty = hole_in_frame(task, behind, filled)
    return Hole(task.camera, empty, missing_depth(behind, empty)[empty] if empty.any() else np.zeros(0))

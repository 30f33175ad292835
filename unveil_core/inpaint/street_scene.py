"""What the stage works on: what each frame shows, and what is removed from the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.types import Labels, Levels, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.labels import SceneLabels, labels_of_frames
from unveil_core.semantics.members import Members
from unveil_core.surfels.scene_edit import SceneEdit
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["Given", "Removal", "Views", "drive_views"]


@dataclass(frozen=True, eq=False)
class Views:
    """What each frame shows.

    Attributes:
        images: (H, W, 3) levels of 255; labels: (H, W) compact; depths: (H, W) of the full scene; removed: (H, W) bool.
    """

    images: Sequence[Levels]
    labels: Sequence[NDArray[np.int64]]
    depths: Sequence[NDArray[np.float32]]
    removed: Sequence[NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Removal:
    """What is removed from a scene.

    Attributes:
        surfels: the full scene of N surfels.
        gone: (N,) those that are removed; instance: (N,) the object that each belongs to.
        shadow_stays: ids of removed objects whose shadows are left in the street.
    """

    surfels: Surfels
    gone: Mask
    instance: Labels
    shadow_stays: frozenset[int] = frozenset()

    def casts(self, near: NDArray[np.int64]) -> Mask:
        """(K,) which of the surfels at indices ``near`` (K,) cast a shadow that goes."""
        stays = np.isin(self.instance[near], list(self.shadow_stays))
        goes: Mask = self.gone[near] & ~stays
        return goes

    def objects(self, near: NDArray[np.int64]) -> list[NDArray[np.float64]]:
        """(M, 3) positions of the removed surfels among those at indices ``near`` (K,), one array per object."""
        gone = near[self.gone[near]]
        members = Members(self.instance[gone])
        return [self._positions(gone[members[i]]) for i in members.numbers.tolist() if i > 0]

    def loose(self, near: NDArray[np.int64]) -> NDArray[np.float64]:
        """(M, 3) positions of the removed surfels that belong to no object, likewise."""
        return self._positions(near[self.gone[near] & (self.instance[near] == 0)])

    def _positions(self, index: NDArray[np.int64]) -> NDArray[np.float64]:
        return self.surfels.means[torch.from_numpy(index)].double().numpy()


@dataclass(frozen=True, eq=False)
class Given:
    """What is known before anything is filled.

    Attributes:
        drive: whose frames these are; scene: its labels, with what was chosen; sky: behind the scene.
        removal: what is removed; edit: what that makes of the scene; views: what the frames show.
        shaded: (H, W) bool per frame, shadows of moving objects; unobserved: (H, W) bool per frame, pixels that no frame shows.
    """

    drive: Drive
    scene: SceneLabels
    removal: Removal
    edit: SceneEdit
    sky: Sky
    views: Views
    shaded: Sequence[Mask]
    unobserved: Sequence[Mask]


def drive_views(
    drive: Drive,
    scene: SceneLabels,
    surfels: Surfels,
    images: Sequence[Levels],
    removed: Sequence[NDArray[np.bool_]],
    cache: FrameCache,
    scratch: Path,
) -> Views:
    """The frames of a drive with what is known of them.

    Args:
        cache: room for the frames; scratch: folder for rendered depths.
    """
    frames = drive.frames
    labels = labels_of_frames(frames, scene, cache)
    depths = cache.stored(
        scratch, len(frames), lambda i: (render_numpy(surfels, frames[i].camera, near=NEAR_M, far=FAR_M)["depth"],)
    )
    return Views(images, labels, Frames(len(frames), lambda i: depths[i][0]), removed)

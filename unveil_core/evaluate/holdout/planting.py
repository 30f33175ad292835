"""What the check needs of the workspace of a real drive, and that drive with virtual cars in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import FAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.holdout.drive import (
    AddedLabels,
    added_labels,
    moved_points,
    seen_elsewhere,
    write_holdout_drive,
)
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView, ground_shown, scene_view, see_cars
from unveil_core.evaluate.holdout.scores import HoldoutFrame
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar
from unveil_core.evaluate.pictures import workspace_mask
from unveil_core.geometry.reach import CameraViews
from unveil_core.ground.files import read_ground
from unveil_core.ground.street import Ground
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import load_selection
from unveil_core.workspace.workspace import Workspace

__all__ = ["FootageScene", "Planted", "plant", "read_scene"]


@dataclass(frozen=True, eq=False)
class FootageScene:
    """The real drive, as its own run found it.

    Attributes:
        drive: as imported; labels: what is removed of it.
        surfels: with everything in it; street: its ground.
        views: of all frames.
        removed: per frame (H, W) what is really removed there.
    """

    drive: Drive
    labels: SceneLabels
    surfels: Surfels
    street: Ground
    views: CameraViews[SceneView]
    removed: Sequence[Mask]


@dataclass(frozen=True, eq=False)
class Planted:
    """The drive with virtual cars.

    Attributes:
        drive: as it was written; labels: of the cars.
        frames: the real frames with what is known of the cars in them, made when they are asked for.
    """

    drive: Drive
    labels: AddedLabels
    frames: Sequence[HoldoutFrame]


def read_scene(
    workspace: Workspace, cache: FrameCache, scratch: Path, progress: Progress = no_progress
) -> FootageScene:
    """Read the workspace of a drive, run up to ``inpaint``.

    Args:
        cache: room for masks and views; scratch: a folder for what the scene shows in each frame, to be deleted afterwards.
    Raises:
        WorkspaceError: no ground was found.
    """
    drive = read_imported(workspace.drive_dir)
    labels = load_selection(workspace)
    surfels = read_surfels(workspace.surfels_full)
    street = read_ground(workspace.ground_npz).street
    if street is None:
        raise WorkspaceError(
            "No room for a virtual car: no ground was found",
            path=workspace.root,
            mend="give a drive that shows the street",
        )
    frames, kept = drive.frames, Kept(scratch)

    def mask(name: str, i: int) -> Mask:
        shape = (frames[i].camera.height, frames[i].camera.width)
        found = workspace_mask(workspace.root / f"masks/{name}", frames[i], shape)
        return np.zeros(shape, dtype=bool) if found is None else found

    removed = cache.frames(len(frames), lambda i: mask("removed", i))

    def look(i: int) -> SceneView:
        def drawn() -> dict[str, NDArray[Any]]:
            camera, barred = frames[i].camera, removed[i] | mask("shadows", i)
            view = scene_view(surfels, camera, barred)
            progress(i + 1, len(frames), "looking at the street")
            return {"depth": view.depth, "excluded": view.excluded}

        return SceneView(frames[i].camera, **kept.once(str(i), drawn))

    views = CameraViews([f.camera for f in frames], cache.frames(len(frames), look))
    return FootageScene(drive, labels, surfels, street, views, removed)


def plant(
    scene: FootageScene,
    cars: Sequence[VirtualCar],
    drive_folder: Path,
    numbers_folder: Path,
    cache: FrameCache,
    progress: Progress = no_progress,
) -> Planted:
    """Write the drive with cars in it, and pictures of whose pixel is whose, each into a folder.

    Args:
        cars: numbered from 1; cache: room for pictures and masks.
    """
    real, views = scene.drive.frames, scene.views
    pixels: Sequence[CarPixels] = cache.frames(len(real), lambda i: see_cars(cars, views.frames[i]))
    for frame, own in zip(real, pixels, strict=True):
        write_image_atomic(numbers_folder / frame.camera_name / f"{frame.name}.png", own.number)
    added = added_labels(scene.drive, scene.labels)
    points = moved_points(scene.drive.points, views, pixels, cars)
    drive = write_holdout_drive(scene.drive, pixels, scene.removed, points, added, drive_folder, progress)
    known = seen_elsewhere(views, pixels, far=FAR_M, cache=cache)
    ground = cache.frames(len(real), lambda i: ground_shown(views.frames[i], scene.street, pixels[i].number > 0))

    def held(i: int) -> HoldoutFrame:
        return HoldoutFrame(real[i], views.frames[i], pixels[i], scene.removed[i], known[i], ground[i])

    return Planted(drive, added, Frames(len(real), held))

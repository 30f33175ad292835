"""What is marked in: a drive that no run has imported yet, or a workspace, with its scene where it is reconstructed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import LARGEST_TEXT
from unveil_core.base.files import read_own_json
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.drives import open_drive
from unveil_core.drives.checks.solved import is_solved
from unveil_core.drives.drive import Drive, Footage, Frame
from unveil_core.drives.imported import CAMERAS, read_imported
from unveil_core.drives.importing.frames import at_work_size, working_camera
from unveil_core.drives.importing.sweeps import gathered
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.drives.photographs import photograph
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.files import known_objects
from unveil_core.workspace.workspace import Workspace, is_workspace

__all__ = ["Opened", "opened"]

WORK_SIDE = 1024
"""Longer side of the pictures in which objects of a drive are outlined, pixels: outlines follow colours to a pixel of these."""
SOLID = 0.5
"""Opacity from which on a surfel is a place of the scene's surface."""


@dataclass(frozen=True, eq=False)
class Opened:
    """What is marked in.

    Attributes:
        drive: its frames undistorted and of working size, its points in their coordinates; each frame has its footage.
        image: gives the picture (H, W, 3) of working size of a frame, by its index.
        surface: positions and normals (S, 3) of the scene, None before it is reconstructed.
        taken: ids that objects have already.
        measured: whether the points were measured; those of ``unveil solve`` were found in photographs.
    """

    drive: Drive
    image: Callable[[int], NDArray[np.uint8]]
    surface: tuple[Float64, Float64] | None
    taken: frozenset[int]
    measured: bool = True


def opened(source: Path, settings: RunSettings, progress: Progress = no_progress) -> Opened:
    """Open a drive, or a workspace that has one imported.

    Args:
        settings: which part of a drive is read, its scale and up; a workspace has its own.
    Raises:
        DriveError, WorkspaceError: there is neither.
    """
    if is_workspace(source):
        return _of_workspace(Workspace.open(source))
    drive = open_drive(source, settings.drive_options)
    placement = place_drive(drive, scale=settings.scale, up=settings.up, camera_height_m=settings.camera_height)
    drive = localized(drive, placement)
    if drive.sweeps:
        drive = replace(drive, points=gathered(drive, progress))
    read = drive.frames
    frames = tuple(_at_work_size(f, settings.work_side or WORK_SIDE) for f in read)

    def image(v: int) -> NDArray[np.uint8]:
        footage = frames[v].footage
        assert footage is not None
        return at_work_size(photograph(read[v]), footage, frames[v].camera)

    return Opened(replace(drive, frames=frames), image, None, frozenset(), _measured(drive.root))


def _at_work_size(frame: Frame, side: int) -> Frame:
    footage = Footage(frame.image_path, frame.camera, frame.distortion)
    return replace(frame, camera=working_camera(frame.camera, side), distortion=None, footage=footage)


def _of_workspace(workspace: Workspace) -> Opened:
    drive = read_imported(workspace.drive_dir)
    frames = tuple(
        f if f.footage is not None else replace(f, footage=Footage(f.image_path, f.camera)) for f in drive.frames
    )
    taken = frozenset(known_objects(workspace) or ())
    surface = None
    if workspace.surfels_full.is_file():
        from unveil_core.surfels.ply import read_surfels  # loads torch

        surfels = read_surfels(workspace.surfels_full)
        solid = surfels.opacity_logits.sigmoid() > SOLID
        surfels = surfels.select(solid)
        surface = surfels.means.double().numpy(), surfels.normals().double().numpy()
    # A reconstructed scene has surfaces where it had no points.
    told = read_own_json(workspace.drive_dir / CAMERAS, LARGEST_TEXT).get("source") or drive.root
    measured = surface is not None or _measured(Path(str(told)))
    return Opened(replace(drive, frames=frames), lambda v: read_image(frames[v].image_path), surface, taken, measured)


def _measured(root: Path) -> bool:
    """Whether the points of a drive, read from a folder or file, were measured."""
    return not is_solved(root)

"""Whether a drive can be used, before any work starts: each problem is one line that names the file and the remedy."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_image, read_instance_image, read_label_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.drive import Drive
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["check_drive"]


def check_drive(drive: Drive, progress: Progress = no_progress) -> None:
    """Decode every file of a drive and compare it with what the drive says of it.

    Raises:
        DriveError: no frames or points, names used twice, a pose that is not rigid, a missing or unreadable image, or an image
            whose size differs from its camera's.
    """
    if not drive.frames:
        why = drive.notices[0] if drive.notices else "a drive needs at least one frame"
        raise DriveError("has no frames", path=drive.root, mend=why)
    if not len(drive.points.positions):
        raise DriveError("has no points", path=drive.root, mend="a drive needs LiDAR or SfM points")
    seen: set[tuple[str, str]] = set()
    for done, frame in enumerate(drive.frames):
        key = (frame.camera_name, frame.name)
        if key in seen:
            raise DriveError(
                f"frame {frame.name} of camera {frame.camera_name} occurs twice",
                path=drive.root,
                mend="file stems must be unique within a camera",
            )
        seen.add(key)
        pose = frame.camera.world_to_camera
        if not np.isfinite(pose).all():
            raise DriveError(
                f"the pose of frame {frame.name} holds NaN or infinity", path=drive.root, mend="redo its pose"
            )
        if nearest_rotation(pose[:3, :3])[1] > 1e-3:
            raise DriveError(f"the pose of frame {frame.name} is no rotation", path=drive.root, mend="poses are rigid")
        wanted = (frame.camera.height, frame.camera.width)
        pictures: list[tuple[Path, Callable[[Path], NDArray[np.generic]]]] = [(frame.image_path, read_image)]
        pictures += [(p, read_label_image) for p in (frame.semantic_path, frame.mask_path) if p is not None]
        pictures += [(frame.instance_path, read_instance_image)] if frame.instance_path is not None else []
        for path, read in pictures:
            found = read(path).shape[:2]
            if found != wanted:
                raise DriveError(
                    f"is {found[1]}x{found[0]} pixels, its camera says {wanted[1]}x{wanted[0]}",
                    path=path,
                    mend="resize the image or correct w and h",
                )
        progress(done + 1, len(drive.frames), "checking files")

"""Whether a drive can be used, before any work starts: each problem is one line that names the file and the remedy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.drive import LATEST_S, Drive, Frame, tracks
from unveil_core.drives.labels.reading import instances_of, mask_of, semantics_of
from unveil_core.drives.photographs import photograph
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["Checked", "check_drive"]

FEWEST_SEEN = 3
"""Photographs of a camera in which points can be found: a depth counts where two neighbours agree on it."""


@dataclass(frozen=True, eq=False)
class Checked:
    """What was seen of the labels while every file was decoded.

    Attributes:
        classes: (F, 256) pixels by trainId of each frame; 0 of one without a picture of classes.
        masked: (F,) share of the pixels that the mask of each frame removes; NaN of one without.
    """

    classes: NDArray[np.int64]
    masked: NDArray[np.float64]


def check_drive(drive: Drive, progress: Progress = no_progress) -> Checked:
    """Decode every file of a drive and compare it with what the drive says of it.

    Raises:
        DriveError: no frames, no points and too few photographs to find some in, names used twice, a pose that is not rigid, a lens
            or time stamp that is none, a missing or unreadable image, or an image whose size differs from its camera's.
    """
    if not drive.frames:
        mend = "; ".join(drive.notices) or "a drive needs at least one frame"
        raise DriveError("has no frames", path=drive.root, mend=mend)
    if not len(drive.points.positions) and not drive.sweeps and max(map(len, tracks(drive))) < FEWEST_SEEN:
        told = [n for n in drive.notices if "LiDAR" in n]
        told.append(f"give LiDAR or SfM points, or {FEWEST_SEEN} photographs of a camera to find some in")
        mend = "; ".join(told)
        raise DriveError("has no points", path=drive.root, mend=mend)
    seen: set[tuple[str, str]] = set()
    classes = np.zeros((len(drive.frames), 256), np.int64)
    masked = np.full(len(drive.frames), np.nan)
    for done, frame in enumerate(drive.frames):
        key = (frame.camera_name, frame.name)
        if key in seen:
            raise DriveError(
                f"frame {frame.name} of camera {frame.camera_name} occurs twice",
                path=drive.root,
                mend="file stems must be unique within a camera",
            )
        seen.add(key)
        _check_pose(frame, drive.root)
        _check_lens(frame, drive.root)
        if frame.timestamp is not None and not abs(frame.timestamp) <= LATEST_S:
            mend = "give seconds, or leave time stamps out"
            raise DriveError(f"Not a time stamp: {frame.timestamp:g} (frame {frame.name})", path=drive.root, mend=mend)
        photograph(frame)
        if frame.semantic_path is not None:
            classes[done] = np.bincount(semantics_of(frame, strict=True).ravel(), minlength=256)
        if frame.mask_path is not None:
            masked[done] = mask_of(frame).mean()
        if frame.instance_path is not None:
            instances_of(frame)
        progress(done + 1, len(drive.frames), "checking files")
    return Checked(classes, masked)


def _check_pose(frame: Frame, root: Path) -> None:
    pose = frame.camera.world_to_camera
    if not np.isfinite(pose).all():
        raise DriveError(f"the pose of frame {frame.name} holds NaN or infinity", path=root, mend="redo its pose")
    if nearest_rotation(pose[:3, :3])[1] > 1e-3:
        raise DriveError(f"Not a rotation: the pose of frame {frame.name}", path=root, mend="poses are rigid")


def _check_lens(frame: Frame, root: Path) -> None:
    camera, bent = frame.camera, () if frame.distortion is None else frame.distortion.coefficients
    if not np.isfinite((camera.fx, camera.fy, camera.cx, camera.cy, *bent)).all():
        raise DriveError(
            f"the lens of frame {frame.name} holds NaN or infinity", path=root, mend="calibrate its camera again"
        )

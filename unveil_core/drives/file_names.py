"""Cameras and frames of a drive have names of files: they become folders and files of the workspace."""

from __future__ import annotations

from dataclasses import replace

from unveil_core.base.checks.names import distinct_file_names
from unveil_core.drives.drive import Drive

__all__ = ["with_file_names"]


def with_file_names(drive: Drive) -> Drive:
    """A drive as read, whose cameras and frames are called so that each name is one file's, whatever its files say."""
    cameras = distinct_file_names([*(f.camera_name for f in drive.frames), *drive.front_cameras])
    by_camera: dict[str, list[str]] = {}
    for frame in drive.frames:
        by_camera.setdefault(frame.camera_name, []).append(frame.name)
    names = {camera: distinct_file_names(own) for camera, own in by_camera.items()}
    if all(a == b for table in (cameras, *names.values()) for a, b in table.items()):
        return drive
    frames = tuple(
        replace(f, camera_name=cameras[f.camera_name], name=names[f.camera_name][f.name]) for f in drive.frames
    )
    key_frames = drive.key_frames
    if key_frames is not None:
        key_frames = frozenset(n for own in names.values() for old, n in own.items() if old in key_frames)
    front = tuple(cameras[name] for name in drive.front_cameras)
    return replace(drive, frames=frames, front_cameras=front, key_frames=key_frames)

"""The frames of a transforms.json, or of several that are parts of one: those whose photographs are there."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.drives.boxes import read_boxes
from unveil_core.drives.checks.conventions import pose_in
from unveil_core.drives.drive import Distortion, Frame
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.drives.formats.nerfstudio.lens import read_lens
from unveil_core.drives.formats.nerfstudio.poses import pose_from_matrix
from unveil_core.drives.formats.nerfstudio.rig import cameras_of
from unveil_core.drives.formats.on_disk.masks import with_masks_beside
from unveil_core.drives.formats.on_disk.pictures import NamedFiles
from unveil_core.drives.formats.on_disk.unread import missing_notice, other_pictures, unread_folders
from unveil_core.drives.travel.cameras import Shot
from unveil_core.drives.travel.names import frame_names
from unveil_core.geometry.camera import Camera

__all__ = ["read_frames"]

Part = tuple[Path, dict[str, Any]]
"""A file and what it holds."""


def read_frames(parts: Sequence[Part], convention: str) -> tuple[list[Frame], list[str]]:
    """The frames in the order of the files, with poses in a convention, and what a user should know of them.

    Raises:
        DriveError: an entry that makes no frame, or no photograph is there.
    """
    source = parts[0][0]
    for path, top in parts:
        for i, entry in enumerate(top["frames"]):
            if not isinstance(entry, dict) or not entry.get("file_path"):
                raise DriveError(f"frame {i} has no file_path", path=path)
            if not isinstance(entry["file_path"], str | int):
                given = str(entry["file_path"])[:40]
                raise DriveError(
                    f"Not the name of a file: file_path of frame {i}: {given!r}", path=path, mend="correct it"
                )
            if PurePosixPath(str(entry["file_path"]).replace("\\", "/")).name in ("", ".."):
                given = str(entry["file_path"])[:40]
                raise DriveError(f"file_path names no file: {given!r}", path=path, mend="correct it")
    files = NamedFiles(source)
    entries = [(path, top, entry) for path, top in parts for entry in top["frames"]]
    images = files.pictures([entry["file_path"] for *_, entry in entries], "file_path")
    named = [(*entry, image) for entry, image in zip(entries, images, strict=True)]
    there = [(path, top, entry, image) for path, top, entry, image in named if image is not None]
    missing = [str(entry["file_path"]) for _, _, entry, image in named if image is None]
    if not there:
        problem = f"none of the {len(missing)} photographs is there, the first {missing[0]}"
        raise DriveError(problem, path=source, mend=files.missing_because(missing[0]))
    shots: list[Shot] = []
    lenses: list[tuple[Camera, Distortion | None]] = []
    for path, top, entry, image in there:
        keys = Keys(entry, top, path, image.stem)
        pose = pose_from_matrix(entry.get("transform_matrix"), path, image.stem)
        camera, distortion = read_lens(keys, image, pose_in(pose, convention))
        lenses.append((camera, distortion))
        shots.append(_shot(image, source.parent, camera, distortion, keys.stamp()))
    guess = cameras_of([entry for _, _, entry, _ in there], shots)
    frames = []
    for (path, top, entry, image), name, camera_name, (camera, distortion), shot in zip(
        there, frame_names(shots, guess.names), guess.names, lenses, shots, strict=True
    ):
        keys = Keys(entry, top, path, name)
        frames.append(
            Frame(
                name=name,
                camera_name=camera_name,
                camera=camera,
                image_path=image,
                distortion=distortion,
                semantic_path=keys.file(files, "semantic_path"),
                instance_path=keys.file(files, "instance_path"),
                mask_path=keys.file(files, "mask_path"),
                depth_path=keys.file(files, "depth_file_path", "depth_path"),
                timestamp=shot.time,
                boxes=read_boxes(entry.get("boxes"), path, name),
            )
        )
    notices = [*files.notices(), *missing_notice(missing, len(named))]
    if not any(f.semantic_path or f.mask_path or f.instance_path or f.boxes for f in frames):
        frames, told = with_masks_beside(frames, source.parent, _folder_of(frames), "mask_path", usual=False)
        notices += told
    notices += other_pictures(frames, "the file names")
    if not missing:  # what belongs to those lies there, too
        notices += [line for line in unread_folders(frames, source.parent) if not _is_told(line, notices)]
    return frames, [*notices, *([] if guess.notice is None else [guess.notice])]


def _folder_of(frames: Sequence[Frame]) -> Path:
    """The folder that holds all photographs, with its folders."""
    folders = {f.image_path.parent for f in frames}
    try:
        return Path(os.path.commonpath(folders))
    except ValueError:  # on several disks
        return next(iter(folders))


def _shot(image: Path, root: Path, camera: Camera, distortion: Distortion | None, time: float | None) -> Shot:
    """A picture with its path within the drive, or as from there."""
    lens = (*camera.intrinsics, *(() if distortion is None else distortion.coefficients))
    path, inside = os.path.splitext(image)[0], f"{root}{os.sep}"
    return Shot(path.removeprefix(inside).replace(os.sep, "/"), tuple(map(float, lens)), camera.camera_to_world, time)


def _is_told(line: str, notices: Sequence[str]) -> bool:
    """Whether a notice is of the same folder."""
    folder = line.partition(" ")[0]
    return any(folder in told for told in notices)

"""A drive of a COLMAP model with its pictures and, where there are such, masks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.drives.checks.conventions import WORLD_TO_CAMERA
from unveil_core.drives.drive import Distortion, Drive, Frame
from unveil_core.drives.formats.colmap.models import chosen_model, model_folders
from unveil_core.drives.formats.on_disk.masks import with_masks_beside
from unveil_core.drives.formats.on_disk.pictures import NamedFiles
from unveil_core.drives.formats.on_disk.unread import missing_notice, other_pictures
from unveil_core.drives.travel.cameras import Shot, guessed_cameras
from unveil_core.drives.travel.names import frame_names
from unveil_core.geometry.camera import Camera

__all__ = ["read_colmap"]

DECIDES = "a transforms.json with the key camera"
"""What says which camera took a picture, where a model's own guess is wrong."""
INPUTS = ("images", "Images", "input", "image", "rgb")
"""Folders of photographs, beside a model, the likelier first: 3D Gaussian splatting calls it ``input``."""


def read_colmap(path: Path, model: str | None = None) -> Drive:
    """Read a COLMAP model with its images and, where present, masks.

    Images lie in ``images/`` of the folder that holds the model, masks in ``masks/NAME.png`` or ``masks/STEM.png`` (0 = remove), or
    under names that are like these. The model knows neither scale nor up.

    Args:
        path: of the model, or of the folder that holds it; model: which of several, see :func:`chosen_model`.
    Raises:
        DriveError: with the file and the mend. SettingsError: there is no such model.
    """
    folders = model_folders(path)
    if not folders:
        raise DriveError(
            "holds no COLMAP model", path=path, mend="sparse/0 with cameras, images and points3D is looked for"
        )
    root, pictures = _pictures_beside(path)
    read, notices = chosen_model(path, folders, model, lambda names: _how_many(names, folders[0], pictures))
    folder = read.folders[0]
    if not read.images:
        raise DriveError("has no images", path=folder, mend="a drive needs at least one frame")
    if pictures.name.lower() != INPUTS[0]:
        notices.append(f"no folder images/: pictures come from {pictures.name}/")
    named = NamedFiles(folder, pictures)
    shots: list[Shot] = []
    found: list[tuple[Path, Camera, Distortion | None]] = []
    missing = []
    places = named.pictures([image.name for image, *_ in read.images], "an image's name")
    for (image, lens, source), place in zip(read.images, places, strict=True):
        if lens is None:
            raise DriveError(f"Not found: camera {image.camera} of image {image.name}", path=source)
        if not Path(image.name).name:
            raise DriveError(f"an image's name is none of a file: {image.name[:40]!r}", path=source, mend="correct it")
        if place is None:
            missing.append(image.name)
            continue
        (fx, fy, cx, cy), distortion = lens.split()
        camera = Camera(lens.width, lens.height, fx, fy, cx, cy, image.world_to_camera)
        found.append((place, camera, distortion))
        shots.append(_shot(place, pictures, camera, distortion))
    if not found:
        problem = f"none of the {len(missing)} pictures of the model is there, the first {missing[0]}"
        raise DriveError(problem, path=pictures, mend=named.missing_because(missing[0]))
    guess = guessed_cameras(shots, DECIDES, whole_folders=True)
    frames = [
        Frame(name=name, camera_name=camera_name, camera=camera, image_path=place, distortion=distortion)
        for name, camera_name, (place, camera, distortion) in zip(
            frame_names(shots, guess.names), guess.names, found, strict=True
        )
    ]
    frames, told = with_masks_beside(frames, root, pictures, "a transforms.json with mask_path", usual=True)
    notices += [*named.notices(), *missing_notice(missing, len(read.images)), *told]
    notices += other_pictures(frames, "the model has poses of", pictures)
    notices += [] if guess.notice is None else [guess.notice]
    return Drive(
        root=path,
        frames=tuple(frames),
        points=read.points,
        units_per_metre=None,
        scale_source="",
        up=None,
        up_source="",
        truth_root=root / "truth" if (root / "truth").is_dir() else None,
        sources=tuple(
            sorted(p for f in read.folders for p in f.iterdir() if p.stem in ("cameras", "images", "points3D"))
        ),
        notices=tuple(notices),
        pose_convention=WORLD_TO_CAMERA,
    )


def _pictures_beside(path: Path) -> tuple[Path, Path]:
    """The folder that a model belongs to, and that of its pictures."""
    for name in INPUTS:
        root = path
        while not (root / name).is_dir() and root != root.parent and root != path.parent.parent.parent:
            root = root.parent
        if (root / name).is_dir():
            return root, root / name
    raise DriveError(
        "has no folder images/ beside its model", path=path, mend="put the photographs there, as the model names them"
    )


def _how_many(names: Sequence[str], folder: Path, pictures: Path) -> int:
    """Of the pictures that a model names those that are there."""
    return sum(p is not None for p in NamedFiles(folder, pictures).pictures(names, "an image's name"))


def _shot(place: Path, pictures: Path, camera: Camera, distortion: Distortion | None) -> Shot:
    inside = os.path.splitext(place)[0].removeprefix(f"{pictures}{os.sep}").replace(os.sep, "/")
    lens = (*camera.intrinsics, *(() if distortion is None else distortion.coefficients))
    return Shot(inside, tuple(map(float, lens)), np.asarray(camera.camera_to_world))

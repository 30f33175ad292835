# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a shot: where one may lie, and the one way to write it. No bpy here."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..files import is_link
from ..open_safely import LARGEST_TEXT, json_in
from ..writing.new_files import GENERATOR, NewFiles, new_files

__all__ = ["CAMERAS", "POINTS", "NoPlace", "check_place", "shot_folder"]

CAMERAS, POINTS, PICTURES = "transforms.json", "points.ply", "images/*.png"
DRIVES = (
    *(CAMERAS, "transforms_train.json", "transforms_val.json", "transforms_test.json", "workspace.json"),
    *("sparse/0", "points3D.bin", "points3D.txt", "scenario.pt", "pointcloud.npz", "city_SE3_egovehicle.feather"),
    *("oxts/data", "image_2", "image_02/data", "data_2d_raw", "lidar/poses.json", "v1.0-mini", "v1.0-trainval"),
    *("ego_pose", "vehicle_pose", "camera_image"),
)
"""Files and folders of which a drive of the known formats, or a workspace, has one."""
MEND = "name a folder of its own"


class NoPlace(ValueError):
    """No shot is written there, whatever is to be replaced; one line that names the folder."""


def check_place(folder: Path) -> None:
    """Check a folder for a shot, which need not be there yet.

    Args:
        folder: absolute.
    Raises:
        NoPlace: it is the root of a disk, the home folder or one that holds it, or a drive that was not made of a shot; or it lies
            in a drive.
    """
    place = folder.resolve()
    if place.parent == place:
        raise NoPlace(f"{folder}: Not for a shot: the root of a disk ({MEND})")
    with suppress(RuntimeError, OSError):  # there is no home
        if Path.home().resolve().is_relative_to(place):
            raise NoPlace(f"{folder}: Not for a shot: the home folder, or one that holds it ({MEND})")
    if is_link(folder) and not folder.exists():
        raise NoPlace(f"{folder}: Not for a shot: a link to nothing (remove the link)")
    if _is_drive(place) and not _is_shot(place):
        raise NoPlace(f"{folder}: Not for a shot: a drive, or a workspace ({MEND})")
    around = next((above for above in place.parents if _is_drive(above)), None)
    if around is not None:
        raise NoPlace(f"{folder}: Not for a shot: it lies in {around}, a drive or a workspace ({MEND})")


@contextmanager
def shot_folder(folder: Path, *, mend: str, replace: bool = False) -> Iterator[NewFiles]:
    """Write a shot: see :func:`new_files`.

    Raises:
        NoPlace: see :func:`check_place`. Somebodys, OSError: see :func:`new_files`.
    """
    check_place(folder)
    with new_files(folder, (CAMERAS, POINTS, PICTURES), mend=mend, replace=replace) as files:
        yield files


def _is_drive(folder: Path) -> bool:
    return any((folder / name).exists() for name in DRIVES)


def _is_shot(folder: Path) -> bool:
    """Whether all that tells a drive in a folder is the file that a shot has."""
    if any((folder / name).exists() for name in DRIVES if name != CAMERAS):
        return False
    with suppress(OSError, ValueError):
        content = json_in(folder / CAMERAS, LARGEST_TEXT)
        return isinstance(content, dict) and content.get("generator") == GENERATOR
    return False

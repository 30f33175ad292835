"""Importing a drive into a workspace: undistorted, in metres with z up, in one known layout.

    images/<camera>/<frame>.(png|jpg)  semantics/  instances/  masks/   points.ply   cameras.json

Coordinates are brought to metres, z up and an origin amid the cameras by one similarity in float64, which is kept. Undistorting
and resizing happen where needed, otherwise the original files are linked.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import (
    link_or_copy,
    read_image,
    read_instance_image,
    read_label_image,
    write_image_atomic,
    write_json_atomic,
)
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.check import check_drive
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.drives.points import write_points
from unveil_core.drives.scale_and_up import Placement, place_drive
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.label_images import resize_labels

__all__ = ["import_drive", "localized"]


def localized(drive: Drive, placement: Placement | None = None) -> Drive:
    """The drive in metres, with z up, and its origin amid the cameras, at whole metres.

    A drive that has metres and z up is shifted and nothing else. Subtraction happens in float64 between numbers of like size,
    so nothing is lost beyond the coordinates' own rounding.

    Args:
        drive: as read from disk.
        placement: its scale and up; None = as :func:`place_drive` finds them.
    """
    placement = placement or place_drive(drive)
    turned = placement.to_world
    middle = turned.to_local(np.mean([f.camera.centre for f in drive.frames], axis=0))
    step = replace(turned, translation=turned.to_world(np.round(middle)))
    frames = tuple(
        replace(f, camera=step.camera_to_local(f.camera), boxes=tuple(b.to_local(step) for b in f.boxes))
        for f in drive.frames
    )
    points = replace(drive.points, positions=step.to_local(drive.points.positions))
    return replace(
        drive,
        frames=frames,
        points=points,
        to_world=drive.to_world.after(step),
        units_per_metre=1.0,
        scale_source=placement.scale_source,
        up=UP,
        up_source=placement.up_source,
    )


def _maps(frame: Frame, target: Camera) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """cv2.remap look-ups from the undistorted, possibly smaller picture to the file on disk."""
    source, distortion = frame.camera, frame.distortion
    assert distortion is not None
    # OpenCV counts from the centre of the first pixel, we from its edge.
    k_source = np.array([[source.fx, 0, source.cx - 0.5], [0, source.fy, source.cy - 0.5], [0, 0, 1]])
    k_target = np.array([[target.fx, 0, target.cx - 0.5], [0, target.fy, target.cy - 0.5], [0, 0, 1]])
    coefficients = np.array(distortion.coefficients, dtype=np.float64)
    size = (target.width, target.height)
    if distortion.model == "OPENCV_FISHEYE":
        return cv2.fisheye.initUndistortRectifyMap(k_source, coefficients, np.eye(3), k_target, size, cv2.CV_32FC1)
    return cv2.initUndistortRectifyMap(k_source, coefficients, np.eye(3), k_target, size, cv2.CV_32FC1)


def _warp(picture: NDArray[Any], frame: Frame, target: Camera, *, label: bool, border: int) -> NDArray[Any]:
    """A picture of the frame as the target camera sees it."""
    if frame.distortion is None:
        return _resized(picture, target, label=label)
    # Shrinking through remap would alias; undistort at full size first, then shrink.
    full = frame.camera
    mode = cv2.INTER_NEAREST if label else cv2.INTER_CUBIC
    flat = cv2.remap(picture, *_maps(frame, full), mode, borderMode=cv2.BORDER_CONSTANT, borderValue=(border,) * 3)
    return _resized(flat, target, label=label)


def _resized(picture: NDArray[Any], target: Camera, *, label: bool) -> NDArray[Any]:
    size = (target.width, target.height)
    if picture.shape[:2] == size[::-1]:
        return picture
    return resize_labels(picture, size) if label else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _read_mask(path: Path) -> NDArray[np.uint8]:
    """(H, W) uint8, 0 = remove and 255 for all else: greys of a soft border would share its votes."""
    return np.where(read_label_image(path) == 0, 0, 255).astype(np.uint8)


def import_drive(
    drive: Drive,
    destination: Path,
    *,
    max_side: int | None = None,
    placement: Placement | None = None,
    progress: Progress = no_progress,
) -> Drive:
    """Check a drive and write it to ``destination``, which appears whole or not at all.

    Args:
        drive: as read from disk.
        destination: the folder to make; it must not exist or is replaced.
        max_side: longer image side that larger images are reduced to, pixels; None keeps them.
        placement: scale and up of the drive; None = as :func:`place_drive` finds them.
    Returns:
        the imported drive, as :func:`read_imported` gives it.
    Raises:
        DriveError: see :func:`check_drive`.
    """
    check_drive(drive, progress)
    drive = localized(drive, placement)
    partial = destination.with_name(f".{destination.name}.partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        partial.mkdir(parents=True)
        entries = []
        for done, frame in enumerate(drive.frames):
            entries.append(_import_frame(frame, partial, max_side))
            progress(done + 1, len(drive.frames), "importing")
        write_points(drive.points, partial / "points.ply")
        write_json_atomic(
            partial / "cameras.json",
            {
                "source": str(drive.root),
                "to_world": drive.to_world.to_json(),
                "scale_source": drive.scale_source,
                "up_source": drive.up_source,
                "semantic_classes": drive.semantic_classes,
                "truth_root": None if drive.truth_root is None else str(drive.truth_root.resolve()),
                "frames": entries,
            },
        )
        shutil.rmtree(destination, ignore_errors=True)
        partial.rename(destination)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return read_imported(destination)


def _import_frame(frame: Frame, folder: Path, max_side: int | None) -> dict[str, object]:
    camera = frame.camera
    factor = 1.0 if max_side is None else min(1.0, max_side / max(camera.width, camera.height))
    size = (max(1, round(camera.width * factor)), max(1, round(camera.height * factor)))
    target = camera if factor == 1.0 else camera.resized(*size)
    changed = frame.distortion is not None or factor != 1.0
    suffix = frame.image_path.suffix.lower()
    if changed or suffix not in (".png", ".jpg", ".jpeg"):
        suffix = ".png"
    entry: dict[str, object] = {
        "name": frame.name,
        "camera": frame.camera_name,
        "width": target.width,
        "height": target.height,
        "fx": target.fx,
        "fy": target.fy,
        "cx": target.cx,
        "cy": target.cy,
        "world_to_camera": target.world_to_camera.tolist(),
        "timestamp": frame.timestamp,
    }
    if frame.boxes:
        entry["boxes"] = [box.to_json() for box in frame.boxes]
    kinds = (
        ("image", "images", frame.image_path, suffix, read_image, False, 0),
        ("semantics", "semantics", frame.semantic_path, ".png", read_label_image, True, 255),
        ("instances", "instances", frame.instance_path, ".png", read_instance_image, True, 0),
        ("mask", "masks", frame.mask_path, ".png", _read_mask, True, 255),
    )
    for key, place, path, ending, read, label, border in kinds:
        if path is None:
            continue
        relative = f"{place}/{frame.camera_name}/{frame.name}{ending}"
        if changed or (label and path.suffix.lower() != ".png"):
            picture = read(path)  # type: ignore[operator]
            warped = _warp(picture, frame, target, label=label, border=border) if changed else picture
            write_image_atomic(folder / relative, warped)
        else:
            link_or_copy(path, folder / relative)
        entry[key] = relative
    return entry

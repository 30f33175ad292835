"""One frame on its way into a workspace: undistorted and reduced to the working size, its labels with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.output.copies import copied_or_linked
from unveil_core.base.pictures.levels import as_words
from unveil_core.drives.drive import Distortion, Footage, Frame, FrameLabels
from unveil_core.drives.labels.codes import InstanceCode, MaskCode
from unveil_core.drives.labels.reading import can_stay, instances_of, mask_of, semantics_of
from unveil_core.drives.photographs import is_plain, photograph_levels, store_photograph
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.label_images import resize_labels
from unveil_core.geometry.lens import FISHEYE

__all__ = ["at_work_size", "distortion_maps", "import_frame", "labels_at_work_size", "pose_and_boxes", "working_camera"]

KEPT_LENSES = 4
"""Lenses whose look-ups are kept, 8 bytes a pixel: the pictures and labels of all frames of a camera share one."""


def distortion_maps(
    source: Camera, distortion: Distortion, target: Camera
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """cv2.remap look-ups from an undistorted picture to the file on disk.

    Args:
        source: camera of the file; distortion: of its lens; target: camera of the undistorted picture.
    Returns:
        columns and rows (H, W) of the file's pixels, counted from the centre of the first.
    """
    return _maps_of_lens(source.intrinsics, distortion, target.intrinsics)


@lru_cache(maxsize=KEPT_LENSES)
def _maps_of_lens(
    from_numbers: tuple[float, ...], distortion: Distortion, to_numbers: tuple[float, ...]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """See :func:`distortion_maps`; cameras by their numbers, for they are the same with any pose."""
    (_, _, *source), (width, height, *target) = from_numbers, to_numbers
    # OpenCV counts from the centre of the first pixel, we from its edge.
    k_source, k_target = (
        np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]) for fx, fy, cx, cy in (source, target)
    )
    coefficients = np.array(distortion.coefficients, dtype=np.float64)
    model = cv2.fisheye if distortion.model == FISHEYE else cv2
    return model.initUndistortRectifyMap(
        k_source, coefficients, np.eye(3), k_target, (int(width), int(height)), cv2.CV_32FC1
    )


def _numbers(camera: Camera) -> dict[str, float]:
    """Size and intrinsics as cameras.json has them."""
    return dict(zip(("width", "height", "fx", "fy", "cx", "cy"), camera.intrinsics, strict=True))


def working_camera(camera: Camera, work_side: int | None) -> Camera:
    """The camera reduced so that its longer side is ``work_side`` at most; itself where it is no larger."""
    factor = 1.0 if work_side is None else min(1.0, work_side / max(camera.width, camera.height))
    size = (max(1, round(camera.width * factor)), max(1, round(camera.height * factor)))
    return camera if factor == 1.0 else camera.resized(*size)


def _warp(
    picture: NDArray[Any], camera: Camera, distortion: Distortion | None, target: Camera, *, label: bool, border: int
) -> NDArray[Any]:
    """A picture of a camera with a lens as the target camera sees it."""
    if distortion is None:
        return _resized(picture, target, label=label)
    # Shrinking through remap would alias; undistort at full size first, then shrink.
    mode = cv2.INTER_NEAREST if label else cv2.INTER_CUBIC
    maps = distortion_maps(camera, distortion, camera)
    flat = cv2.remap(picture, *maps, mode, borderMode=cv2.BORDER_CONSTANT, borderValue=(border,) * 3)
    return _resized(flat, target, label=label)


def at_work_size(picture: NDArray[np.uint8], footage: Footage, camera: Camera) -> NDArray[np.uint8]:
    """A picture (H, W, 3) of a footage's size and lens as the frame's camera sees it, as import makes photographs.

    Args:
        camera: of the frame, of working size.
    """
    return _warp(picture, footage.camera, footage.distortion, camera, label=False, border=0)


def _resized(picture: NDArray[Any], target: Camera, *, label: bool) -> NDArray[Any]:
    size = (target.width, target.height)
    if picture.shape[:2] == size[::-1]:
        return picture
    return resize_labels(picture, size) if label else cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def _read_mask(frame: Frame) -> NDArray[np.uint8]:
    """(H, W) uint8, 0 = remove and 255 for all else: greys of a soft border would share its votes."""
    return np.where(mask_of(frame), 0, 255).astype(np.uint8)


def labels_at_work_size(frame: Frame | Footage, found: FrameLabels, target: Camera) -> FrameLabels:
    """Labels of a photograph as the target camera sees them.

    Args:
        frame: as read, or its footage: size and lens of the file; found: of that size.
    """
    lens = (frame.camera, frame.distortion)
    ego = None if found.ego is None else _warp(found.ego.astype(np.uint8), *lens, target, label=True, border=0) > 0
    instance = None if found.instance is None else _warp(found.instance, *lens, target, label=True, border=0)
    return FrameLabels(_warp(found.semantic, *lens, target, label=True, border=255), instance, ego)


def import_frame(frame: Frame, folder: Path, work_side: int | None) -> dict[str, object]:
    """Write the pictures of a frame, in local coordinates, into ``folder``. A file that is there already stays: an interrupted
    import left it.

    Returns:
        its entry in cameras.json.
    Raises:
        DriveError: a file that cannot be read.
    """
    target = working_camera(frame.camera, work_side)
    warped = frame.distortion is not None or target is not frame.camera
    suffix = frame.image_path.suffix.lower()
    kept = not warped and is_plain(frame)
    stem = f"{frame.camera_name}/{frame.name}"
    image = f"images/{stem}{suffix if kept else '.png'}"
    entry: dict[str, object] = {
        "name": frame.name,
        "camera": frame.camera_name,
        **_numbers(target),
        **pose_and_boxes(frame),
        "timestamp": frame.timestamp,
        "image": image,
    }

    def unless_there(relative: str, put: Callable[[Path], None]) -> None:
        if not (folder / relative).is_file():
            put(folder / relative)

    def warp(picture: NDArray[Any], *, border: int, label: bool = True) -> NDArray[Any]:
        return _warp(picture, frame.camera, frame.distortion, target, label=label, border=border)

    def put_photograph(path: Path) -> None:
        store_photograph(frame, path)

    if kept:
        unless_there(image, put_photograph)
    else:

        def put_warped(path: Path) -> None:
            seen = warp(photograph_levels(frame), border=0, label=False)
            write_image_atomic(path, seen if seen.dtype == np.uint8 else as_words(seen), like=frame.image_path)

        unless_there(image, put_warped)
    if frame.footage is not None:  # the drive was imported before
        source = frame.footage.path
        relative = f"footage/{stem}{source.suffix.lower()}"
        entry["footage"] = _footage(frame.footage, relative)
        unless_there(relative, lambda path: copied_or_linked(source, path))
    elif not kept:
        relative = f"footage/{stem}{suffix}"
        entry["footage"] = _footage(Footage(frame.image_path, frame.camera, frame.distortion, frame.plate), relative)
        unless_there(relative, put_photograph)
    codes = frame.codes
    kinds = (
        ("semantics", "semantics", frame.semantic_path, semantics_of, 255, (8,) * codes.semantic.is_plain),
        ("instances", "instances", frame.instance_path, instances_of, 0, (8, 16) * (codes.instance == InstanceCode())),
        ("mask", "masks", frame.mask_path, _read_mask, 255, (8,) * (codes.mask == MaskCode())),
    )
    for key, place, found, read, border, bits in kinds:
        if found is None:
            continue

        def put_labels(
            path: Path,
            found: Path = found,
            read: Callable[[Frame], NDArray[Any]] = read,
            border: int = border,
            bits: tuple[int, ...] = bits,
        ) -> None:
            if warped:
                write_image_atomic(path, warp(read(frame), border=border), like=found)
            elif can_stay(found, frame, *bits):  # as it is kept here, too
                copied_or_linked(found, path)
            else:
                write_image_atomic(path, read(frame), like=found)

        entry[key] = f"{place}/{stem}.png"
        unless_there(f"{place}/{stem}.png", put_labels)
    if frame.ego_rows:
        ego = np.zeros((frame.camera.height, frame.camera.width), np.uint8)
        ego[-frame.ego_rows :] = 255
        entry["ego"] = f"ego/{stem}.png"
        unless_there(f"ego/{stem}.png", lambda path: write_image_atomic(path, warp(ego, border=0)))
    return entry


def pose_and_boxes(frame: Frame) -> dict[str, object]:
    """What of a frame's entry in cameras.json lies in the drive's coordinates."""
    boxes = {"boxes": [box.to_json() for box in frame.boxes]} if frame.boxes else {}
    return {"world_to_camera": frame.camera.world_to_camera.tolist(), **boxes}


def _footage(footage: Footage, relative: str) -> dict[str, object]:
    """The entry in cameras.json of the file that a frame is delivered as, at ``relative``."""
    lens = footage.distortion
    return {
        "image": relative,
        **_numbers(footage.camera),
        "distortion": None if lens is None else {"model": lens.model, "coefficients": list(lens.coefficients)},
        **({} if footage.plate is None else {"plate": footage.plate.to_json()}),
    }

"""Pictures of labels to look at: the photograph under colours of classes, outlines and ids of objects, and boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.evenly import evenly
from unveil_core.base.files import write_image_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Drive, Frame, FrameLabels
from unveil_core.drives.labels.reading import instances_of, semantics_of
from unveil_core.labelling.object_points import REMOVABLE_IDS
from unveil_core.semantics.classes import COLORS

__all__ = ["preview", "preview_frames", "write_preview"]

MOST_FRAMES = 40
"""So many pictures are looked through; of longer drives every so many frames one."""
STREET_SHARE, OBJECT_SHARE = 0.35, 0.55
"""Of the colour of a class over the photograph: what is removed stands out."""
WIDTH_PX = 1280
"""Smaller photographs are enlarged about to this width, so that ids can be read."""
WHITE, YELLOW = (255, 255, 255), (255, 255, 0)
EDGES = [(i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j) in (1, 2, 4)]


def preview_frames(drive: Drive) -> list[int]:
    """Indices of the frames of which pictures are made: all, or so many evenly chosen ones."""
    return evenly(len(drive.frames), MOST_FRAMES)


def write_preview(
    drive: Drive,
    folder: Path,
    progress: Progress = no_progress,
    labels: Callable[[int], FrameLabels | None] | None = None,
) -> list[Path]:
    """Write a JPEG for each chosen frame.

    Args:
        drive: localized, its frames undistorted and of the size of their files.
        folder: where to; made if need be.
        labels: gives those of a frame by its index; None = as the frames' own files have them.
    Returns:
        the pictures, ``<camera>_<frame>.jpg``.
    Raises:
        DriveError: a picture that cannot be read.
        SettingsError: something else lies in the folder under the name of one.
    """
    read = labels or (lambda i: _own_labels(drive.frames[i]))
    chosen = preview_frames(drive)
    names = [f"{_safe(f.camera_name)}_{_safe(f.name)}.jpg" for f in (drive.frames[i] for i in chosen)]
    with OwnFolder(folder, mend="move it") as own:
        own.check(names)
        own.begin_anew()
        for done, (i, name) in enumerate(zip(chosen, names, strict=True)):
            frame = drive.frames[i]
            drawn = preview(read_image(frame.image_path), frame, read(i))
            write_image_atomic(own.new / name, drawn, like=frame.image_path)
            progress(done + 1, len(chosen), "drawing labels")
        own.exchange()
    return [folder / name for name in names]


def preview(image: NDArray[np.uint8], frame: Frame, labels: FrameLabels | None) -> NDArray[np.uint8]:
    """A photograph (H, W, 3) with its labels and boxes drawn over it, as large or several times as large."""
    picture = image.astype(np.float32)
    if labels is not None:
        known = labels.semantic < len(CITYSCAPES)
        color = np.asarray(COLORS, np.float32)[np.where(known, labels.semantic, 0)]
        share = np.where(np.isin(labels.semantic, REMOVABLE_IDS), OBJECT_SHARE, STREET_SHARE) * known
        picture += (color - picture) * share[..., None]
    times = max(1, round(WIDTH_PX / image.shape[1]))
    size = (image.shape[1] * times, image.shape[0] * times)
    drawn = cv2.resize(picture.round().astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    _draw_boxes(drawn, frame, times)
    if labels is not None and labels.instance is not None:
        _draw_instances(drawn, labels.instance, times)
    return drawn


def _own_labels(frame: Frame) -> FrameLabels | None:
    if frame.semantic_path is None:
        return None if frame.labels is None else frame.labels()
    return FrameLabels(semantics_of(frame), None if frame.instance_path is None else instances_of(frame))


def _draw_boxes(picture: NDArray[np.uint8], frame: Frame, times: int) -> None:
    for box in frame.boxes:
        pixel, depth = frame.camera.project(box.corners())
        if (depth <= 0.1).any():
            continue
        ends: Sequence[tuple[int, int]] = [(int(x), int(y)) for x, y in (pixel * times).clip(-30000, 30000)]
        for i, j in EDGES:
            cv2.line(picture, ends[i], ends[j], YELLOW, 1, cv2.LINE_AA)


def _draw_instances(picture: NDArray[np.uint8], instance: NDArray[np.uint16], times: int) -> None:
    for number in np.unique(instance[instance > 0]):
        own = (instance == number).astype(np.uint8)
        x, y, width, height = cv2.boundingRect(own)
        large = np.kron(own[y : y + height, x : x + width], np.ones((times, times), np.uint8))
        found, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x * times, y * times))
        cv2.drawContours(picture, found, -1, WHITE, 1)
        place = (x * times + 2, (y + height // 2) * times)
        cv2.putText(picture, str(number), place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, WHITE, 1, cv2.LINE_AA)


def _safe(name: str) -> str:
    """A part of a file name: names of frames never become paths by themselves."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)

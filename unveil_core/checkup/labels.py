"""The labels of three photographs, made as an import makes them: in a folder that is gone afterwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Picture
from unveil_core.checkup.points import nearest_sweeps
from unveil_core.drives.drive import Drive, Frame, FrameLabels
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.labels.reading import instances_of, mask_of, semantics_of
from unveil_core.drives.scale_and_up import Placement
from unveil_core.labelling.object_points import REMOVABLE_IDS
from unveil_core.labelling.preview import preview
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.steps.import_ import labels_of

__all__ = ["LabelPicture", "label_pictures"]

PLACES = (1 / 6, 1 / 2, 5 / 6)
"""Which of all frames are shown, one of them replaced by that of which most can be removed."""
SIDE_PX = 640
"""Longer side at which they are labelled."""
SWEEPS = 2
"""Nearest to each of them, that are read: an import reads all, and sees more."""
REMOVED = np.array((230, 60, 60), np.float32)
"""Over what a mask removes, sRGB."""


@dataclass(frozen=True, eq=False)
class LabelPicture:
    """A photograph with its labels.

    Attributes:
        picture: (H, W, 3). camera, frame: its names.
        removed: share of it that is of classes removed by default, or that its mask removes; None where nothing labels it.
    """

    picture: Picture
    camera: str
    frame: str
    removed: float | None


def label_pictures(
    drive: Drive, placement: Placement, settings: RunSettings, scratch: Path, fullest: Frame | None = None
) -> list[LabelPicture]:
    """Three photographs of a drive as read, labelled as an import with these settings would.

    Args:
        scratch: an empty folder.
        fullest: the frame of which most can be removed, where that is known: it is one of the three.
    Raises:
        UnveilError: see ``import_drive`` and the ways to label.
    """
    count = len(drive.frames)
    chosen = {min(int(p * count), count - 1) for p in PLACES}
    most = next((k for k, f in enumerate(drive.frames) if f is fullest), None)
    if most is not None and most not in chosen:
        chosen = {most, *sorted(chosen, key=lambda k: abs(k - most))[1:]}  # in the place of the one nearest to it
    frames = tuple(drive.frames[k] for k in sorted(chosen))
    near = {id(s): s for f in frames for s in nearest_sweeps(drive, f, SWEEPS)}
    part = replace(drive, frames=frames, sweeps=tuple(s for s in drive.sweeps if id(s) in near))
    imported = import_drive(part, scratch / "drive", work_side=SIDE_PX, placement=placement)
    found, source = labels_of(part, imported, settings)
    pictures = []
    for k, frame in enumerate(imported.frames):
        labels = found[k] if found is not None else _own(frame) if source == "drive" else None
        image = read_image(frame.image_path)
        if labels is None and frame.mask_path is not None and source == "drive":
            pictures.append(_masked(image, frame))
            continue
        share = None if labels is None else float(np.isin(labels.semantic, REMOVABLE_IDS).mean())
        pictures.append(LabelPicture(preview(image, frame, labels), frame.camera_name, frame.name, share))
    return pictures


def _own(frame: Frame) -> FrameLabels | None:
    if frame.semantic_path is None:
        return None
    return FrameLabels(semantics_of(frame), None if frame.instance_path is None else instances_of(frame))


def _masked(image: Picture, frame: Frame) -> LabelPicture:
    gone = mask_of(frame)
    shown = image.astype(np.float32)
    shown[gone] += 0.6 * (REMOVED - shown[gone])
    return LabelPicture(shown.round().astype(np.uint8), frame.camera_name, frame.name, float(gone.mean()))

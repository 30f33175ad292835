"""Which part of a drive is asked for. Importing this loads no NumPy: the command line's grammar uses it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from unveil_core.base.errors import SettingsError

__all__ = [
    "ALL_SWEEPS",
    "KEY_SWEEPS",
    "LABEL_CLASSES",
    "MASK_REMOVES",
    "POSE_CONVENTIONS",
    "DriveOptions",
    "frame_numbers",
    "frame_range",
]

ALL_SWEEPS, KEY_SWEEPS = "all", "key"
LABEL_CLASSES = (
    "cityscapes", "cityscapes-ids", "cityscapes-colours", "ade20k", "ade20k-from-1", "ade20k-colours", "mapillary", "carla",
    "coco", "voc", "waymo", "waymo-28",
)  # fmt: skip
"""What pictures of classes may hold, by name; ``drives.labels.orders`` has the numbers, ``drives.labels.colours`` the colours."""
MASK_REMOVES = ("black", "white")
POSE_CONVENTIONS = ("opengl", "opencv", "world-to-camera", "world-to-camera-opengl")
"""What a matrix of a pose may be: camera to world with axes x right, y up, z back (nerfstudio, Blender) or x right, y down, z
forward; world to camera with the latter (COLMAP) or the former."""


@dataclass(frozen=True)
class DriveOptions:
    """What to read of a drive.

    Attributes:
        scene: which drive of a folder that holds several (a nuScenes scene, a Waymo segment, a KITTI-360 or odometry sequence).
        cameras: names of cameras, ("all",) for every one; none = the dataset's front camera, all where it has no such.
        frames: "A:B:STEP" as in Python, counted in each camera's order of time, several with commas between; None for all.
        sweeps: "all"; "key", only those of annotated frames, and only such frames; or a number N, each N-th sweep.
        model: which of several COLMAP models: the name of its folder; several with commas between, or "all", join those that share
            pictures; None = the largest.
        labels: path of a folder of label pictures in the place of the drive's own, see ``drives.labels.folders``; None = none.
        instance_maps: path of a folder of instance maps, likewise.
        label_classes: what pictures of classes hold, one of ``drives.labels.codes.LABEL_CLASSES``; None = as their values tell.
        mask_removes: "black" or "white", which of a mask is removed; None = black, as nerfstudio and COLMAP have it.
        pose_convention: what the matrices of poses are, one of ``POSE_CONVENTIONS``; None = what is the format's habit.

    Raises:
        SettingsError: frames that are no range, unknown sweeps, or a model without a name.
    """

    scene: str | None = None
    cameras: tuple[str, ...] = ()
    frames: str | None = None
    sweeps: str = ALL_SWEEPS
    labels: str | None = None
    model: str | None = None
    instance_maps: str | None = None
    label_classes: str | None = None
    mask_removes: str | None = None
    pose_convention: str | None = None

    def __post_init__(self) -> None:
        if self.frames is not None:
            frame_numbers(self.frames, 0)
        if self.sweeps not in (ALL_SWEEPS, KEY_SWEEPS) and not re.fullmatch(r"0*[1-9]\d{0,8}", self.sweeps, re.ASCII):
            raise SettingsError(
                f"Not a choice of sweeps: {self.sweeps!r}", mend="use all, key, or a number N for each N-th"
            )
        if self.model is not None and not all(part.strip() for part in self.model.split(",")):
            raise SettingsError(
                f"Not a model: {self.model!r}", mend="use the name of its folder, as 1, or several as 1,2, or all"
            )
        for name, given, known in (
            ("label_classes", self.label_classes, LABEL_CLASSES),
            ("mask_removes", self.mask_removes, MASK_REMOVES),
            ("pose_convention", self.pose_convention, POSE_CONVENTIONS),
        ):
            if given is not None and given not in known:
                raise SettingsError(f"Not a choice of {name}: {given!r}", mend=f"use one of {', '.join(known)}")


def frame_numbers(text: str, count: int) -> list[int]:
    """Of so many frames the numbers, rising, of those that "A:B:STEP" means, or several of these with commas between.

    Raises:
        SettingsError: it is none.
    """
    return sorted({i for part in text.split(",") for i in range(count)[frame_range(part)]})


def frame_range(text: str) -> slice:
    """The slice that "A:B:STEP" means; "7" is that frame alone.

    Raises:
        SettingsError: it is none.
    """
    parts = text.split(":")
    try:
        numbers = [int(p) if p.strip() else None for p in parts]
    except ValueError:
        numbers = [None] * 4
    if any(n is not None and abs(n) > 1 << 40 for n in numbers):
        numbers = [None] * 4
    first, last = (numbers + [None, None])[:2]
    step = numbers[2] if len(numbers) == 3 else None
    if len(numbers) > 3 or not text.strip() or (step is not None and step < 1):
        raise SettingsError(
            f"Not a range of frames: {text!r}", mend="give A:B:STEP as 0:80:2, counted from 0, STEP above 0"
        )
    if len(numbers) == 1:
        assert first is not None
        return slice(first, first + 1 or None)
    return slice(first, last, step)

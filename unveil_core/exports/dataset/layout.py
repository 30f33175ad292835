"""Clean frames where a dataset's photographs lie, in a copy of its tree by links: an existing training pipeline takes it unchanged.

File names, sizes, bit depths and formats are those of the dataset: a PNG is the delivered one, a JPEG stays a JPEG with its profile
and the camera's notes. A photograph from which nothing was removed is the dataset's own file. Sweeps, boxes and labels are the
dataset's, too: they still tell of what the pictures no longer show.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from unveil_core.base.checks.fields import checked
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.pictures.decoding import read_image_as_it_is, read_metadata
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.registry import FORMATS, open_drive
from unveil_core.exports.dataset.jpeg_metadata import in_jpeg
from unveil_core.exports.dataset.linked_tree import is_within, link_file, linked_tree
from unveil_core.exports.job import Job
from unveil_core.exports.whole import tell

__all__ = ["DATASETS", "write_kitti", "write_nuscenes", "write_pandaset"]

DATASETS = {"pandaset": ("PandaSet",), "kitti": ("KITTI raw", "KITTI odometry", "KITTI-360"), "nuscenes": ("nuScenes",)}
"""By name of the format, how ``drives.formats.registry.FORMATS`` calls the datasets."""
JPEG_QUALITY = 97
"""With colours at full resolution: a second compression is hardly to show beside that of the camera."""
JPEG = (".jpg", ".jpeg")
SHOWN = 3
"""Names that a notice has."""
OF_PART = ("scene", "cameras", "frames", "sweeps", "model", "pose_convention")
"""Of the recorded settings those that tell which part of the dataset was read."""


def write_pandaset(job: Job, folder: Path) -> None:
    """A sequence of PandaSet, or the folder of several, see :func:`_write`."""
    _write(job, folder, "pandaset")


def write_kitti(job: Job, folder: Path) -> None:
    """A drive of KITTI raw, a sequence of its odometry or of KITTI-360, with the calibration where it lies, see :func:`_write`."""
    _write(job, folder, "kitti")


def write_nuscenes(job: Job, folder: Path) -> None:
    """nuScenes with its tables, see :func:`_write`."""
    _write(job, folder, "nuscenes")


def _write(job: Job, folder: Path, name: str) -> None:
    """The dataset's tree, with ``export.json`` in it that tells where the drive lies.

    Args:
        name: of :data:`DATASETS`.
    Raises:
        DriveError: the drive is gone. SettingsError: it is of another dataset. WorkspaceError: no clean frames yet.
    """
    place, drive = _opened(job, name)
    read = (*drive.sources, *(sweep.path for sweep in drive.sweeps))
    outside = [p for p in _absolute(read) if not p.is_relative_to(place)]
    root = Path(os.path.commonpath([place, *(p.parent for p in outside)]))
    clean = _clean(job, drive, root)
    inside = place.relative_to(root).as_posix()
    start = "" if inside == "." else f"{inside}/"
    within = {p.removeprefix(start): partial(put, job) for p, put in clean.items()}
    left_out = linked_tree(place, folder / inside, within)
    for path in outside:
        target = folder / path.relative_to(root)
        if path.is_symlink() or not is_within(path, root):
            left_out.append(path.relative_to(root).as_posix())
        elif path.is_file() and not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            link_file(path, target)
    job.notice(
        f"{name}: {len(clean)} photographs are clean; all other photographs, sweeps, boxes and labels are the dataset's own"
    )
    if left_out:
        named = ", ".join(left_out[:SHOWN]) + (f" and {len(left_out) - SHOWN} more" if len(left_out) > SHOWN else "")
        job.notice(f"{name}: links that lead out of the dataset are left out: {named}; copy into it what belongs to it")
    told: dict[str, Any] = {"drive": inside, "clean": sorted(clean)}
    tell(folder, name, {**told, "colorspace": job.colorspace})


def _opened(job: Job, name: str) -> tuple[Path, Drive]:
    """The folder of the dataset, absolute, and the part of it that the workspace was made from."""
    state = job.workspace.state()
    place = Path(os.path.abspath(str(state.get("drive", ""))))
    kind = next((f for f in FORMATS if place.exists() and f.recognizes(place)), None)
    if kind is None:
        mend = "bring the dataset back, or run `unveil import` with its new place"
        raise DriveError("Not found: the drive that the workspace was made from", path=place, mend=mend)
    if kind.name not in DATASETS[name]:
        own = next((n for n, kinds in DATASETS.items() if kind.name in kinds), None)
        mend = f"use --to {own}" if own else "use --to nerfstudio, colmap or png"
        raise SettingsError(f"Not a drive of {' or '.join(DATASETS[name])}: it is {kind.name}", path=place, mend=mend)
    recorded = state["stages"].get("import", {}).get("settings") or {}
    options = checked(DriveOptions, {name: recorded[name] for name in OF_PART if name in recorded})
    return place, open_drive(place, options)


def _absolute(paths: tuple[Path, ...]) -> list[Path]:
    return [Path(os.path.abspath(path)) for path in paths]


def _clean(job: Job, drive: Drive, root: Path) -> dict[str, Callable[[Job, Path], None]]:
    """By file, relative to the tree's root, what writes it: for each frame of the workspace."""
    imported = {(f.camera_name, f.name): f for f in job.drive.frames}
    found: dict[str, Callable[[Job, Path], None]] = {}
    for frame in drive.frames:
        own = imported.get((frame.camera_name, frame.name))
        if own is None:
            continue
        path = Path(os.path.abspath(frame.image_path))
        if not path.is_relative_to(root) or not path.is_file():
            problem = "Not found: the photograph of a frame"
            raise DriveError(problem, path=path, mend="bring the dataset back as it was when it was imported")
        found[path.relative_to(root).as_posix()] = partial(_put, path, job.delivered(own))
    return found


def _put(original: Path, delivered: Path, job: Job, target: Path) -> None:
    """Write a clean frame as the photograph is kept; the photograph itself where they show the same."""
    clean = read_image_as_it_is(delivered)
    photograph = read_image_as_it_is(original)
    if clean.shape == photograph.shape and clean.dtype == photograph.dtype and np.array_equal(clean, photograph):
        link_file(original, target)
    elif original.suffix.lower() in JPEG:
        options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
        options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        ordered = clean if clean.ndim == 2 else cv2.cvtColor(clean, cv2.COLOR_RGB2BGR)
        done, encoded = cv2.imencode(".jpg", ordered, options)
        assert done
        write_bytes_atomic(target, in_jpeg(encoded.tobytes(), read_metadata(delivered)), like=original)
    elif original.suffix.lower() == ".png":
        shutil.copyfile(delivered, target)
    else:
        raise DriveError(f"Not written: photographs as {original.suffix}", path=original, mend="use --to png")

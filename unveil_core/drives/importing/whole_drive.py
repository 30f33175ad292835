"""Importing a drive into a workspace: undistorted, in metres with z up, at the working size, in one known layout.

    images/<camera>/<frame>.(png|jpg)  semantics/  instances/  masks/  ego/  footage/   points.ply   cameras.json

Coordinates are brought to metres, z up and an origin amid the cameras by one similarity in float64, which is kept. Undistorting
and resizing happen where needed, otherwise the original files are copied. Where a photograph was changed, footage/ has a copy of
its file: frames are delivered at its size and in its lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import LARGEST_TEXT
from unveil_core.base.errors import DriveError
from unveil_core.base.files import move, read_own_json, write_image_atomic, write_json_atomic
from unveil_core.base.output.scratch import exchanged, scratch_folder
from unveil_core.base.output.written import check_replaceable
from unveil_core.base.parallel import each
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives.drive import Drive, FrameLabels, frames_per_second, tracks
from unveil_core.drives.imported import CAMERAS, imported_files, read_imported
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.frames import import_frame, pose_and_boxes
from unveil_core.drives.importing.refined_poses import kept_refinement, refined, refinement_by_pictures, unrefined
from unveil_core.drives.importing.sweeps import gathered, local_sweep
from unveil_core.drives.points import write_points
from unveil_core.drives.scale_and_up import Placement, place_drive
from unveil_core.geometry.axes import UP

__all__ = ["frame_rate", "import_drive", "localized", "write_labels"]

ROOM, BYTES_A_PIXEL = 1 << 30, 40
"""Bytes for photographs that are read at once, and of one of them for each of its pixels: the file, the pixels, undistorted ones as
floats."""
FARTHEST_ORIGIN_M = 10_000.0
"""Of the cameras from an origin that is kept, metres: single precision is good for a millimetre there."""


def localized(drive: Drive, placement: Placement | None = None) -> Drive:
    """The drive in metres, with z up, and its origin amid the cameras, at whole metres, unless it keeps its own.

    A drive that has metres and z up is shifted and nothing else. Subtraction happens in float64 between numbers of like size,
    so nothing is lost beyond the coordinates' own rounding.

    Args:
        drive: as read from disk.
        placement: its scale and up; None = as :func:`place_drive` finds them.
    """
    placement = placement or place_drive(drive)
    turned = placement.to_world
    middle = turned.to_local(np.mean([f.camera.centre for f in drive.frames], axis=0))
    if drive.keeps_origin and np.abs(middle).max() < FARTHEST_ORIGIN_M:
        middle = np.zeros(3)
    step = replace(turned, translation=turned.to_world(np.round(middle)))
    frames = tuple(
        replace(
            f,
            camera=step.camera_to_local(f.camera),
            boxes=tuple(b.to_local(step) for b in f.boxes),
            footage=f.footage and replace(f.footage, camera=step.camera_to_local(f.footage.camera)),
        )
        for f in drive.frames
    )
    points = replace(drive.points, positions=step.to_local(drive.points.positions))
    return replace(
        drive,
        frames=frames,
        points=points,
        sweeps=tuple(local_sweep(s, step) for s in drive.sweeps),
        to_world=drive.to_world.after(step),
        units_per_metre=1.0,
        scale_source=placement.scale_source,
        up=UP,
        up_source=placement.up_source,
    )


def frame_rate(drive: Drive) -> float | None:
    """Frames a second of the camera that took most frames; None where its time stamps do not tell."""
    longest = max(tracks(drive), key=len, default=[])
    return frames_per_second([drive.frames[i] for i in longest])


def import_drive(
    drive: Drive,
    destination: Path,
    *,
    work_side: int | None = None,
    placement: Placement | None = None,
    refine: bool = False,
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Drive:
    """Check a drive and write it to ``destination``, which appears whole or not at all.

    Args:
        drive: as read from disk.
        destination: the folder to make; an imported drive that is there already is replaced, and nothing else is.
        work_side: longer image side that larger images are reduced to, pixels; None keeps them.
        placement: scale and up of the drive; None = as :func:`place_drive` finds them.
        refine: whether the poses are refined against the photographs, where these say so (see ``refined_poses``).
        kept: where an interrupted call leaves what the next one, of the same drive, goes on from; None = it leaves nothing.
    Returns:
        the imported drive, as :func:`read_imported` gives it, with the sweeps in its coordinates and the labels that a
        dataset has (see :func:`write_labels`) still unread.
    Raises:
        DriveError: see :func:`check_drive`; or the folder is there, and holds what no import made.
    """
    as_read, drive = drive, localized(drive, placement)
    if kept is None:
        _check_own(destination)
        with scratch_folder(destination.parent, destination.name) as scratch:
            drive = _write(as_read, drive, scratch / "drive", work_side, refine, Kept(), progress)
            _check_own(destination)  # meanwhile somebody may have put something there
            exchanged(scratch / "drive", destination)
    elif not (destination / CAMERAS).is_file():
        partial = destination.with_name(f".{destination.name}.partial")
        drive = _write(as_read, drive, partial, work_side, refine, kept, progress)
        _check_own(destination)
        move(partial, destination)
    elif refine:
        drive = refined(drive, kept_refinement(kept, lambda: unrefined(drive)))
    imported = read_imported(destination)
    frames = [replace(new, labels=old.labels) for new, old in zip(imported.frames, drive.frames, strict=True)]
    return replace(imported, frames=tuple(frames), sweeps=drive.sweeps)


def _check_own(destination: Path) -> None:
    """Refuse to replace anything but an imported drive with nothing else in it."""
    own = imported_files(destination)
    check_replaceable(destination, own, mend="move it, or name another folder", kind=DriveError)


def _write(
    as_read: Drive, drive: Drive, folder: Path, work_side: int | None, refine: bool, kept: Kept, progress: Progress
) -> Drive:
    """Write a localized drive into a folder; ``as_read``: the same before, which the messages of checks are about. Returns it as it
    was written, with its poses refined where that was asked for."""

    def check() -> dict[str, NDArray[Any]]:
        check_drive(as_read, progress)
        return {}

    kept.once("checked", check)
    folder.mkdir(parents=True, exist_ok=True)
    entries = []
    for entry in each(lambda frame: import_frame(frame, folder, work_side), drive.frames, most=_at_a_time(drive)):
        entries.append(entry)
        progress(len(entries), len(drive.frames), "importing")
    by = unrefined(drive)
    if refine:
        by = kept_refinement(kept, lambda: refinement_by_pictures(drive, folder, entries, work_side, progress))
        drive = refined(drive, by)
        for entry, frame in zip(entries, drive.frames, strict=True):
            entry |= pose_and_boxes(frame)
    if not (folder / "points.ply").is_file():
        points = gathered(drive, progress, kept.checkpoint("sweeps")) if drive.sweeps else drive.points
        write_points(points, folder / "points.ply")
    write_json_atomic(
        folder / CAMERAS,
        {
            "generator": "unveil",
            "source": str(drive.root),
            "to_world": drive.to_world.to_json(),
            "scale_source": drive.scale_source,
            "up_source": drive.up_source,
            "frame_rate": frame_rate(drive),
            "front_cameras": list(drive.front_cameras),
            "semantic_classes": drive.semantic_classes,
            "truth_root": None if drive.truth_root is None else str(drive.truth_root.resolve()),
            "poses": by.facts,
            "frames": entries,
        },
    )
    return drive


def _at_a_time(drive: Drive) -> int:
    """How many photographs may be read at once: one where a table holds many, which its reader goes through in order."""
    if any(frame.image_bytes is not None for frame in drive.frames):
        return 1
    pixels = max((frame.camera.width * frame.camera.height for frame in drive.frames), default=1)
    return max(1, ROOM // (pixels * BYTES_A_PIXEL))


def write_labels(
    folder: Path, labels: Sequence[FrameLabels], progress: Progress = no_progress, *, together: bool = False
) -> None:
    """Add labels to an imported drive that came without; of a frame that has them, an interrupted call left them.

    Args:
        folder: of :func:`import_drive`.
        labels: of its frames in their order, of working size; asked for those that are missing only.
        together: whether those of several frames may be found at once.
    """
    path = folder / CAMERAS
    data: dict[str, Any] = read_own_json(path, LARGEST_TEXT)
    entries = data["frames"]

    def write(k: int) -> dict[str, str]:
        entry = entries[k]
        stem = f"{entry['camera']}/{entry['name']}.png"
        files = {name: folder / name / stem for name in ("semantics", "instances", "ego")}
        if not files["semantics"].is_file():  # the last that is written
            found = labels[k]
            if found.instance is not None and "instances" not in entry:  # else the user gave them
                write_image_atomic(files["instances"], found.instance)
            if found.ego is not None and found.ego.any():
                write_image_atomic(files["ego"], found.ego.astype(np.uint8) * 255)
            write_image_atomic(files["semantics"], found.semantic)
        return {name: f"{name}/{stem}" for name, file in files.items() if file.is_file()}

    written = each(write, range(len(entries)), most=None if together else 1)
    for done, (entry, files) in enumerate(zip(entries, written, strict=True)):
        entry |= files
        progress(done + 1, len(entries), "labelling")
    data["semantic_classes"] = "cityscapes"
    write_json_atomic(path, data)

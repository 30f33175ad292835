"""Labels from a folder of the user's: PNGs of Cityscapes trainIds by camera and frame stem, for a drive of any layout."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Drive, Frame

__all__ = ["with_label_folder"]

LAYOUT = "name the pictures CAMERA/STEM.png, or STEM.png where the drive has one camera"


def with_label_folder(drive: Drive, folder: Path) -> Drive:
    """The drive with the labels of a folder in the place of its own.

    Args:
        drive: as read, the part of it that is asked for.
        folder: that holds ``CAMERA/STEM.png`` for each frame, or ``STEM.png`` where the drive has one camera: 8-bit PNGs of the
            photographs' size, with Cityscapes trainIds, 255 = void.
    Raises:
        SettingsError: there is no such folder, or it lacks the labels of a frame.
    """
    if not folder.is_dir():
        raise SettingsError(
            f"no folder of labels: {folder}", mend="give --labels a folder of PNGs of Cityscapes trainIds"
        )
    one_camera = len({f.camera_name for f in drive.frames}) == 1
    found = [next((p for p in _places(f, folder, one_camera) if p.is_file()), None) for f in drive.frames]
    missing = [f for f, path in zip(drive.frames, found, strict=True) if path is None]
    if missing:
        first = next(_places(missing[0], folder, False)).relative_to(folder).as_posix()
        problem = f"{folder} has no labels of {len(missing)} of {len(found)} frames, the first of them {first}"
        raise SettingsError(problem, mend=LAYOUT)
    frames = tuple(
        replace(frame, semantic_path=path, labels=None) for frame, path in zip(drive.frames, found, strict=True)
    )
    return replace(drive, frames=frames, semantic_classes="cityscapes")


def _places(frame: Frame, folder: Path, one_camera: bool) -> Iterator[Path]:
    """Where the labels of a frame may lie, the best first; a frame may be called otherwise than its photograph's file."""
    for stem in dict.fromkeys((frame.name, frame.image_path.stem)):
        yield folder / frame.camera_name / f"{stem}.png"
        # The photographs' own folder, of which one camera may have several.
        yield folder / frame.image_path.parent.name / f"{stem}.png"
        if one_camera:
            yield folder / f"{stem}.png"

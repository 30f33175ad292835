"""A drive whose label pictures are known for what they are."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from unveil_core.base.drive_options import LABEL_CLASSES, DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.labels.codes import BLACK, TRAIN_IDS, LabelCodes
from unveil_core.drives.labels.folders import with_instance_folder, with_label_folder
from unveil_core.drives.labels.instance_codes import instance_code
from unveil_core.drives.labels.mask_codes import mask_code
from unveil_core.drives.labels.reading import is_of_other_size
from unveil_core.drives.labels.samples import samples_of
from unveil_core.drives.labels.semantic_codes import semantic_code

__all__ = ["with_codes", "with_labels"]

KINDS = {"semantic_path": "label pictures", "mask_path": "masks", "instance_path": "instance maps"}


def with_labels(drive: Drive, options: DriveOptions, *, imported: bool = False) -> Drive:
    """The drive with the labels and instance maps of folders that the user names, and what label pictures hold known.

    Args:
        imported: its own label pictures are those of a workspace, which are known.
    Raises:
        SettingsError: see ``folders``. DriveError: see :func:`with_codes`.
    """
    if options.labels is not None:
        drive = with_label_folder(drive, Path(options.labels))
    if options.instance_maps is not None:
        drive = with_instance_folder(drive, Path(options.instance_maps))
    given = options.labels is not None or options.instance_maps is not None
    return drive if imported and not given else with_codes(drive, options.label_classes, options.mask_removes)


def with_codes(drive: Drive, label_classes: str | None = None, mask_removes: str | None = None) -> Drive:
    """The drive with the codes of its label pictures, masks and instance maps, and a notice of each that is not the usual one.

    Args:
        label_classes: one of ``codes.LABEL_CLASSES``, where the user names what pictures of classes hold.
        mask_removes: "black" or "white", likewise; None = what the codes that the reader gave the frames say.
    Raises:
        DriveError: pictures that hold nothing of what is known.
    """
    told: list[str] = []
    semantics = [f.semantic_path for f in drive.frames if f.semantic_path is not None]
    named = drive.semantic_classes if drive.semantic_classes in LABEL_CLASSES else None
    semantic, line = semantic_code(samples_of(semantics), label_classes or (None if named == TRAIN_IDS else named))
    told += [] if line is None else [line]
    masks = [f.mask_path for f in drive.frames if f.mask_path is not None]
    usual = next((f.codes.mask.removes for f in drive.frames if f.mask_path is not None), BLACK)
    mask, lines = mask_code(samples_of(masks), mask_removes, usual)
    told += lines if not semantics else []  # which are used in their place
    maps = [f.instance_path for f in drive.frames if f.instance_path is not None]
    instance, line = instance_code(samples_of(maps), maps)
    told += [] if line is None else [line]
    told += _sizes(drive.frames)
    codes = LabelCodes(semantic, mask, instance)
    if not told and all(f.codes == codes for f in drive.frames):
        return drive
    frames = tuple(replace(f, codes=codes) for f in drive.frames)
    return replace(drive, frames=frames, notices=(*drive.notices, *told))


def _sizes(frames: Sequence[Frame]) -> list[str]:
    """Label pictures of another size than their photographs, by the first of each kind."""
    told = []
    for kind in ("semantic_path", "mask_path", "instance_path"):
        path, frame = next(((p, f) for f in frames if (p := getattr(f, kind)) is not None), (None, None))
        with suppress(DriveError):
            if path is not None and frame is not None and is_of_other_size(path, frame):
                width, height = picture_size(path)
                size, shown = "x".join(map(str, picture_size(path))), f"{frame.camera.width}x{frame.camera.height}"
                told.append(f"{KINDS[kind]} of {size} pixels are scaled to the {shown} of photographs")
    return told

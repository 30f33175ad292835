"""What lies beside a drive's files and is not read, counted: a user may have meant it to be."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from unveil_core.drives.drive import Frame
from unveil_core.drives.formats.on_disk.pictures import pictures_below, pictures_in

__all__ = ["missing_notice", "other_pictures", "unread_folders"]

NAMED = 3
"""Missing pictures that a notice names."""
KINDS = {
    "semantics": "semantic_path", "semantic": "semantic_path", "labels": "semantic_path", "segmentation": "semantic_path",
    "segmentations": "semantic_path", "instances": "instance_path", "depth": "depth_file_path", "depths": "depth_file_path",
    "mask": "mask_path", "masks": "mask_path",
}  # fmt: skip
"""Folders of a drive that hold pictures which belong to its photographs, and the key of a frame that names one."""


def missing_notice(missing: Sequence[str], count: int) -> list[str]:
    """That photographs are not there and left out.

    Args:
        missing: their names; count: of all.
    """
    if not missing:
        return []
    named = ", ".join(missing[:NAMED]) + f" and {len(missing) - NAMED} more" * (len(missing) > NAMED)
    return [f"{len(missing)} of {count} photographs are not there and are left out: {named}"]


def other_pictures(frames: Sequence[Frame], what: str, whole: Path | None = None) -> list[str]:
    """How many pictures lie in the folders of the photographs that are not read, where they have the photographs' suffixes.

    Args:
        what: names or poses the photographs, for the notice; whole: the folder that holds all photographs, with its folders; None =
            only the folders in which the photographs lie.
    """
    suffixes = {f.image_path.suffix.lower() for f in frames}
    used = {str(p) for f in frames for p in (f.image_path, f.mask_path, f.semantic_path, f.instance_path, f.depth_path)}
    lines = []
    for folder in [whole] if whole is not None else list(dict.fromkeys(f.image_path.parent for f in frames)):
        names = pictures_in(folder) if whole is None else pictures_below(folder)
        there = [n for n in names if os.path.splitext(n)[1].lower() in suffixes]
        rest = [n for n in there if os.path.join(folder, n) not in used]
        if rest:
            lines.append(
                f"{folder.name}/ holds {len(there)} pictures, {what} {len(there) - len(rest)} of them: {len(rest)} are not read, "
                f"the first {rest[0]}"
            )
    return lines


def unread_folders(frames: Sequence[Frame], root: Path) -> list[str]:
    """Pictures in folders of labels, instances, depth images or masks that no frame names."""
    named = (p for f in frames for p in (f.mask_path, f.semantic_path, f.instance_path, f.depth_path, f.image_path))
    used = {str(p) for p in named if p is not None}
    lines = []
    for name, key in KINDS.items():
        folder = root / name
        held = pictures_below(folder)
        rest = [n for n in held if os.path.join(folder, n) not in used]
        if rest and len(rest) == len(held):
            lines.append(f"{name}/ holds {len(held)} pictures that no frame names: they are not read; {key} names one")
        elif rest:
            some = f"frames name {len(held) - len(rest)} of them: {len(rest)} are not read, the first {rest[0]}"
            lines.append(f"{name}/ holds {len(held)} pictures, {some}; {key} names one")
    return lines

"""Label pictures of another size than their photographs are scaled where the shape is the same, and refused elsewhere."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.labels.reading import instances_of, mask_of, semantics_of
from unveil_core.geometry.label_images import resize_labels


def resized(folder: Path, kind: str, size: tuple[int, int]) -> None:
    """All pictures of a kind of the tiny drive, 32x24 pixels, at another size."""
    for path in (folder / kind).iterdir():
        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), resize_labels(picture, size))


@pytest.mark.parametrize("size", [(16, 12), (64, 48), (24, 18)])
@pytest.mark.parametrize(
    ("kind", "what", "read"),
    [
        ("semantics", "label pictures", semantics_of),
        ("masks", "masks", mask_of),
        ("instances", "instance maps", instances_of),
    ],
)
def test_they_are_scaled_and_it_is_said(kind: str, what: str, read, size: tuple[int, int], tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "drive"
    path = make_tiny_drive(folder, semantics=kind != "masks", masks=True)
    right = [read(f) for f in open_drive(path).frames]
    resized(folder, kind, size)
    opened = open_drive(path)
    assert f"{what} of {size[0]}x{size[1]} pixels are scaled to the 32x24 of photographs" in opened.notices
    check_drive(opened)
    imported = import_drive(opened, tmp_path / "imported", work_side=None)
    for frame, own, wanted in zip(imported.frames, opened.frames, right, strict=True):
        assert read(frame).shape == (24, 32) and (read(frame) == read(own)).all()
        assert (read(own) == wanted).mean() > 0.85
        assert set(np.unique(read(own))) <= set(np.unique(wanted))
        if size == (64, 48):
            assert (read(own) == wanted).all()


@pytest.mark.parametrize("size", [(16, 24), (30, 24), (3, 2), (640, 480)])
def test_other_shapes_are_one_line(size: tuple[int, int], tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    resized(tmp_path, "semantics", size)
    with pytest.raises(
        DriveError,
        match=rf"semantics.00\.png: Not the size of its camera: {size[0]}x{size[1]} pixels, the camera says 32x24",
    ):
        check_drive(open_drive(path))

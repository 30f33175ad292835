"""Pictures of labels."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.labelling.parked_row import CAR, HEIGHT, SKY, WIDTH, parked_row
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.drive import FrameLabels
from unveil_core.labelling.preview import preview, preview_frames, write_preview


def test_a_picture_a_frame_under_safe_names(tmp_path: Path) -> None:
    drive = parked_row(tmp_path / "drive")
    odd = replace(drive, frames=(replace(drive.frames[0], name="../00"), *drive.frames[1:]))
    label = FrameLabels(np.full((HEIGHT, WIDTH), SKY, np.uint8), np.zeros((HEIGHT, WIDTH), np.uint16))
    calls: list[tuple[int, int]] = []
    written = write_preview(odd, tmp_path / "out", lambda d, t, m="", **k: calls.append((d, t)), lambda i: label)
    assert [p.name for p in written] == ["front____00.jpg", "front_01.jpg", "front_02.jpg"]
    assert sorted((tmp_path / "out").glob("*.jpg")) == sorted(written)
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert read_image(written[0]).shape == (HEIGHT * 5, WIDTH * 5, 3)


def test_long_drives_are_looked_through_evenly(tmp_path: Path) -> None:
    drive = parked_row(tmp_path)
    long = replace(drive, frames=drive.frames[:1] * 400)
    chosen = preview_frames(long)
    assert (len(chosen), chosen[0], chosen[-1]) == (40, 0, 399)
    assert set(np.diff(chosen)) <= {10, 11}
    assert preview_frames(drive) == [0, 1, 2]


def test_classes_objects_and_boxes_are_drawn(tmp_path: Path) -> None:
    drive = parked_row(tmp_path)
    image = read_image(drive.frames[0].image_path)
    semantic = np.full((HEIGHT, WIDTH), 255, np.uint8)
    instance = np.zeros((HEIGHT, WIDTH), np.uint16)
    semantic[100:120, 100:140], instance[100:120, 100:140] = CAR, 4
    bare = replace(drive.frames[0], boxes=())
    plain = preview(image, bare, None)
    drawn = preview(image, bare, FrameLabels(semantic, instance))
    assert (plain[0, 0] == image[0, 0]).all()
    changed = (plain != drawn).any(axis=2)
    assert changed[502:598, 502:698].mean() > 0.99  # five times as large
    assert not changed[:400].any()
    assert (preview(image, drive.frames[0], None) != plain).any()

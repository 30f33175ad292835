"""Pixels in which a photograph is no witness of the empty street."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unveil_core.base.files import write_image_atomic
from unveil_core.drives.drive import Frame
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.workspace.files import frame_file, save_mask
from unveil_core.workspace.movers import Moving, no_street

SHAPE = (40, 60)


def block(row: int, column: int) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[row : row + 4, column : column + 4] = True
    return mask


def test_what_goes_what_moves_their_shadows_and_the_ego_vehicle(tmp_path: Path) -> None:
    blocks = {
        "masks/removed": block(4, 4),
        "masks/shadows": block(4, 20),
        "movers/shadows": block(20, 4),
        "ego": block(36, 30),
    }
    camera = Camera(SHAPE[1], SHAPE[0], 50.0, 50.0, 30.0, 20.0, np.eye(4))
    frame = Frame(
        name="0000",
        camera_name="front",
        image_path=tmp_path / "0000.png",
        camera=camera,
        ego_path=tmp_path / "ego/front/0000.png",
    )
    for name, mask in blocks.items():
        save_mask(mask, frame_file(tmp_path / name, frame))
    moving = block(20, 20)
    write_image_atomic(frame_file(tmp_path / "movers/pixels", frame), moving.astype(np.uint16) * 3)
    goes = np.logical_or.reduce([moving, *blocks.values()])
    found = no_street(tmp_path, frame, Moving(tmp_path / "movers", 1))
    assert (found == grow(goes, border_px(SHAPE[1]))).all()
    still = no_street(tmp_path, frame, Moving(tmp_path / "movers", 0))
    assert not still[20:24, 4:24].any() and still[goes & ~moving & ~blocks["movers/shadows"]].all()

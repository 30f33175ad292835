"""What moves is found where nothing is labelled, and what stands is not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tests.moving_street import FRAMES, MOVER_ID, PARKED_ID, WALKER, Street, make_moving_street
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.marking.moving import moving_masks
from unveil_core.marking.space.scene_points import scene_points

STANDS = Street((10.0, 3.4, 0.0), (10.5, 3.9, 1.7), (0.0, 0.0, 0.0), 11)


def found_on(street: Street, folder: Path) -> tuple[list[dict[int, np.ndarray]], list[np.ndarray]]:
    path = make_moving_street(folder / "street", street, instances=True)
    drive = import_drive(open_drive(path), folder / "drive")
    things = moving_masks(drive, scene_points(drive), lambda v: read_image(drive.frames[v].image_path))
    ids = [cv2.imread(str(path.parent / f"instances/{i:02d}.png"), cv2.IMREAD_UNCHANGED) for i in range(FRAMES)]
    return things, ids


def test_a_walker_is_found(tmp_path: Path) -> None:
    (walker,), ids = found_on(WALKER, tmp_path)
    assert len(walker) >= 4
    shares = [(m & (ids[v] == MOVER_ID)).sum() / (m | (ids[v] == MOVER_ID)).sum() for v, m in walker.items()]
    assert np.median(shares) > 0.5 and not any((m & (ids[v] == PARKED_ID)).any() for v, m in walker.items())


def test_where_everything_stands_nothing_is(tmp_path: Path) -> None:
    things, _ = found_on(STANDS, tmp_path)
    assert things == []

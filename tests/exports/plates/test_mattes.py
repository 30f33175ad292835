"""The mattes as OpenCV reads them: together all that was changed, each by its object."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tests.exports.conftest import Street
from tests.exports.street import HEIGHT, LARGER, WIDTH
from unveil_core.app.cli import main
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_instance_image
from unveil_core.delivery.lens import work_positions
from unveil_core.workspace.files import load_mask

CARS = ("car_0001", "car_0002")


def plane(folder: Path, name: str, number: int = 1002) -> np.ndarray:
    found = cv2.imread(str(folder / f"front/{name}/{name}.{number}.png"), cv2.IMREAD_UNCHANGED)
    assert found is not None and found.dtype == np.uint8 and found.ndim == 2
    return found


@pytest.fixture(scope="module")
def mattes(street: Street) -> Path:
    return street.exported("mattes")


def test_each_object_has_a_sequence_that_is_named_after_it(mattes: Path) -> None:
    assert {p.name for p in (mattes / "front").iterdir()} == {*CARS, "removed", "provenance", "certainty"}
    for name in (*CARS, "provenance", "certainty"):
        files = sorted(p.name for p in (mattes / f"front/{name}").iterdir())
        assert files == [f"{name}.{n}.png" for n in (1001, 1002, 1003)]
    told = json.loads((mattes / "export.json").read_text())
    assert told["format"] == "mattes" and told["other"] == []
    assert told["mattes"] == [{"name": f"car_000{n}", "id": n, "class": "car"} for n in (1, 2)]
    assert told["cameras"]["front"]["1002"]["source"] == "0001"


def test_together_they_are_what_delivery_may_change(street: Street, mattes: Path) -> None:
    """Whatever pixel of the footage touches a changed one of working size."""
    frame = street.job.drive.frames[1]
    assert frame.footage is not None and frame.instance_path is not None
    goes = load_mask(street.root / "masks/removed/front/0001.png")
    goes |= load_mask(street.root / "masks/shadows/front/0001.png")
    at = np.moveaxis(work_positions(frame.footage, frame.camera) - 0.5, 2, 0)[::-1].astype(np.float64)
    share = map_coordinates(goes.astype(np.float64), at, order=1, mode="nearest")
    removed = plane(mattes, "removed")
    assert removed.shape == (HEIGHT * LARGER, WIDTH * LARGER)
    surely = (share > 0.05) | (share == 0)  # OpenCV's steps are of 1/32 px
    np.testing.assert_array_equal(removed[surely] == 255, share[surely] > 0)
    whole = [plane(mattes, name) for name in CARS]
    np.testing.assert_array_equal(np.max(whole, axis=0) == 255, removed == 255)
    ids = read_instance_image(frame.instance_path)
    for number, matte in zip((1, 2), whole, strict=True):
        own = map_coordinates((ids == number).astype(np.float64), at, order=1)
        other = map_coordinates(np.isin(ids, (1, 2)).astype(np.float64), at, order=1) - own
        assert matte[(own > 0.9) & (removed == 255)].min() == 255 and 0.01 < (matte == 255).mean() < 0.5
        assert (matte == 255)[other > 0.9].sum() == 0
        assert ((matte > 0) & (matte < 255)).any()  # soft edges


@pytest.mark.parametrize("name", ["provenance", "certainty"])
def test_provenance_and_certainty_are_of_the_nearest_pixel(street: Street, mattes: Path, name: str) -> None:
    frame = street.job.drive.frames[1]
    assert frame.footage is not None
    told = cv2.imread(str(street.root / f"{name}/front/0001.png"), cv2.IMREAD_UNCHANGED)
    found = plane(mattes, name)
    assert found.shape == (HEIGHT * LARGER, WIDTH * LARGER) and set(np.unique(found)) == set(np.unique(told))
    column, row = np.moveaxis(work_positions(frame.footage, frame.camera), 2, 0)
    inside = (column > 0.5) & (row > 0.5) & (column < WIDTH - 0.5) & (row < HEIGHT - 0.5)
    nearest = told[np.clip(row.astype(int), 0, HEIGHT - 1), np.clip(column.astype(int), 0, WIDTH - 1)]
    assert (found == nearest)[inside].mean() > 0.97


def test_without_certainty_in_the_workspace_there_is_no_sequence(street: Street, tmp_path: Path) -> None:
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    shutil.rmtree(root / "certainty")
    assert main(["export", str(root), "--to", "mattes", "-o", str(tmp_path)]) == 0
    assert {p.name for p in (tmp_path / "mattes/front").iterdir()} == {*CARS, "removed", "provenance"}


def test_a_piece_of_shadow_beside_an_object_is_of_that_object(street: Street, tmp_path: Path) -> None:
    """The sun shines on the ground under a car: the shadow beyond hangs together with nothing of the car."""
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    rows, columns = np.nonzero(load_mask(root / "masks/removed/front/0001.png"))
    last, low = int(columns.max()), int(rows[columns == columns.max()].max())
    apart = last + 7
    assert apart < WIDTH - 2
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[low - 1 : low + 1, apart - 1 : apart + 1] = 255
    write_image_atomic(root / "masks/shadows/front/0001.png", mask)
    assert main(["export", str(root), "--to", "mattes", "-o", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "mattes/export.json").read_text())["other"] == []


def test_a_part_without_an_object_is_of_none(street: Street, tmp_path: Path) -> None:
    root = tmp_path / "workspace"
    shutil.copytree(street.root, root)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[2:8, 2:10] = 255  # in the sky
    write_image_atomic(root / "masks/shadows/front/0001.png", mask)
    assert main(["export", str(root), "--to", "mattes", "-o", str(tmp_path)]) == 0
    other = plane(tmp_path / "mattes", "other")
    assert other[8:12, 8:14].min() == 255 and (other == 255).mean() < 0.03
    assert not plane(tmp_path / "mattes", "other", 1001).any()
    assert not any(plane(tmp_path / "mattes", name)[8:12, 8:14].any() for name in CARS)
    assert json.loads((tmp_path / "mattes/export.json").read_text())["other"] == ["front"]

"""Plates of a workspace: whose files are taken, and what is refused."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from blender_addon.formats.drive_files import ImportedDrive
from blender_addon.formats.plate_files import read_plates, st_maps_of


def drive_of(root: Path) -> ImportedDrive:
    """A drive of two frames, and its plates."""
    told: dict[str, Any] = {
        "mattes": [{"name": "car_0003", "id": 3, "class": "car"}],
        "other": ["front"],
        "cameras": {"front": {"9999": {"source": "a"}, "10000": {"source": "b"}}},
    }
    own = ("car_0003", "other", "provenance", "certainty")
    for place in ("png/front", *(f"mattes/front/{name}" for name in own)):
        folder = root / "plates" / place
        folder.mkdir(parents=True)
        for number in ("09999", "10000"):
            (folder / f"{folder.name}.{number}.png").write_bytes(b"")
    (root / "plates/mattes/export.json").write_text(json.dumps(told))
    tracks = {"front": tuple(SimpleNamespace(name=name) for name in "ab")}
    return cast(ImportedDrive, SimpleNamespace(workspace=root, tracks=tracks))


def test_each_matte_is_called_as_its_object(tmp_path: Path) -> None:
    made = read_plates(drive_of(tmp_path))["front"]
    assert [(m.name, m.key) for m in made.mattes] == [("car 3", "car_0003"), ("other", "other")]
    assert [f.name for f in made.clean] == ["front.09999.png", "front.10000.png"]
    assert [f.name for f in made.provenance] == ["provenance.09999.png", "provenance.10000.png"]
    assert [f.name for f in made.certainty] == ["certainty.09999.png", "certainty.10000.png"]
    assert all(f.is_file() for m in made.mattes for f in m.files)


@pytest.mark.parametrize("name", ["provenance", "certainty"])
def test_a_missing_sequence_is_left_out_and_half_a_one_is_damaged(tmp_path: Path, name: str) -> None:
    drive, folder = drive_of(tmp_path), tmp_path / "plates/mattes/front" / name
    (folder / f"{name}.10000.png").unlink()
    with pytest.raises(ValueError, match=rf"{name}\.10000\.png is missing"):
        read_plates(drive)
    shutil.rmtree(folder)
    made = read_plates(drive)["front"]
    assert [bool(made.provenance), bool(made.certainty)] == [name != "provenance", name != "certainty"]


def test_a_lens_has_both_maps_or_none(tmp_path: Path) -> None:
    drive = drive_of(tmp_path)
    folder = tmp_path / "st_maps/front"
    folder.mkdir(parents=True)
    (folder / "undistort.exr").write_bytes(b"")
    assert st_maps_of(drive, "front") == {}
    (folder / "redistort.exr").write_bytes(b"")
    assert st_maps_of(drive, "front")["undistort"] == folder / "undistort.exr"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.pop("cameras"), "'cameras' is missing"),
        (lambda d: d.update(mattes=3), "not iterable"),
        (lambda d: d.update(cameras=[]), "no attribute"),
        (lambda d: d["cameras"]["front"].pop("9999"), "other frames of front"),
        (lambda d: d["cameras"].pop("front"), "other frames of front"),
        (lambda d: d["mattes"][0].update(name="../../front"), "not a file name"),
        (lambda d: d["mattes"][0].update(name="car_0004"), r"car_0004\.09999\.png is missing"),
        (lambda d: d["mattes"][0].update(id=True), "of no object"),
        (lambda d: d["mattes"][0].update({"class": None}), "of no object"),
        (lambda d: d.update(other=7), "not iterable"),
    ],
)
def test_what_is_damaged_is_one_line(tmp_path: Path, change: Callable[[Any], object], said: str) -> None:
    drive = drive_of(tmp_path)
    path = tmp_path / "plates/mattes/export.json"
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))
    with pytest.raises(ValueError, match=said) as error:
        read_plates(drive)
    assert (
        "\n" not in str(error.value) and str(path) in str(error.value) and "make the plates again" in str(error.value)
    )

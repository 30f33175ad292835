"""A camera of another program as a drive, by the batch command: without a window, a .blend or a click."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from shots import COUNT, FIRST, SIZE, ground, moving_camera, poses, set_range, write_plates

RATE = str(24 / 1.001)


@pytest.fixture
def command(addon, scene):  # type: ignore[no-untyped-def]
    return addon.module("work.command_line").main


@pytest.fixture
def alembic(scene, tmp_path: Path) -> tuple[Path, np.ndarray]:
    """An animated camera with the street's mesh, centimetres, at 23.976 frames a second; and its poses."""
    import bpy

    set_range(scene)
    true = poses(moving_camera(scene))
    ground(scene)
    path = tmp_path / "shot.abc"
    bpy.ops.wm.alembic_export(filepath=str(path), start=FIRST, end=FIRST + COUNT - 1)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    return path, true


def test_alembic_and_plates_become_a_drive(command, alembic, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    path, true = alembic
    first = write_plates(tmp_path / "plates")
    one = first.with_name(f"plate.{FIRST + 2}.png")
    given = ["shot", str(path), "--plates", str(one), "-o", str(tmp_path / "drive")]
    assert command([*given, "--fps", RATE, "--units-per-metre", "100"]) == 0
    assert capfd.readouterr().out.strip().endswith(str(tmp_path / "drive/transforms.json"))
    drive = json.loads((tmp_path / "drive/transforms.json").read_text())
    found = np.array([f["transform_matrix"] for f in drive["frames"]])
    np.testing.assert_allclose(found[:, :3, 3], true[:, :3, 3] / 100, atol=1e-6)
    np.testing.assert_allclose(found[:, :3, :3], true[:, :3, :3], atol=1e-4)
    assert [Path(f["file_path"]).name for f in drive["frames"]] == [f"plate.{FIRST + k}.png" for k in range(COUNT)]
    assert (drive["w"], drive["h"]) == SIZE
    # The street's vertices, without the empty that the camera hangs on.
    assert b"element vertex 341\n" in (tmp_path / "drive/points.ply").read_bytes()


def test_plates_may_be_counted_otherwise(command, alembic, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    path, true = alembic
    first = write_plates(tmp_path / "plates", first=1)
    given = ["shot", str(path), "--plates", str(first), "-o", str(tmp_path / "drive"), "--start", str(FIRST)]
    assert command([*given, "--fps", RATE, "--no-points"]) == 0
    drive = json.loads((tmp_path / "drive/transforms.json").read_text())
    np.testing.assert_allclose([f["transform_matrix"] for f in drive["frames"]], true, atol=1e-4)
    assert Path(drive["frames"][0]["file_path"]).name == "plate.1.png" and "ply_file_path" not in drive


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["shot", "FILE"], "-o"),
        (["shot", "/gone.abc", "-o", "OUT"], "/gone.abc: Not a file of a camera (use .abc"),
        (["shot", "FILE", "-o", "OUT", "--camera", "B"], "has no camera B, but shotcam"),
        (["shot", "FILE", "-o", "OUT"], "shotcam has no pictures behind it"),
        (["shot", "FILE", "-o", "OUT", "--plates", "/gone.1001.png"], "Not found: give a picture of the sequence"),
        (["shot", "FILE", "-o", "OUT", "--fps", "0"], "--fps is 0"),
    ],
)
def test_bad_input_ends_with_2_and_one_line(
    command,  # type: ignore[no-untyped-def]
    alembic: tuple[Path, np.ndarray],
    arguments: list[str],
    line: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    words = {"FILE": str(alembic[0]), "OUT": str(tmp_path / "out")}
    capfd.readouterr()
    assert command([words.get(a, a) for a in arguments]) == 2
    said = capfd.readouterr().err
    assert line in said and said.startswith("unveil: error: ") and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_no_drive_of_somebody_is_written_over(command, alembic, street: Path, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    mine = tmp_path / "mine"
    shutil.copytree(street.parent, mine)
    before = {p: p.read_bytes() for p in mine.rglob("*") if p.is_file()}
    given = ["shot", str(alembic[0]), "--plates", str(write_plates(tmp_path / "plates")), "--fps", RATE]
    for place in (mine, mine / "shot", Path.home()):
        assert command([*given, "-o", str(place), "--replace"]) == 2
        assert f"{place}: Not for a shot" in capfd.readouterr().err
    assert before == {p: p.read_bytes() for p in mine.rglob("*") if p.is_file()}


def test_what_was_changed_in_a_shot_is_replaced_by_a_word_alone(command, alembic, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    drive = tmp_path / "drive"
    given = ["shot", str(alembic[0]), "--plates", str(write_plates(tmp_path / "plates")), "--fps", RATE]
    given += ["-o", str(drive)]
    assert command(given) == 0
    capfd.readouterr()
    assert command([*given, "--no-points"]) == 0 and not (drive / "points.ply").exists()
    edited = (drive / "transforms.json").read_text().replace('"metric": true', '"metric": false')
    (drive / "transforms.json").write_text(edited)
    assert command(given) == 2
    said = capfd.readouterr().err
    assert f"{drive / 'transforms.json'}: Changed since Unveil wrote it" in said and "add --replace" in said
    assert (drive / "transforms.json").read_text() == edited
    assert command([*given, "--replace"]) == 0
    assert json.loads((drive / "transforms.json").read_text())["metric"] and (drive / "points.ply").is_file()

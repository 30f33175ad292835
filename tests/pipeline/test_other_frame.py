"""A street in other units, with another axis up, far from the origin: it is the same street, and comes back where it was."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

from tests.other_frame import Y_UP_UTM, box_in_other_frame, put_into_other_frame
from tests.small_street import FRAMES, HIGH, LOW, make_small_street
from unveil_core.app.cli import main
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import run_evaluation
from unveil_core.mesh import read_ply
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.semantics.objects import marked_box
from unveil_core.workspace.workspace import Workspace

SETTINGS = RunSettings(quality="draft", iterations=80, splats=6_000)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return put_into_other_frame(make_small_street(tmp_path_factory.mktemp("other") / "street"))


@pytest.fixture(scope="module")
def done(street: Path) -> Workspace:
    return run(street, street.parent.parent / "ws", SETTINGS, until="mesh")


def metres(points: np.ndarray) -> np.ndarray:
    """(N, 3) of the street as it was made, of places in its files."""
    return Y_UP_UTM.to_local(points)


def test_the_car_goes_and_the_street_continues(done: Workspace, street: Path) -> None:
    error = count = 0.0
    for i in range(FRAMES):
        truth = cv2.imread(str(street.parent / f"truth/images/{i:02d}.png")).astype(float)
        removed = cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0) > 0
        clean = cv2.imread(str(done.root / f"frames/camera/{i:02d}.png")).astype(float)
        error += ((clean - truth)[removed] ** 2).sum()
        count += 3 * removed.sum()
    assert 10 * np.log10(255**2 / (error / count)) > 19


def test_scale_and_up_are_estimated_and_said_first(done: Workspace) -> None:
    first, forecast, started = done.events()[:3]
    assert first["stage"] == "import" and first["level"] == "warning" and started["message"] == "started"
    assert "7 m of way" in forecast["message"], "in metres, whatever the drive's unit"
    assert first["message"].startswith("SCALE UNKNOWN: 1 m is taken as 0.0") or "0.1" in first["message"]
    placed = first["placement"]
    assert placed["units_per_metre"] == pytest.approx(0.1, rel=0.02) and placed["scale_source"] == "camera height"
    assert placed["up"] == [0, 1, 0] and placed["up_source"] == "ground"
    assert done.state()["stages"]["import"]["scale_source"] == "camera height"
    assert read_imported(done.drive_dir).scale_source == "camera height"


@pytest.mark.parametrize("name", ["full.ply", "empty.glb"])
def test_meshes_come_back_in_the_frame_of_the_drive(done: Workspace, name: str) -> None:
    loaded = trimesh.load(done.root / "meshes" / name, process=False)
    mesh = loaded.to_mesh() if isinstance(loaded, trimesh.Scene) else loaded
    # y is up in the drive, as in glTF.
    found = metres(np.asarray(mesh.vertices))
    near = found[(found[:, 0] > 1) & (found[:, 0] < 15)]
    assert len(near) > 500 and np.abs(near[:, 1]).max() < 6.5
    on_road = near[(np.abs(near[:, 1]) < 1.0) & (near[:, 2] < 0.5)]
    assert len(on_road) > 50 and np.abs(np.median(on_road[:, 2])) < 0.1


def test_what_is_written_is_read_as_it_was(done: Workspace) -> None:
    drive = read_imported(done.drive_dir)
    mesh = read_ply(done.root / "meshes/empty.ply", drive.to_world)
    assert np.abs(mesh.vertices).max() < 60 and np.ptp(mesh.vertices[:, 2]) < 15


def test_rendered_cameras_come_back_in_the_frame_of_the_drive(done: Workspace, street: Path, tmp_path: Path) -> None:
    assert main(["render", str(done.root), "-o", str(tmp_path / "views"), "--beside", "0.5", "--above", "0.25"]) == 0
    given = json.loads(street.read_text())["frames"]
    written = json.loads((tmp_path / "views/transforms.json").read_text())["frames"]
    scale = read_imported(done.drive_dir).to_world.scale
    for before, after in zip(given, written, strict=True):
        a, b = (np.array(e["transform_matrix"]) for e in (before, after))
        np.testing.assert_allclose(a[:3, :3], b[:3, :3], atol=1e-9)
        # It looks along x; y is up, and to the right lies z.
        np.testing.assert_allclose(b[:3, 3] - a[:3, 3], scale * np.array([0.0, 0.25, 0.5]), atol=1e-6)
    # As a path they lead there again.
    arguments = [
        "render",
        str(done.root),
        "--path",
        str(tmp_path / "views/transforms.json"),
        "-o",
        str(tmp_path / "again"),
    ]
    assert main(arguments) == 0
    for i in (0, FRAMES - 1):
        one, other = (cv2.imread(str(tmp_path / f"{n}/rgb/{i:02d}.png")).astype(int) for n in ("views", "again"))
        assert np.abs(one - other).max() <= 1


def test_free_views_are_measured_where_they_are(done: Workspace) -> None:
    metrics = run_evaluation(done.root)
    assert metrics["free_views"]["regions"]["free_whole"]["psnr"] > 20


def test_marked_boxes_are_of_the_drives_own_frame(street: Path, tmp_path: Path) -> None:
    x, y, z = (float(v) for v in (LOW + HIGH) / 2)
    length, width, height = (float(v) for v in HIGH - LOW)
    box = box_in_other_frame(TrackedBox(1001, "car", (x, y, z), (length, width, height), 0.2))
    (tmp_path / "marked.json").write_text(json.dumps([box.to_json()]))
    settings = replace(SETTINGS, marked=str(tmp_path / "marked.json"), scale=0.1, up="y")
    workspace = run(street, tmp_path / "ws", settings, until="objects")
    drive = read_imported(workspace.drive_dir)
    local = marked_box(box, drive)
    assert local.size == pytest.approx((length, width, height), abs=1e-9)
    listed = json.loads(workspace.objects_json.read_text())["objects"]
    (marked,) = [o for o in listed if o["id"] == 1001]
    assert marked["points"] > 30
    assert metres(drive.to_world.to_world(np.array([marked["box"]["centre"]])))[0] == pytest.approx((x, y, z), abs=1e-6)


def test_the_command_says_first_what_it_takes(street: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(street), "-o", str(tmp_path / "a")]) == 0
    assert capsys.readouterr().err.splitlines()[0].startswith("import       SCALE UNKNOWN: 1 m is taken as 0.")
    assert main(["import", str(street), "-o", str(tmp_path / "a"), "--scale", "0.1", "--up", "y"]) == 0
    assert capsys.readouterr().err.splitlines()[0] == "import       1 m is 0.1 units, as given; up is y, as given"
    assert main(["import", str(street), "-o", str(tmp_path / "b"), "--json", "--scale", "0.1", "--up", "-z"]) == 0
    first = json.loads(capsys.readouterr().out.splitlines()[0])
    assert first["level"] == "notice" and first["placement"]["up"] == [0, 0, -1]
    for wrong in (["--scale", "0"], ["--scale", "nan"], ["--scale", "much"], ["--up", "w"], ["--up", "-w"]):
        try:
            assert main(["import", str(street), "-o", str(tmp_path / "c"), *wrong]) == 2
        except SystemExit as end:
            assert end.code == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "c").exists()

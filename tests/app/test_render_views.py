"""``unveil render``: what comes out of a scene made of the truth is the truth, from other places too."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from tests.exact_scene import build_exact_workspace, true_planes
from tests.small_street import BUILDING, CAR, FRAMES, ROAD, SKY, picture
from unveil_core.app.cli import main
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.drives.camera_path import drive_path, read_camera_path, shifted
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import psnr
from unveil_core.ground.files import write_ground
from unveil_core.ground.fit import DriveGround
from unveil_core.ground.path import StreetPath
from unveil_core.surfels.ply import read_surfels, write_surfels


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_exact_workspace(tmp_path_factory.mktemp("exact"))


@pytest.fixture(scope="module")
def everything(workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All planes of the empty street from 0.6 m to the right and 0.3 m above."""
    folder = tmp_path_factory.mktemp("out") / "deep/er"
    planes = "rgb,depth,normal,alpha,semantics"
    shift = ["--beside", "0.6", "--above", "0.3"]
    assert main(["render", str(workspace), "--state", "empty", *shift, "--planes", planes, "-o", str(folder)]) == 0
    return folder


def test_views_beside_the_path_show_the_true_street(everything: Path, workspace: Path) -> None:
    drive = read_imported(workspace / "drive")
    views = shifted(drive_path(drive), beside=0.6, above=0.3)
    assert [v.camera.centre[1] + drive.to_world.translation[1] for v in views] == pytest.approx([0.4 - 0.6] * FRAMES)
    for view in views[1:-1]:
        depth, kind = true_planes(view.camera, drive.to_world.translation, crowded=False)
        pose = view.camera.camera_to_world
        pose[:3, 3] += drive.to_world.translation
        pose[:3, 1:3] *= -1
        street = picture(pose, False)[0][..., ::-1]
        # The picture's border is what no recorded camera shows; edges are a pixel soft.
        inner = np.zeros(depth.shape, bool)
        inner[8:-8, 12:-12] = True
        rgb = read_image(everything / f"rgb/{view.name}.png")
        pose[:3, 3] -= (0, -0.6, 0.3)
        unshifted = picture(pose, False)[0][..., ::-1]
        assert psnr(rgb, street, inner) > max(21, 3 + psnr(rgb, unshifted, inner))
        near = inner & (depth < 20)
        steps = read_instance_image(everything / f"depth/{view.name}.png")
        # A surfel no larger than a pixel is drawn at the depth of its centre. On a plane inverse depth is linear in the
        # picture, and the road's changes by 0.0062 a pixel: depths are off by little more than a pixel.
        off = np.abs(256.0 / np.maximum(steps, 1) - 1 / depth)[near]
        assert np.median(off) < 0.0075 and (off < 0.0125).mean() > 0.9
        labels = read_label_image(everything / f"semantics/{view.name}.png")
        assert (labels == kind)[inner].mean() > 0.93
        alpha = read_label_image(everything / f"alpha/{view.name}.png")
        assert (alpha[near] > 200).mean() > 0.97 and (alpha[:4][kind[:4] == SKY] < 100).mean() > 0.9


def test_the_sky_has_no_depth_and_its_own_label(everything: Path) -> None:
    depth, labels = read_instance_image(everything / "depth/03.png"), read_label_image(everything / "semantics/03.png")
    alpha, normal = read_label_image(everything / "alpha/03.png"), read_image(everything / "normal/03.png")
    open_ = alpha < 120
    assert open_.sum() > 200 and (depth[open_] == 0).all() and (labels[open_] == SKY).all()
    assert (normal[open_] == 0).all() and (depth[alpha > 130] > 0).all()


def test_normals_are_those_of_normal_maps(everything: Path, workspace: Path) -> None:
    """Camera axes x right, y up, z to the viewer: the ground faces up, the left wall right and the right one left."""
    drive = read_imported(workspace / "drive")
    view = shifted(drive_path(drive), beside=0.6, above=0.3)[3]
    depth, kind = true_planes(view.camera, drive.to_world.translation, crowded=False)
    axes = view.camera.world_to_camera[:3, :3] * np.array([[1], [-1], [-1]])
    normal = read_image(everything / "normal/03.png").astype(float) / 127.5 - 1
    column = np.broadcast_to(np.arange(depth.shape[1]), depth.shape)
    middle = depth.shape[1] / 2
    for name, where, world in (
        ("road", kind == ROAD, (0, 0, 1)),
        ("left", (kind == BUILDING) & (column < middle - 8), (0, -1, 0)),
        ("right", (kind == BUILDING) & (column > middle + 8), (0, 1, 0)),
    ):
        near = cv2.erode((where & (depth < 15)).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        assert near.sum() > 150, name
        assert np.median(normal[near] @ (axes @ world)) > 0.98, name


def test_beside_the_street_not_beside_what_the_poses_jitter_to(workspace: Path, tmp_path: Path) -> None:
    """Where the workspace knows the street's path, it tells where right is: here a path at 45 degrees."""
    slanting = tmp_path / "ws"
    shutil.copytree(workspace, slanting)
    heading = np.full(200, np.pi / 4)
    axes = np.eye(3)
    nodes = np.column_stack([np.arange(200.0), np.arange(200.0)]) * np.sqrt(0.5) - 70
    write_ground(DriveGround(StreetPath(axes, nodes, heading, -99.0, 1.0), None, None), slanting / "ground/ground.npz")
    assert main(["render", str(slanting), "--beside", "2", "-o", str(tmp_path / "out")]) == 0
    drive = read_imported(slanting / "drive")
    for before, after in zip(drive.frames, read_camera_path(tmp_path / "out/transforms.json", drive), strict=True):
        np.testing.assert_allclose(after.camera.centre - before.camera.centre, (2**0.5, -(2**0.5), 0), atol=1e-6)


def test_full_has_the_car_and_empty_has_not(workspace: Path, tmp_path: Path) -> None:
    drive = read_imported(workspace / "drive")
    car = true_planes(drive.frames[4].camera, drive.to_world.translation, crowded=True)[1] == CAR
    shown = {}
    for state in ("full", "empty"):
        assert (
            main(["render", str(workspace), "--state", state, "--planes", "rgb,semantics", "-o", str(tmp_path / state)])
            == 0
        )
        shown[state] = read_image(tmp_path / state / "rgb/04.png")[car].astype(int)
        labels = read_label_image(tmp_path / state / "semantics/04.png")
        assert (labels[car] == CAR).mean() > 0.9 if state == "full" else not (labels == CAR).any()
    red = {state: (p[:, 0] - p[:, 1]).mean() for state, p in shown.items()}
    assert red["full"] > 100 and red["empty"] < 20


def test_the_edited_scene_is_what_somebody_left_of_it(
    workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edited = Path(shutil.copytree(workspace, tmp_path / "edited"))
    command = ["render", str(edited), "--state", "edited", "-o", str(tmp_path / "out")]
    assert main(command) == 2 and "Not made yet: the edited scene (edit the Gaussians" in capsys.readouterr().err
    whole = read_surfels(edited / "surfels/empty.ply")
    write_surfels(whole.select(torch.zeros(0, dtype=torch.long)), edited / "surfels/edited.ply")
    assert main([*command, "--planes", "alpha"]) == 0
    assert not any(read_image(path).any() for path in (tmp_path / "out/alpha").glob("*.png"))


def test_its_own_cameras_are_a_path_again(
    everything: Path, workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = read_imported(workspace / "drive")
    views = read_camera_path(everything / "transforms.json", drive)
    expected = shifted(drive_path(drive), beside=0.6, above=0.3)
    for a, b in zip(views, expected, strict=True):
        assert (a.name, a.track) == (b.name, b.track)
        np.testing.assert_allclose(a.camera.world_to_camera, b.camera.world_to_camera, atol=1e-9)
    arguments = [
        "render",
        str(workspace),
        "--path",
        str(everything / "transforms.json"),
        "--json",
        "-o",
        str(tmp_path / "r"),
    ]
    assert main(arguments) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[-1] == {"folder": str(tmp_path / "r"), "views": FRAMES}
    assert [(e["stage"], e["done"], e["total"]) for e in lines[:-1]] == [
        ("render", i + 1, FRAMES) for i in range(FRAMES)
    ]
    for path in sorted((everything / "rgb").iterdir()):
        # Through the file and back, poses differ in their last digits; no picture may, by more than a level.
        assert np.abs(read_image(path).astype(int) - read_image(tmp_path / "r/rgb" / path.name)).max() <= 1
    files = [f["file_path"] for f in json.loads((everything / "transforms.json").read_text())["frames"]]
    assert all((everything / f).is_file() for f in files) and len(set(files)) == FRAMES


def test_cameras_of_a_rig_lie_in_folders_of_their_own(workspace: Path, tmp_path: Path) -> None:
    entry = json.loads((workspace.parent / "street/transforms.json").read_text())["frames"][2]
    frames = [{**entry, "camera": c} for c in ("left", "right")]
    (tmp_path / "rig.json").write_text(json.dumps({"w": 24, "h": 16, "fl_x": 16, "frames": frames}))
    assert main(["render", str(workspace), "--path", str(tmp_path / "rig.json"), "-o", str(tmp_path / "out")]) == 0
    found = sorted(str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*.png"))
    assert found == ["rgb/left/02.png", "rgb/right/02.png"]
    assert cv2.imread(str(tmp_path / "out" / found[0])).shape == (16, 24, 3)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--state", "half"], "invalid choice"),
        (["--planes", "rgb,albedo"], "Not a plane: albedo (use rgb, depth, normal, alpha, semantics)"),
        (["--planes", ","], "no plane is named"),
        (["--beside", "nan"], "nan m beside the path"),
        (["--above=-1e9"], "-1e+09 m above the path (at most 1000 m either way)"),
        (["--path", "nowhere.json"], "nowhere.json: cannot be read"),
        (["--path", "workspace/workspace.json"], "workspace.json: has no cameras"),
        (["-o", "workspace"], "workspace: Not for results: the workspace's own folder (name another one)"),
        (["-o", "workspace/renders/free"], "the workspace's own folder"),
        (["-o", "file"], "file: Not a folder (name a folder)"),
        (["-o", "file/in"], "cannot be written"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    arguments: list[str],
    line: str,
    workspace: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(workspace.parent)
    Path("file").touch()
    before = {p: p.stat().st_mtime_ns for p in workspace.parent.rglob("*")}
    output = [] if "-o" in arguments else ["-o", "elsewhere"]
    assert main(["render", "workspace", *arguments, *output]) == 2
    error = capsys.readouterr().err
    assert line in error and error.count("\n") == 1
    assert {p: p.stat().st_mtime_ns for p in workspace.parent.rglob("*")} == before


def test_a_scene_that_is_not_there_or_damaged(
    workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "workspace"
    shutil.copytree(workspace, copy)
    command = ["render", str(copy), "-o", str(tmp_path / "out")]
    (copy / "surfels/sky.npz").write_bytes(b"PK rubbish")
    assert main(command) == 2
    assert "sky.npz: Not a readable sky" in capsys.readouterr().err
    (copy / "surfels/empty.ply").unlink()
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "empty.ply: Not made yet: the empty scene (run `unveil reoptimize`)" in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()

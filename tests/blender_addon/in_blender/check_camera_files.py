"""Cameras by the batch command, and read back by Blender into an empty file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def command(addon, scene):  # type: ignore[no-untyped-def]
    return addon.module("work.command_line").main


def track(camera, frames: int) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """(N, 4, 4) poses of a camera at frames 1001, 1002, ..., and (N,) tangents of half its horizontal field of view."""
    import bpy

    poses, fields = [], []
    for frame in range(1001, 1001 + frames):
        bpy.context.scene.frame_set(frame)
        seen = camera.evaluated_get(bpy.context.evaluated_depsgraph_get())
        poses.append(np.array(seen.matrix_world))
        fields.append(seen.data.sensor_width / seen.data.lens / 2)
    return np.array(poses), np.array(fields)


def read_back(path: Path):  # type: ignore[no-untyped-def]
    """The camera of a file, in an empty scene."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    if path.suffix == ".abc":
        bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False)
    elif path.suffix == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)
    else:
        bpy.ops.wm.usd_import(filepath=str(path))
    (camera,) = (o for o in bpy.data.objects if o.type == "CAMERA")
    return camera


def test_cameras_come_back(command, addon, street: Path, workspace: Path, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    """Alembic by the command; the others, of the same scene, by what it calls."""
    import bpy

    files = [tmp_path / f"out/cameras.{kind}" for kind in ("abc", "usdc", "fbx")]
    given = ["run", str(street), "-o", str(workspace), "--quality", "draft", "--save-cameras", str(files[0])]
    assert command(given) == 0
    assert str(files[0]) in capfd.readouterr().out
    chosen = {o.name: o.select_get() for o in bpy.context.view_layer.objects}
    for path in files[1:]:
        addon.module("work.command_line")._write_cameras(workspace, path)
    assert {o.name: o.select_get() for o in bpy.context.view_layer.objects} == chosen
    (camera,) = (o for o in bpy.data.objects if o.type == "CAMERA")
    poses, fields = track(camera, 8)
    for path in files:
        told = json.loads(path.with_name(f"{path.name}.json").read_text())
        (frames,) = (entry["frames"] for entry in told["cameras"].values())
        assert [f["frame"] for f in frames] == list(range(1001, 1009)) and told["to_world"]["scale"] == 1
        found, angles = track(read_back(path), 8)
        scale = np.linalg.norm(found[:, :3, :1], axis=1, keepdims=True)
        np.testing.assert_allclose(found[:, :3, 3], poses[:, :3, 3], atol=2e-4, err_msg=path.name)
        np.testing.assert_allclose(found[:, :3, :3] / scale, poses[:, :3, :3], atol=2e-4, err_msg=path.name)
        np.testing.assert_allclose(angles, fields, rtol=1e-4, err_msg=path.name)


def test_another_file_is_refused(command, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    assert command(["run", "x", "-o", str(tmp_path / "ws"), "--save-cameras", "cameras.obj"]) == 2
    assert "cameras.obj: Not a file of cameras (use .abc" in capfd.readouterr().err
    assert command(["doctor", "--save-cameras", "cameras.abc"]) == 2
    assert "--save-cameras goes with the verbs run and import" in capfd.readouterr().err

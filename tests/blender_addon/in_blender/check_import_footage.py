"""Footage without cameras: solved in the worker's process, and imported."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from conftest import ROOT, outside

CLIP = ROOT / "sample_scenes/phone_clip/clip.mp4"


def test_a_clip_becomes_a_drive_in_the_scene(addon, scene, tmp_path: Path) -> None:
    import bpy

    outside("-c", "import pycolmap, av")
    given = {"drive": str(tmp_path / "drive"), "workspace": str(tmp_path / "ws"), "camera_height": 1.5, "every": 6}
    labels = str(CLIP.parent / "labels")
    assert bpy.ops.unveil.import_footage(filepath=str(CLIP), labels=labels, start_frame=1, **given) == {"FINISHED"}
    assert scene.unveil.drive == str(tmp_path / "drive/transforms.json") and scene.frame_start == 1
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    assert len(cameras) == 1 and len(cameras[0].animation_data.action.layers if hasattr(
        cameras[0].animation_data.action, "layers"
    ) else [1]) == 1  # fmt: skip
    facts = json.loads((tmp_path / "drive/solve.json").read_text())
    assert facts["placed"] == facts["frames"] == scene.frame_end > 8 and "1.5" in facts["scale"]
    assert any(o.class_name == "car" for o in scene.unveil_selection.objects)


def test_what_is_no_footage_is_one_line(addon, scene, tmp_path: Path) -> None:
    import bpy

    with pytest.raises(RuntimeError, match="Not found .pick a clip"):
        bpy.ops.unveil.import_footage(filepath=str(tmp_path / "clip.mp4"))
    (tmp_path / "clip.mp4").write_bytes(b"no clip at all" * 100)
    with pytest.raises(RuntimeError, match=r"clip\.mp4") as told:
        bpy.ops.unveil.import_footage(filepath=str(tmp_path / "clip.mp4"))
    assert str(told.value).strip().count("\n") == 0 and not (tmp_path / "clip_drive/transforms.json").exists()


def test_where_the_drive_of_footage_lies(addon, tmp_path: Path) -> None:
    default = addon.module("work.opening.operators_footage").default_drive
    assert default(Path("/shots/street.mp4")) == Path("/shots/street_drive")
    assert default(Path("/shots/photographs")) == Path("/shots/photographs_drive")
    assert default(Path("/shots/street.mp4"), "/work/shot.blend") == Path("/work/street_drive")

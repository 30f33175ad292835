"""Try before you wait: a few frames at draft quality, in a workspace within the workspace."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest


def test_a_preview_shows_frames_and_leaves_the_workspace_alone(addon, scene, street, workspace, tmp_path) -> None:
    import bpy

    with pytest.raises(RuntimeError):
        bpy.ops.unveil.preview()
    for done in ("surfels", "frames", "clean", "meshes", "report"):
        shutil.rmtree(workspace / done)
    state = json.loads((workspace / "workspace.json").read_text())
    for stage in list(state["stages"]):
        if stage not in ("import", "objects"):
            del state["stages"][stage]
    (workspace / "workspace.json").write_text(json.dumps(state))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.unveil.quality, scene.unveil.preview_frames = "standard", "nonsense"
    with pytest.raises(RuntimeError, match="give numbers of frames"):
        bpy.ops.unveil.preview()
    scene.unveil.preview_frames = "1002"
    before = (workspace / "workspace.json").read_bytes()
    assert bpy.ops.unveil.preview() == {"FINISHED"}
    assert (workspace / "workspace.json").read_bytes() == before
    made = json.loads((workspace / "preview/workspace.json").read_text())["settings"]
    assert (made["quality"], made["frames"], made["remove"]) == ("draft", "1:8:2", ["car"])
    assert scene.unveil_view.background == "preview" and scene.unveil.quality == "standard"
    files = [Path(f) for f in addon.module("scene.images.plates").files_of(scene.camera, "preview")]
    names = ["1", "3", "5", "7"]
    assert len(files) == 8 and [i for i, f in enumerate(files) if f.stat().st_size > 200] == [int(n) for n in names]
    for name in names:
        assert files[int(name)].read_bytes() == (workspace / f"preview/clean/camera/0{name}.png").read_bytes()


def test_objects_that_only_their_points_tell_are_previewed_by_their_boxes(addon, scene, workspace) -> None:
    """A part of a drive finds others, under other ids."""
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    (car,) = scene.unveil_selection.objects
    other = scene.unveil_selection.objects.add()
    other.number, other.source, other.class_name, other.chosen, other.boxed = 9, "clusters", "object", True, True
    other.centre, other.size, other.yaw = (4.0, 1.0, 0.5), (2.0, 1.0, 1.5), 0.25
    car.chosen = False
    place = workspace / "preview"
    told = addon.module("choice.selection").preview_arguments(scene, place)
    assert told == ["--instances", "40009", "--marked", str(workspace / "preview.json")]
    (entry,) = json.loads((workspace / "preview.json").read_text())
    offset = json.loads((workspace / "drive/cameras.json").read_text())["to_world"]["translation"]
    assert entry["id"] == 40009 and entry["class"] == "object" and abs(entry["yaw"] - 0.25) < 1e-6
    assert [round(c - o, 4) for c, o in zip(entry["centre"], offset, strict=True)] == [4.0, 1.0, 0.5]
    assert entry["size"] == [2.0, 1.0, 1.5] and not (workspace / "marked.json").exists()

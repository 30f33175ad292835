"""Fixing by hand: painting on a clean frame, marking what is wrong, bringing objects back, settings of single objects."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest


def picture(path: Path) -> np.ndarray:
    """(H, W, 3) in [0, 1] as the file has it, the first row on top."""
    import bpy

    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.is_data = True
        return pixels(image)
    finally:
        bpy.data.images.remove(image)


def pixels(image) -> np.ndarray:  # type: ignore[no-untyped-def]
    width, height = image.size
    found = np.zeros(width * height * image.channels, np.float32)
    image.pixels.foreach_get(found)
    return found.reshape(height, width, image.channels)[::-1, :, :3]


def paint(image, where: np.ndarray, color: tuple[float, float, float]) -> None:  # type: ignore[no-untyped-def]
    """As a brush does: in the image's own memory, which is saved later."""
    width, height = image.size
    found = np.zeros(width * height * image.channels, np.float32)
    image.pixels.foreach_get(found)
    whole = found.reshape(height, width, image.channels)[::-1]
    whole[where, :3] = color
    image.pixels.foreach_set(np.ascontiguousarray(whole[::-1]).ravel())
    image.update()


def test_a_painted_frame_is_followed_by_all_others(addon, scene, workspace, tmp_path) -> None:
    import bpy
    from mathutils import Color

    with pytest.raises(RuntimeError):
        bpy.ops.unveil.paint_frame()
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    before = [picture(workspace / f"frames/camera/{i:02d}.png") for i in range(8)]
    scene.frame_set(1004)
    assert bpy.ops.unveil.paint_frame() == {"FINISHED"}
    (fix,) = scene.unveil_selection.fixes
    assert (fix.name, fix.track, fix.frame, fix.time) == ("camera, frame 1004", "camera", "03", 1004)
    removed = picture(workspace / "masks/removed/camera/03.png")[..., 0] > 0.5
    ground = np.median(before[3][removed], axis=0)
    shared = getattr(bpy.context.tool_settings.image_paint, "unified_paint_settings", None)
    shared = shared or bpy.context.tool_settings.unified_paint_settings
    found = np.array(shared.color)
    if shared.bl_rna.properties["color"].subtype == "COLOR":  # scene linear
        found = np.array(Color(found).from_scene_linear_to_srgb())
    assert (
        removed.sum() > 50 and np.abs(found - ground).max() < 1 / 255
    )  # the brush begins with the colour of what was filled
    where = np.zeros((80, 128), bool)
    where[56:66, 50:80] = True  # the road ahead
    paint(fix.image, where, (0.0, 1.0, 0.0))
    assert fix.image.is_dirty
    states = addon.module("work.stage_states").stage_states
    assert {n for n, s in states(scene).stages.items() if s.state == "stale"} == {
        "reoptimize",
        "deliver",
        "mesh",
        "report",
    }
    assert bpy.ops.unveil.run() == {"FINISHED"}
    assert {s.state for s in states(scene).stages.values()} == {"done"}
    after = [picture(workspace / f"frames/camera/{i:02d}.png") for i in range(8)]
    assert np.abs(after[3][where] - (0, 1, 0)).max() < 0.01
    green = [((a[..., 1] > 0.7) & (a[..., 0] < 0.35)).sum() for a in after]
    assert sum(count > 40 for count in green) >= 4 and not any(
        ((b[..., 1] > 0.7) & (b[..., 0] < 0.35)).any() for b in before
    )
    # Another file finds what was painted; what is forgotten is forgotten.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    (fix,) = scene.unveil_selection.fixes
    assert (fix.frame, fix.time, fix.invent) == ("03", 1004, False)
    assert np.abs(pixels(fix.image)[where] - (0, 1, 0)).max() < 0.01
    assert {s.state for s in states(scene).stages.values()} == {"done"}
    scene.frame_set(1004)
    bpy.ops.unveil.paint_frame()  # goes on with the same copy
    assert len(scene.unveil_selection.fixes) == 1
    fix = scene.unveil_selection.fixes[0]
    fix.invent = True
    arguments = addon.module("choice.selection").arguments(scene)
    assert arguments[-2:] == ["--corrections", str(workspace / "corrections.json")]
    assert json.loads((workspace / "corrections.json").read_text())[0]["invent"] is True
    bpy.ops.unveil.forget_fix(index=0)
    from check_run import drawn

    assert "Redo without It" in drawn(addon.module("ui.panel_fixes").UNVEIL_PT_fixes)
    assert not (workspace / "corrections.json").exists() and "--corrections" not in addon.module(
        "choice.selection"
    ).arguments(scene)


def test_paint_is_not_written_over(addon, scene, workspace) -> None:
    """Painted, saved, and lost from the list: by undo, or for the .blend was left unsaved."""
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1004)
    bpy.ops.unveil.paint_frame()
    copy = workspace / "corrections/camera/03.png"
    where = np.zeros((80, 128), bool)
    where[56:66, 50:80] = True
    paint(scene.unveil_selection.fixes[0].image, where, (0.0, 1.0, 0.0))
    scene.unveil_selection.fixes[0].image.save()
    painted = copy.read_bytes()
    assert painted != (workspace / "corrections/camera/03_before.png").read_bytes()
    scene.unveil_selection.fixes.clear()
    assert bpy.ops.unveil.paint_frame() == {"FINISHED"}
    assert copy.read_bytes() == painted and len(scene.unveil_selection.fixes) == 1
    # What is painted and not saved yet is in no file, and stays in the picture.
    paint(scene.unveil_selection.fixes[0].image, where, (1.0, 0.0, 0.0))
    scene.unveil_selection.fixes.clear()
    bpy.ops.unveil.paint_frame()
    assert np.abs(pixels(scene.unveil_selection.fixes[0].image)[where] - (1, 0, 0)).max() < 0.01
    # What is forgotten begins anew; the paint is kept aside.
    bpy.ops.unveil.forget_fix(index=0)
    assert copy.read_bytes() == painted  # it can be undone
    bpy.ops.unveil.paint_frame()
    assert copy.read_bytes() == (workspace / "frames/camera/03.png").read_bytes()
    assert (workspace / "corrections/camera/03_forgotten.png").read_bytes() == painted
    assert not (workspace / "corrections/camera/03_forgotten").exists()


def test_settings_of_single_objects(addon, scene, workspace) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    (car,) = scene.unveil_selection.objects
    car.grow, car.keep_shadow = 6, True
    selection, states = addon.module("choice.selection"), addon.module("work.stage_states").stage_states
    assert selection.arguments(scene)[-2:] == ["--per-object", "5:grow=6,5:shadow=keep"]
    stale = {n for n, s in states(scene).stages.items() if s.state == "stale"}
    assert {"remove", "inpaint"} <= stale and not {"import", "reconstruct", "instances"} & stale
    assert bpy.ops.unveil.stage(stage="remove") == {"FINISHED"}
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    (car,) = bpy.context.scene.unveil_selection.objects
    assert (car.grow, car.keep_shadow) == (6, True)


@pytest.mark.parametrize("told", ["{", "{}", '[{"camera": "../..", "frame": "03"}]', '[{"camera": 3, "frame": "03"}]'])
def test_a_damaged_list_of_fixes_is_one_line(addon, scene, workspace, told: str) -> None:
    import bpy

    (workspace / "corrections.json").write_text(told)
    with pytest.raises(RuntimeError, match=r"corrections\.json"):
        bpy.ops.unveil.load_workspace(directory=str(workspace))

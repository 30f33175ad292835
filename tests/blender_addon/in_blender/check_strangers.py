"""A stranger's workspace in Blender: nothing is waited for, and what is painted is written to no file but its own."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from check_fixes import paint, pixels

SECRET = b"precious\n" * 100


@pytest.fixture
def outside_file(tmp_path: Path) -> Path:
    path = tmp_path / "bashrc"
    path.write_bytes(SECRET)
    return path


def opened(workspace: Path):  # type: ignore[no-untyped-def]
    """Load a workspace and look at its fourth frame."""
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.context.scene.frame_set(1004)


@pytest.mark.parametrize("make", ["pipe", "zero", "link"])
@pytest.mark.parametrize(
    "name",
    [
        "objects.json",
        "drive/cameras.json",
        "drive/points.ply",
        "frames/camera/03.png",
        "masks/removed/camera/03.png",
        "meshes/empty.ply",
        "objects/point_labels.npy",
        "corrections.json",
        "workspace.json",
    ],
)
def test_a_file_that_is_none_is_one_line(addon, scene, workspace, outside_file, make: str, name: str) -> None:
    import bpy

    path = workspace / name
    path.unlink(missing_ok=True)
    if make == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero" if make == "zero" else outside_file)
    if name == "workspace.json":  # it is enough that the panel is drawn
        scene.unveil.workspace = str(workspace)
        assert "Not readable" in addon.module("worker.workspace_state").read(workspace).problem
    with pytest.raises(RuntimeError, match=f"{path.name}|no workspace|workspace"):
        bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert outside_file.read_bytes() == SECRET


@pytest.mark.parametrize("name", ["03.png", "03_before.png"])
@pytest.mark.parametrize("make", ["symbolic", "hard"])
def test_painting_begins_in_new_files(addon, scene, workspace, outside_file, make: str, name: str) -> None:
    """The copy is made where a link lies: it takes the link's place, or the workspace is refused."""
    import bpy

    opened(workspace)
    (workspace / "corrections/camera").mkdir(parents=True)
    link = workspace / "corrections/camera" / name
    (link.symlink_to if make == "symbolic" else link.hardlink_to)(outside_file)
    if make == "symbolic":
        with pytest.raises(RuntimeError, match="is a link"):
            bpy.ops.unveil.paint_frame()
    else:
        assert bpy.ops.unveil.paint_frame() == {"FINISHED"}
        assert link.read_bytes() == (workspace / "frames/camera/03.png").read_bytes()
    assert outside_file.read_bytes() == SECRET


@pytest.mark.parametrize("make", ["symbolic", "hard", "pipe", "text"])
def test_nothing_but_a_clean_frame_is_painted_on(addon, scene, workspace, outside_file, make: str) -> None:
    import bpy

    opened(workspace)
    frame = workspace / "frames/camera/03.png"
    frame.unlink()
    if make == "pipe":
        os.mkfifo(frame)
    elif make == "text":
        frame.write_bytes(SECRET)
    else:
        (frame.symlink_to if make == "symbolic" else frame.hardlink_to)(outside_file)
    with pytest.raises(RuntimeError, match=r"03\.png"):
        bpy.ops.unveil.paint_frame()
    assert not [p for p in workspace.rglob("*") if p.is_file() and p != frame and SECRET in p.read_bytes()]


@pytest.mark.parametrize("make", ["hard", "symbolic"])
def test_what_is_painted_is_saved_into_the_copy_alone(addon, scene, workspace, outside_file, make: str) -> None:
    import bpy

    opened(workspace)
    bpy.ops.unveil.paint_frame()
    (fix,) = scene.unveil_selection.fixes
    copy = workspace / "corrections/camera/03.png"
    where = np_mask()
    paint(fix.image, where, (0.0, 1.0, 0.0))
    shutil.copy(copy, outside_file)
    before = outside_file.read_bytes()
    copy.unlink()
    (copy.symlink_to if make == "symbolic" else copy.hardlink_to)(outside_file)
    write = addon.module("choice.fixes").write
    if make == "symbolic":
        with pytest.raises((OSError, ValueError), match=r"03\.png"):
            write(scene)
    else:
        write(scene)
        assert copy.read_bytes() != before and copy.stat().st_nlink == 1
    assert outside_file.read_bytes() == before


def test_a_blend_that_says_another_file_is_painted_on_is_not_believed(addon, scene, workspace, outside_file) -> None:
    import bpy

    opened(workspace)
    bpy.ops.unveil.paint_frame()
    (fix,) = scene.unveil_selection.fixes
    assert pixels(fix.image).shape == (80, 128, 3)  # is loaded
    paint(fix.image, np_mask(), (0.0, 1.0, 0.0))
    fix.image.filepath_raw = str(outside_file)
    with pytest.raises(ValueError, match="Not the copy that is painted on"):
        addon.module("choice.fixes").write(scene)
    fix.frame = "../../../bashrc"
    with pytest.raises(ValueError, match="is not a file name"):
        addon.module("choice.fixes").write(scene)
    assert outside_file.read_bytes() == SECRET


def of_a_blend(role: str, file: Path):  # type: ignore[no-untyped-def]
    """A picture as a stranger's .blend may hold it: it plays a role, and is of any file."""
    import bpy

    image = bpy.data.images.load(str(file), check_existing=False)
    (collection,) = (c for c in bpy.data.collections if c.get("unveil_role") == "drive")
    image["unveil_role"], image["unveil_drive"] = role, collection["unveil_drive"]
    return image


@pytest.mark.parametrize("make", ["nothing", "hard", "before"])
@pytest.mark.parametrize("source", ["FILE", "SEQUENCE", "TILED"])
def test_a_mask_is_painted_in_its_own_copy_alone(addon, scene, workspace, tmp_path, make: str, source: str) -> None:
    """Also by Blender's own Save, whatever picture the .blend has for it, and wherever its name leads."""
    import bpy

    opened(workspace)
    mine = Path(shutil.copy(workspace / "frames/camera/05.png", tmp_path / "mine.1001.png"))
    before = mine.read_bytes()
    image = of_a_blend("mask:camera:03", mine)
    image.source = source
    copy = workspace / "outlines/drawn/painted/camera/03.png"
    copy.parent.mkdir(parents=True)
    if make == "hard":
        copy.hardlink_to(mine)
    elif make == "before":
        copy.with_name("03_before.png").symlink_to(mine)
        with pytest.raises(RuntimeError, match="is a link"):
            bpy.ops.unveil.paint_mask()
        copy.with_name("03_before.png").unlink()
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"}
    (image,) = (i for i in bpy.data.images if i.get("unveil_role") == "mask:camera:03")
    paint(image, np_mask(), (0.0, 1.0, 0.0))
    painted_on = copy.read_bytes()
    image.save()
    assert mine.read_bytes() == before and copy.read_bytes() != painted_on


def test_a_frame_is_painted_in_its_own_copy_alone(addon, scene, workspace, tmp_path) -> None:
    import bpy

    opened(workspace)
    bpy.ops.unveil.paint_frame()
    (fix,) = scene.unveil_selection.fixes
    mine = Path(shutil.copy(workspace / "frames/camera/05.png", tmp_path / "mine.png"))
    before = mine.read_bytes()
    fix.image.filepath, fix.invent = str(mine), True
    assert bpy.ops.unveil.paint_frame() == {"FINISHED"}
    (fix,) = scene.unveil_selection.fixes
    assert fix.invent
    paint(fix.image, np_mask(), (0.0, 1.0, 0.0))
    fix.image.save()
    assert mine.read_bytes() == before
    copy = workspace / "corrections/camera/03.png"
    assert copy.read_bytes() != (workspace / "frames/camera/03.png").read_bytes()


def test_what_was_packed_is_saved_into_the_copy(addon, scene, workspace) -> None:
    """As a .blend does that packs its pictures: they count as saved, and are in no file."""
    import bpy

    opened(workspace)
    bpy.ops.unveil.paint_frame()
    (fix,) = scene.unveil_selection.fixes
    paint(fix.image, np_mask(), (0.0, 1.0, 0.0))
    fix.image.pack()
    assert not fix.image.is_dirty
    assert bpy.ops.unveil.paint_frame() == {"FINISHED"}
    addon.module("choice.fixes").write(scene)
    copy = bpy.data.images.load(str(workspace / "corrections/camera/03.png"))
    assert pixels(copy)[60, 60] == pytest.approx((0.0, 1.0, 0.0), abs=0.01)


def test_masks_are_painted_for_frames_of_the_drive_alone(addon, scene, workspace, tmp_path) -> None:
    import bpy

    opened(workspace)
    mine = Path(shutil.copy(workspace / "frames/camera/05.png", tmp_path / "mine.png"))
    shutil.copy(workspace / "frames/camera/03.png", tmp_path / "mine_before.png")
    before = mine.read_bytes()
    for name in ("painted", "painted_mattes"):
        (workspace / f"outlines/drawn/{name}/camera").mkdir(parents=True)
    up = os.path.relpath(tmp_path, workspace / "outlines/drawn/painted/camera")
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "IMAGE_EDITOR"
    area.spaces.active.image = of_a_blend(f"mask:camera:{up}/mine", mine)
    with (
        bpy.context.temp_override(window=window, area=area),
        pytest.raises(RuntimeError, match="No mask of this frame was painted"),
    ):
        bpy.ops.unveil.use_painted()
    assert mine.read_bytes() == before


def np_mask():  # type: ignore[no-untyped-def]
    import numpy as np

    where = np.zeros((80, 128), bool)
    where[56:66, 50:80] = True
    return where

"""Objects that the artist draws in the mask editor, or paints over: pictures in the footage's size, carried into all frames."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import numpy as np
import pytest

BOX = (0.35, 0.55, 0.30, 0.50)
"""Left, right, upper and lower edge of what is drawn, as shares of the picture from its upper left corner."""


def pixels(path: Path) -> np.ndarray:
    import bpy

    image = bpy.data.images.load(str(path), check_existing=False)
    image.colorspace_settings.is_data = True
    width, height = image.size
    found = np.array(image.pixels[:], np.float32).reshape(height, width, -1)[::-1, :, 0]
    bpy.data.images.remove(image)
    return found


def edges(white: np.ndarray) -> tuple[float, float, float, float]:
    rows, columns = np.nonzero(white > 0.5)
    height, width = white.shape
    return (
        columns.min() / width, (columns.max() + 1) / width, rows.min() / height, (rows.max() + 1) / height,
    )  # fmt: skip


def drawn_mask(name: str, aspect: float, box: tuple[float, float, float, float] = BOX):  # type: ignore[no-untyped-def]
    """A mask with straight edges, as the editor has it over pictures that are wider than high: its unit is their width."""
    import bpy

    mask = bpy.data.masks.new(name)
    spline = mask.layers.new(name="layer").splines.new()
    spline.use_cyclic = True
    left, right, upper, lower = box
    spline.points.add(3)
    y = [0.5 + (0.5 - v) / aspect for v in (upper, lower)]
    for point, place in zip(spline.points, ((left, y[1]), (right, y[1]), (right, y[0]), (left, y[0])), strict=True):
        point.handle_left_type = point.handle_right_type = "FREE"
        point.co = point.handle_left = point.handle_right = place
    return mask


def test_a_mask_is_drawn_where_the_editor_shows_it(addon, scene, tmp_path: Path) -> None:
    import bpy

    mask = drawn_mask("sign", 160 / 100)
    files = [tmp_path / "3.png", tmp_path / "4.png"]
    there = len(bpy.data.scenes), len(bpy.data.node_groups)
    addon.module("scene.images.mask_pictures").draw_mask(mask, (160, 100), [3, 4], files)
    for file in files:
        white = pixels(file)
        assert white.shape == (100, 160) and set(np.unique(white)) >= {0.0, 1.0}
        assert np.allclose(edges(white), BOX, atol=0.02)
    assert (len(bpy.data.scenes), len(bpy.data.node_groups)) == there


def test_a_drawn_mask_becomes_an_object_in_all_frames(addon, scene, workspace) -> None:
    import bpy
    from check_outline import red_car

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1003)
    with pytest.raises(RuntimeError, match="No mask to take"):
        bpy.ops.unveil.use_mask()
    places = np.array(red_car(workspace / "drive/images/camera/02.png"))
    (left, upper), (right, lower) = places.min(axis=0) - 0.02, places.max(axis=0) + 0.02
    mask = drawn_mask("painted", 128 / 80, (left, right, upper, lower))  # a name that pictures beside have
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"}
    copies = sorted((workspace / "outlines/drawn/painted/camera").iterdir())
    assert bpy.ops.unveil.use_mask() == {"FINISHED"}
    assert sorted((workspace / "outlines/drawn/painted/camera").iterdir()) == copies
    listed = scene.unveil_selection
    thing = listed.objects[listed.active]
    assert (thing.class_name, thing.source, thing.chosen) == ("painted", "mattes", True) and thing.frames == 8
    drawn = [p.name for p in (workspace / "outlines/drawn/masks/painted/camera").glob("*.png")]
    assert drawn == ["02.png"]  # the others follow through the scene
    mattes = sorted(Path(thing.mattes).rglob("*.png"))
    assert len(mattes) == 8 and (pixels(mattes[4]) > 0.5).any()
    assert bpy.ops.unveil.use_mask(animated=True) == {"FINISHED"}
    drawn = sorted((workspace / "outlines/drawn/masks/painted/camera").glob("*.png"))
    assert len(drawn) == 8
    drawn[3].write_bytes(b"retouched")
    with pytest.raises(RuntimeError, match=r"03\.png: Changed since Unveil wrote it, .*give the mask another name"):
        bpy.ops.unveil.use_mask()
    mask.name = "other"
    mine = workspace / "outlines/drawn/masks/other/camera/07.png"
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"mine")
    with pytest.raises(RuntimeError, match=r"07\.png: Not written by Unveil"):
        bpy.ops.unveil.use_mask()
    assert (
        drawn[3].read_bytes() == b"retouched" and mine.read_bytes() == b"mine" and len(list(mine.parent.iterdir())) == 1
    )


def test_an_empty_mask_is_told(addon, scene, workspace) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.data.masks.new("nothing")
    with pytest.raises(RuntimeError, match="mask nothing is empty"):
        bpy.ops.unveil.use_mask(mask="nothing")
    with pytest.raises(RuntimeError, match="Not found: the mask elsewhere"):
        bpy.ops.unveil.use_mask(mask="elsewhere")


@pytest.mark.parametrize("kind", ["JPEG", "TIFF", "PNG"])
def test_footage_of_each_kind_is_painted_on_in_private(addon, scene, workspace, kind: str) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1003)
    photograph = addon.module("formats.drive_files").read_drive(workspace).tracks["camera"][2].footage
    image = bpy.data.images.load(str(photograph), check_existing=False)
    image.update()
    image.file_format = kind
    image.save()
    bpy.data.images.remove(image)
    photograph.chmod(0o600)
    before = photograph.read_bytes()
    assert before.startswith({"JPEG": b"\xff\xd8", "TIFF": b"II", "PNG": b"\x89PNG"}[kind])
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"}
    made = [workspace / f"outlines/drawn/painted/camera/02{end}.png" for end in ("", "_before")]
    for file in made:
        assert file.read_bytes().startswith(b"\x89PNG") and np.array_equal(pixels(file), pixels(photograph))
        assert os.name == "nt" or stat.S_IMODE(file.stat().st_mode) == 0o600
    assert photograph.read_bytes() == before


def test_a_copy_that_somebody_put_there_is_kept_aside(addon, scene, workspace) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1003)
    folder = workspace / "outlines/drawn/painted/camera"
    folder.mkdir(parents=True)
    (folder / "02.png").write_bytes(b"mine")
    (folder / "02_forgotten.png").write_bytes(b"of earlier")
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"}
    assert (folder / "02_forgotten_2.png").read_bytes() == b"mine"
    assert (folder / "02_forgotten.png").read_bytes() == b"of earlier"


def test_what_is_painted_over_becomes_an_object(addon, scene, workspace) -> None:
    import bpy
    from check_fixes import paint
    from check_outline import red_car

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1003)
    with pytest.raises(RuntimeError, match="No mask of this frame was painted"):
        bpy.ops.unveil.use_painted()
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"}
    (image,) = [i for i in bpy.data.images if str(i.get("unveil_role", "")).startswith("mask:")]
    photograph = addon.module("formats.drive_files").read_drive(workspace).tracks["camera"][2].footage
    before = photograph.read_bytes()
    with pytest.raises(RuntimeError, match="Nothing was painted"):
        bpy.ops.unveil.use_painted()
    places = np.array(red_car(workspace / "drive/images/camera/02.png"))
    (left, upper), (right, lower) = (
        (places * (128, 80)).min(axis=0).astype(int),
        (places * (128, 80)).max(axis=0).astype(int),
    )
    where = np.zeros((80, 128), bool)
    where[upper : lower + 1, left : right + 1] = True
    paint(image, where, (0.0, 1.0, 0.0))
    assert bpy.ops.unveil.paint_mask() == {"FINISHED"} and image.is_dirty  # it goes on
    assert bpy.ops.unveil.use_painted(class_name="painted car") == {"FINISHED"}
    file = workspace / "outlines/drawn/painted_mattes/camera/02.png"
    assert np.array_equal(pixels(file) > 0.5, where)
    file.write_bytes(b"retouched")
    with pytest.raises(RuntimeError, match=r"02\.png: Changed since Unveil wrote it"):
        bpy.ops.unveil.use_painted(class_name="painted car")
    assert file.read_bytes() == b"retouched"
    listed = scene.unveil_selection
    thing = listed.objects[listed.active]
    assert (thing.class_name, thing.source, thing.frames, thing.chosen) == ("painted car", "mattes", 8, True)
    assert photograph.read_bytes() == before  # it is a copy that is painted on

"""An object by clicks: outlined in all frames by the worker, listed as mattes, and told to the run in the footage's lens."""

from __future__ import annotations

import json

import numpy as np
import pytest


def red_car(path) -> list[tuple[float, float]]:  # type: ignore[no-untyped-def]
    """Three places on the red car, as shares of the picture from its upper left corner."""
    import bpy

    image = bpy.data.images.load(str(path))
    try:
        width, height = image.size
        found = np.zeros(width * height * image.channels, np.float32)
        image.pixels.foreach_get(found)
    finally:
        bpy.data.images.remove(image)
    colours = found.reshape(height, width, -1)[::-1]
    rows, columns = np.nonzero((colours[..., 0] > 0.5) & (colours[..., 1] < 0.3))
    some = [len(rows) // 5, len(rows) // 2, 4 * len(rows) // 5]
    return [((columns[k] + 0.5) / width, (rows[k] + 0.5) / height) for k in some]


def test_clicks_become_an_object_of_the_list(addon, scene, workspace, tmp_path) -> None:
    import bpy

    with pytest.raises(RuntimeError):
        bpy.ops.unveil.outline_object(inside="0.5,0.5")
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    scene.frame_set(1003)
    with pytest.raises(RuntimeError, match="Nothing was clicked"):
        bpy.ops.unveil.outline_object()
    inside = "; ".join(f"{x:.4f},{y:.4f}" for x, y in red_car(workspace / "drive/images/camera/02.png"))
    assert bpy.ops.unveil.outline_object(class_name="red car", inside=inside) == {"FINISHED"}
    listed = scene.unveil_selection
    thing = listed.objects[listed.active]
    assert (thing.class_name, thing.source, thing.frames, thing.chosen) == ("red car", "mattes", 8, True)
    assert thing.mattes.endswith("outlines/mattes/red_car")
    count = len(listed.objects)
    assert bpy.ops.unveil.outline_object(class_name="red car", inside=inside, outside="0.02,0.95") == {"FINISHED"}
    assert len(listed.objects) == count
    marks = addon.module("choice.marks")
    path = marks.write_marked(workspace, listed.objects, into=tmp_path / "marked.json")
    (entry,) = [e for e in json.loads(path.read_text()) if e["class"] == "red car"]
    assert entry["of"] == "footage" and entry["mattes"].endswith("outlines/mattes/red_car")


def test_a_click_is_a_share_of_the_picture(addon, scene, workspace, monkeypatch) -> None:
    """The camera's frame in the view, twice as wide as high, from 100,50 to 300,150."""
    import bpy
    from mathutils import Vector

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    clicks = addon.module("choice.picture_clicks")
    corners = iter([Vector((300, 150)), Vector((300, 50)), Vector((100, 50)), Vector((100, 150))] * 2)
    monkeypatch.setattr(clicks, "location_3d_to_region_2d", lambda *_: next(corners))

    class Context:
        region = region_data = None

    Context.scene = scene  # type: ignore[attr-defined]
    assert clicks.share_of_picture(Context, 150, 125) == (0.25, 0.25)
    assert clicks.share_of_picture(Context, 50, 125) is None

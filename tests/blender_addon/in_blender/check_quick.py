"""Choosing many objects quickly: the list filtered and sorted, similar ones, a rectangle, one's settings for all."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

CARS = ((1, "car", 4.0, 5.0, 8), (2, "car", 4.4, 12.0, 3), (3, "car", 9.0, 30.0, 6), (4, "person", 1.8, 8.0, 2))
"""Number, class, longest side and distance in metres, frames."""


@pytest.fixture
def listed(addon, scene, workspace: Path):  # type: ignore[no-untyped-def]
    """The list of a workspace with four objects in a row along the street, none of them chosen."""
    import bpy

    document = json.loads((workspace / "objects.json").read_text())
    (car,) = document["objects"]
    document["objects"] = [{**car, "id": number, "class": name} for number, name, *_ in CARS]
    (workspace / "objects.json").write_text(json.dumps(document))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    found = scene.unveil_selection
    for (number, _, length, away, frames), thing in zip(CARS, found.objects, strict=True):
        thing.size, thing.distance, thing.frames, thing.chosen = (length, 1.0, 1.0), away, frames, False
        thing.centre = scene.camera.matrix_world @ __import__("mathutils").Vector((-6 + 2.4 * number, 0, -20))
    bpy.context.view_layer.update()
    return found


def chosen(listed) -> list[int]:  # type: ignore[no-untyped-def]
    return sorted(o.number for o in listed.objects if o.chosen)


def through_camera(scene, width: int = 320, height: int = 200):  # type: ignore[no-untyped-def]
    """A context that sees what the camera does."""
    import bpy

    graph, camera = bpy.context.evaluated_depsgraph_get(), scene.camera
    matrix = camera.calc_matrix_camera(graph, x=width, y=height) @ camera.matrix_world.inverted()
    return SimpleNamespace(
        scene=scene,
        region=SimpleNamespace(width=width, height=height),
        region_data=SimpleNamespace(perspective_matrix=matrix),
    )


def test_the_list_is_filtered(addon, scene, listed) -> None:
    filters, wanted = addon.module("choice.quick.filters"), listed.filter
    cases = (
        ({}, [1, 2, 3, 4]),
        ({"class_name": "car"}, [1, 2, 3]),
        ({"smallest": 4.2}, [2, 3]),
        ({"farthest": 10}, [1, 4]),
        ({"fewest": 3, "class_name": "car", "farthest": 20}, [1, 2]),
    )
    for values, left in cases:
        for name in ("class_name", "smallest", "farthest", "fewest"):
            wanted.property_unset(name)
        for name, value in values.items():
            setattr(wanted, name, value)
        assert (np.flatnonzero(filters.shown(listed, 1.0)) + 1).tolist() == left, values
    listed.objects[0].distance = -1  # nobody knows: asked for, it is not near
    wanted.farthest, wanted.fewest, wanted.class_name = 10, 0, ""
    assert (np.flatnonzero(filters.shown(listed, 1.0)) + 1).tolist() == [4]


def test_the_list_is_sorted_by_any_column(addon, scene, listed) -> None:
    import bpy

    filters = addon.module("choice.quick.filters")
    listed.objects[3].chosen = True
    cases = {
        "SIZE": [3, 2, 1, 4],
        "AWAY": [1, 4, 2, 3],
        "SEEN": [1, 3, 2, 4],
        "NAME": [1, 2, 3, 4],
        "GOES": [4, 1, 2, 3],
    }
    for name, numbers in cases.items():
        listed.filter.sort = name
        for reverse in (False, True):
            listed.filter.reverse = reverse
            places = filters.ranks(listed, 1.0)
            shown = [n for _, n in sorted(zip(places, (o.number for o in listed.objects), strict=True))]
            assert shown == (numbers[::-1] if reverse else numbers), name
    listed.filter.sort, listed.filter.reverse = "NONE", False
    assert filters.ranks(listed, 1.0) == []
    panel = addon.module("ui.panel_selection").UNVEIL_UL_objects
    stand_in = SimpleNamespace(bitflag_filter_item=1, filter_name="person")
    assert panel.filter_items(stand_in, bpy.context, listed, "objects")[0] == [0, 0, 0, 1]


def test_similar_ones_go_together(addon, scene, listed) -> None:
    import bpy

    listed.active = 0
    assert bpy.ops.unveil.choose_similar() == {"FINISHED"}
    assert chosen(listed) == [1, 2]  # the third is a bus, the fourth a person
    bpy.ops.unveil.choose_similar(tolerance=0.05, chosen=False)
    assert chosen(listed) == [2]
    listed.filter.farthest = 10
    bpy.ops.unveil.choose_shown()
    assert chosen(listed) == [1, 2, 4]
    bpy.ops.unveil.choose_shown(chosen=False)
    assert chosen(listed) == [2]
    bpy.ops.unveil.choose(which="NONE")
    bpy.ops.unveil.choose(which="MOVABLE")
    assert chosen(listed) == [1, 2, 3, 4]


def test_a_rectangle_takes_what_is_in_it(addon, scene, listed) -> None:
    """The boxes stand from left to right; the left half of the picture holds two."""
    operators, boxes = addon.module("choice.quick.operators_quick"), addon.module("formats.boxes")
    context = through_camera(scene)
    corners, indices = addon.module("choice.box_gizmos").corners_shown(context)
    perspective = np.array(context.region_data.perspective_matrix)
    inside = boxes.within((0, 0, 160, 200), corners, perspective, (320, 200))
    assert (indices[inside] + 1).tolist() == [1, 2]
    stand_in = SimpleNamespace(left=0, bottom=0, right=160, top=200, chosen=True, report=lambda *_: None)
    stand_in.choose = lambda *words: operators._OfList.choose(stand_in, *words)
    assert operators.UNVEIL_OT_choose_in_box.execute(stand_in, context) == {"FINISHED"}
    assert chosen(listed) == [1, 2]
    stand_in.left, stand_in.right, stand_in.chosen = 40, 320, False
    operators.UNVEIL_OT_choose_in_box.execute(stand_in, context)
    assert 2 not in chosen(listed)


def test_one_objects_settings_are_copied_to_all_that_go(addon, scene, listed) -> None:
    import bpy

    listed.objects[1].chosen = listed.objects[2].chosen = True
    listed.active = 1
    listed.objects[1].grow, listed.objects[1].keep_shadow = 7, True
    assert bpy.ops.unveil.set_like_active() == {"FINISHED"}
    assert [(o.grow, o.keep_shadow) for o in listed.objects] == [(0, False), (7, True), (7, True), (0, False)]


def test_after_shows_the_result_and_not_boxes(addon, scene, listed) -> None:
    import bpy

    gizmos = addon.module("choice.box_gizmos")
    listed.active = 1
    scene.unveil_view.state = "BEFORE"
    assert sum(len(ends) for ends, _, _ in gizmos.lines_of(bpy.context, None)) == 4 * 24
    scene.unveil_view.state = "AFTER"
    assert sum(len(ends) for ends, _, _ in gizmos.lines_of(bpy.context, None)) == 24  # the active one
    assert sum(len(ends) for ends, _, _ in gizmos.lines_of(bpy.context, 4)) == 2 * 24  # and what is pointed at
    listed.objects[0].chosen = listed.objects[3].chosen = True
    listed.boxes = "GOING"
    assert sum(len(ends) for ends, _, _ in gizmos.lines_of(bpy.context, None)) == 2 * 24
    assert len(gizmos.ghosts_of(bpy.context)) == 0
    listed.ghosts = True
    assert len(gizmos.ghosts_of(bpy.context)) == 2 * 36
    listed.boxes = "ACTIVE"
    assert sum(len(ends) for ends, _, _ in gizmos.lines_of(bpy.context, None)) == 24
    listed.boxes = "NONE"
    assert gizmos.lines_of(bpy.context, None) == []


def test_what_goes_is_told_as_a_table(addon, scene, listed) -> None:
    lines = addon.module("ui.telling.report_lines")
    for i in (2, 0):
        listed.objects[i].chosen = True
    assert lines.what_goes(scene) == [
        ("Object", "Size", "Nearest", "Frames"),
        ("car 1", "4.0 m", "5 m", "8"),
        ("car 3", "9.0 m", "30 m", "6"),
    ]


def test_an_object_of_the_artists_takes_the_click(addon, scene, listed, monkeypatch) -> None:
    """A cube inside a car's box: with any tool but ours a click is for the cube."""
    import bpy
    from mathutils import Vector

    gizmos = addon.module("choice.box_gizmos")
    centre = Vector(listed.objects[1].centre)
    camera = scene.camera.matrix_world.translation
    view3d = __import__("bpy_extras.view3d_utils", fromlist=["x"])
    monkeypatch.setattr(view3d, "region_2d_to_origin_3d", lambda *_: camera.copy())
    monkeypatch.setattr(view3d, "region_2d_to_vector_3d", lambda *_: (centre - camera).normalized())
    context = SimpleNamespace(
        scene=scene, region=None, region_data=None, evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get
    )
    scene.unveil_view.shown, scene.unveil_view.state = {"MESH"}, "AFTER"
    bpy.context.view_layer.update()
    assert not gizmos.hits_artists_object(context, (0.0, 0.0))  # the street's own mesh is no obstacle
    bpy.ops.mesh.primitive_cube_add(size=0.5, location=centre)
    assert gizmos.hits_artists_object(context, (0.0, 0.0))

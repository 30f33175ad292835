"""Big drives, with caps low enough for a small one: what is shown is decimated, and what has not changed is not read again."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from conftest import outside

CAPS = {"scene.drive_scene": {"MOST_POINTS": 500}, "scene.results": {"MOST_TRIANGLES": 2000}}


@pytest.fixture
def loaded(addon, scene, workspace, monkeypatch):  # type: ignore[no-untyped-def]
    """The workspace, loaded with these caps."""
    import bpy

    for module, values in CAPS.items():
        for name, value in values.items():
            monkeypatch.setattr(addon.module(module), name, value)
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    return workspace


def places(mesh) -> np.ndarray:  # type: ignore[no-untyped-def]
    found = np.zeros(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", found)
    return found.reshape(-1, 3)


def test_the_view_has_less_and_the_files_all(addon, scene, loaded: Path) -> None:
    import bpy

    read_ply = addon.module("formats.ply_file").read_ply
    for state, name in (("full", "before"), ("empty", "after")):
        thing = bpy.data.objects[f"Mesh {name}"]
        file = read_ply(loaded / f"meshes/{state}.ply")
        assert thing["unveil_triangles"] == len(file.triangles) > 50_000
        assert 1000 < len(thing.data.polygons) == thing["unveil_triangles_shown"] <= 2000
        assert not thing.data.validate() and thing.data.materials[0] is not None
        whole = addon.module("formats.drive_files").read_drive(loaded).from_drive(file.positions)
        moved = np.abs(np.array([f(places(thing.data), axis=0) - f(whole, axis=0) for f in (np.min, np.max)]))
        # Of loose ends the last triangles go first.
        assert moved.max() < 0.08 * np.ptp(whole, axis=0).max()
        colors = np.array([c.color_srgb[:3] for c in thing.data.color_attributes["Col"].data]) * 255
        assert np.abs(colors.mean(axis=0) - file.colors.mean(axis=0)).max() < 30
    points = bpy.data.objects["Points"]
    assert len(points.data.vertices) == 500 == points["unveil_points_shown"] < points["unveil_points"]


def test_full_detail_and_back(addon, scene, loaded: Path) -> None:
    import bpy
    from check_run import drawn

    panel, view = addon.module("ui.panel_results").UNVEIL_PT_results, scene.unveil_view
    view.state = "AFTER"
    after, before = bpy.data.objects["Mesh after"], bpy.data.objects["Mesh before"]
    shown, count = places(after.data), after["unveil_triangles"]
    assert f"Full Detail: {count:,} Triangles" in drawn(panel)
    assert bpy.ops.unveil.full_detail() == {"FINISHED"}
    assert len(after.data.polygons) == count == after["unveil_triangles_shown"]
    assert len(before.data.polygons) <= 2000  # one state at a time
    assert f"Full Detail: {count:,} Triangles" in drawn(panel)
    bpy.ops.unveil.load_workspace()
    assert len(after.data.polygons) == count  # stays, also when results are loaded again
    assert bpy.ops.unveil.full_detail() == {"FINISHED"}
    assert np.array_equal(places(after.data), shown)
    # A file that is gone or damaged is one line, and what is shown stays.
    for content, line in ((b"ply\n", "no end"), (None, "No mesh of this state")):
        path = loaded / "meshes/empty.ply"
        path.unlink() if content is None else path.write_bytes(content)
        with pytest.raises(RuntimeError, match=line):
            bpy.ops.unveil.full_detail()
        assert np.array_equal(places(after.data), shown) and not after.get("unveil_full_detail")


def test_a_small_mesh_offers_no_full_detail(addon, scene, workspace: Path) -> None:
    import bpy
    from check_run import drawn

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert bpy.data.objects["Mesh after"]["unveil_triangles"] == len(bpy.data.objects["Mesh after"].data.polygons)
    assert "unveil.full_detail" not in drawn(addon.module("ui.panel_results").UNVEIL_PT_results)


def test_what_has_not_changed_is_not_read_again(addon, scene, loaded: Path, monkeypatch) -> None:
    import bpy

    read: list[str] = []
    results, drive_scene = addon.module("scene.results"), addon.module("scene.drive_scene")
    sequences = addon.module("formats.sequences")
    whole, ply = sequences.read_bytes, results.read_ply
    monkeypatch.setattr(sequences, "read_bytes", lambda path, most: (read.append(path.name), whole(path, most))[1])
    for module in (results, drive_scene):
        monkeypatch.setattr(module, "read_ply", lambda path: (read.append(path.name), ply(path))[1])
    bpy.ops.unveil.load_workspace()
    assert read == []
    regions = loaded / "regions/camera/03.png"
    content = (loaded / "regions/camera/04.png").read_bytes()
    regions.unlink()
    regions.write_bytes(content)
    os.utime(loaded / "meshes/full.ply")
    stamps = {i.name: i["unveil_stamp"] for i in bpy.data.images if "unveil_stamp" in i}
    bpy.ops.unveil.load_workspace()
    assert read == ["03.png", "full.ply"]
    assert {n for n, s in stamps.items() if bpy.data.images[n]["unveil_stamp"] != s} == {"camera regions"}
    shown = addon.module("scene.images.plates").files_of(scene.camera, "regions")
    assert Path(shown[3]).read_bytes() == Path(shown[4]).read_bytes() != Path(shown[2]).read_bytes()


def test_choices_among_hundreds_are_what_one_by_one_would_give(addon, scene, workspace: Path) -> None:
    """Also in a file of a version that did not keep rows of classes."""
    import bpy

    document = json.loads((workspace / "objects.json").read_text())
    (car,) = document["objects"]
    names = ("car", "person", "building", "tram")  # no class of the last one is listed
    document["objects"] = [{**car, "id": i + 1, "class": names[i % 4]} for i in range(300)]
    document["classes"] += [{**document["classes"][-1], "name": name} for name in ("person", "bus")]
    (workspace / "objects.json").write_text(json.dumps(document))
    (workspace / "movers/movers.json").write_text(json.dumps([{"id": 2}, {"id": 5}]))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    for name in ("car", "skip"):
        bpy.ops.unveil.add_box(class_name=name)
    listed, selection = scene.unveil_selection, addon.module("choice.selection")
    bpy.data.objects.remove(listed.objects["skip 1002"].marker)  # forgets the object

    def one_by_one() -> tuple[list[str], list[int]]:
        own = {c.name: [] for c in listed.classes}
        for o in listed.objects:
            if not o.moves and o.source != "box" and o.class_name in own:
                own[o.class_name].append(o.chosen)
        whole = [name for name, chosen in own.items() if (all(chosen) if chosen else listed.classes[name].alone)]
        single = [
            o.number
            for o in listed.objects
            if o.chosen and not o.moves and (o.number == 1001 or o.source != "box" and o.class_name not in whole)
        ]
        return whole, single

    generator = np.random.default_rng(0)
    for share in (0.5, 1.0):
        for thing in listed.objects:
            thing.chosen = thing.source == "box" or generator.uniform() < share
        listed.classes["bus"].alone = True
        for row in (None, selection.UNKNOWN):
            for thing in listed.objects if row is not None else ():
                thing.row = row
            assert (selection.chosen_classes(scene), selection.chosen_numbers(scene)) == one_by_one()
            assert [c.name for c in listed.classes if c.chosen] == one_by_one()[0]
    listed.classes["person"].chosen = False
    assert selection.chosen_classes(scene) == one_by_one()[0] == ["building", "car", "bus"]
    assert not any(o.chosen for o in listed.objects if o.class_name == "person" and not o.moves)


def test_the_workspace_of_the_benchmark_is_read(addon, scene, tmp_path: Path) -> None:
    import bpy

    program = (
        "import sys, pathlib; from benchmarks.blender.big_workspace import BigWorkspace, make_big_workspace; "
        "make_big_workspace(pathlib.Path(sys.argv[1]), BigWorkspace(6, 3000, 20_000, 400, 30, (48, 32)))"
    )
    outside("-c", program, str(tmp_path / "ws"))
    bpy.ops.unveil.load_workspace(directory=str(tmp_path / "ws"))
    kinds = addon.module("scene.images.plates").kinds_of(scene.camera)
    assert len(kinds) == 8 and (scene.frame_start, scene.frame_end) == (1001, 1006)
    things, listed = bpy.data.objects, scene.unveil_selection
    assert len(listed.objects) == 30 and addon.module("choice.box_gizmos").lines_of(bpy.context, None)
    assert (
        abs(things["Mesh after"]["unveil_triangles"] / 20_000 - 1) < 0.05 and things["Points"]["unveil_points"] == 3000
    )
    lows = [np.min(places(things[name].data), axis=0) for name in ("Mesh after", "Points")]
    assert np.ptp(lows, axis=0).max() < 1.5  # in the same place

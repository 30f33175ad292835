"""Big drives, with caps low enough for a small one: what is shown is decimated, and what has not changed is not read again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

CAPS = {"scene.results": {"MOST_TRIANGLES": 2000, "MOST_SPLATS": 700}, "scene.drive_scene": {"MOST_POINTS": 500}}


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
        assert moved.max() < 0.05 * np.ptp(whole, axis=0).max()
        colors = np.array([c.color_srgb[:3] for c in thing.data.color_attributes["Col"].data]) * 255
        assert np.abs(colors.mean(axis=0) - file.colors.mean(axis=0)).max() < 30
    points, splats = bpy.data.objects["Points"], bpy.data.objects["Gaussians after"]
    assert len(points.data.polygons) == 4 * 500 == 4 * points["unveil_points_shown"] < points["unveil_points"]
    assert len(splats.data.polygons) == 700 < splats["unveil_gaussians"]


def test_full_detail_and_back(addon, scene, loaded: Path) -> None:
    import bpy
    from check_run import drawn

    panel, view = addon.module("ui.panel_results").UNVEIL_PT_results, scene.unveil_view
    view.state = "AFTER"
    after, before = bpy.data.objects["Mesh after"], bpy.data.objects["Mesh before"]
    shown, count = places(after.data), after["unveil_triangles"]
    assert f"Full detail: {count:,} triangles" in drawn(panel)
    assert bpy.ops.unveil.full_detail() == {"FINISHED"}
    assert len(after.data.polygons) == count == after["unveil_triangles_shown"]
    assert len(before.data.polygons) <= 2000  # one state at a time
    assert f"Full detail: {count:,} triangles" in drawn(panel)
    bpy.ops.unveil.load_workspace()
    assert len(after.data.polygons) == count  # stays, also when results are loaded again
    assert bpy.ops.unveil.full_detail() == {"FINISHED"}
    assert np.array_equal(places(after.data), shown)
    # A file that is gone or damaged is one line, and what is shown stays.
    for content, line in ((b"ply\n", "no end"), (None, "holds no mesh of this state")):
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
    whole, ply = Path.read_bytes, results.read_ply
    monkeypatch.setattr(Path, "read_bytes", lambda self: (read.append(self.name), whole(self))[1])
    for module in (results, drive_scene):
        monkeypatch.setattr(module, "read_ply", lambda path: (read.append(path.name), ply(path))[1])
    bpy.ops.unveil.load_workspace()
    assert read == []
    regions = loaded / "regions/camera/03.png"
    content = bytearray(whole(loaded / "regions/camera/04.png"))
    regions.unlink()
    regions.write_bytes(content)
    os.utime(loaded / "meshes/full.ply")
    stamps = {i.name: i["unveil_stamp"] for i in bpy.data.images if "unveil_stamp" in i}
    bpy.ops.unveil.load_workspace()
    assert read == ["03.png", "full.ply"]
    assert {n for n, s in stamps.items() if bpy.data.images[n]["unveil_stamp"] != s} == {"camera regions"}
    shown = addon.module("scene.plates").files_of(scene.camera, "regions")
    assert Path(shown[3]).read_bytes() == Path(shown[4]).read_bytes() != Path(shown[2]).read_bytes()

"""The artist's scene stays his: what an import leaves alone, colours, units, gaps, libraries, paths, and drawing without a disk."""

from __future__ import annotations

import builtins
import io
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest


def own(scene) -> dict[str, object]:  # type: ignore[no-untyped-def]
    """What of a scene is the artist's."""
    import bpy

    render, view = scene.render, scene.view_settings
    views = [
        (s.shading.type, s.shading.color_type, s.clip_end, s.region_3d.view_perspective)
        for w in bpy.context.window_manager.windows
        for a in w.screen.areas
        if a.type == "VIEW_3D"
        for s in [a.spaces.active]
    ]
    return {
        "camera": scene.camera and scene.camera.name,
        "size": (render.resolution_x, render.resolution_y, render.pixel_aspect_y),
        "time": (scene.frame_start, scene.frame_end, scene.frame_current, render.fps, render.fps_base),
        "look": (view.view_transform, view.look, view.exposure, scene.display_settings.display_device),
        "sequencer": (scene.sequence_editor is None, render.use_sequencer),
        "views": views,
    }


def test_nothing_is_changed_unasked(addon, scene, workspace) -> None:
    import bpy

    before = own(scene)
    scene.unveil.set_up_scene = False
    assert bpy.ops.unveil.load_workspace(directory=str(workspace)) == {"FINISHED"}
    assert own(scene) == before and len(scene.collection.children) == 1
    other = bpy.data.scenes.new("asked")
    before = own(other)
    bpy.context.window_manager.windows[0].scene = other
    assert bpy.ops.unveil.load_workspace(directory=str(workspace)) == {"FINISHED"}
    asked = own(other)
    assert asked["camera"] and asked["size"][:2] == (128, 80) and asked["time"][:3] == (1001, 1008, 1001)
    assert asked["look"] == before["look"]  # plates and solid colours are drawn without it


def test_numbers_are_no_colours_and_photographs_no_surfaces(addon, scene, workspace) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    data = {i.get("unveil_role").split(":")[1]: i.colorspace_settings.is_data for i in bpy.data.images}
    data |= {"clip " + c.get("unveil_role").split(":")[1]: c.colorspace_settings.is_data for c in bpy.data.movieclips}
    assert {kind for kind, numbers in data.items() if numbers} == {
        *("removed", "shadows", "unobserved"),
        *("clip removed", "clip unobserved"),
    }
    assert {"original", "clean", "render", "regions", "clip clean"} <= set(data)
    (material,) = {m for o in bpy.data.objects if o.type == "MESH" for m in o.data.materials if o.name == "Mesh after"}
    kinds = {n.type for n in material.node_tree.nodes}
    assert kinds == {"OUTPUT_MATERIAL", "EMISSION", "VERTEX_COLOR"} and len(material.node_tree.links) == 2


@pytest.mark.parametrize("length", [0.01, 1.0])
def test_units_of_the_scene_are_respected(addon, scene, workspace, length: float) -> None:
    """A metre has a hundred units where a unit is a centimetre; marks come back into the drive as they lie there."""
    import bpy

    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", length
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    entries = json.loads((workspace / "drive/cameras.json").read_text())
    poses = [np.linalg.inv(e["world_to_camera"]) for e in entries["frames"]]
    scene.frame_set(1004)
    assert np.allclose(scene.camera.matrix_world.translation, poses[3][:3, 3] / length, atol=1e-4 / length)
    read = addon.module("formats.ply_file").read_ply
    offset = np.array(entries["to_world"]["translation"])
    for name, path, shift in (("Points", "drive/points", 0), ("Mesh after", "meshes/empty", offset)):
        places = (read(workspace / f"{path}.ply").positions - shift) / length
        mesh = bpy.data.objects[name].data
        found = np.zeros(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", found)
        spread = np.ptp(places, axis=0)
        assert np.abs(np.ptp(found.reshape(-1, 3), axis=0) - spread).max() < 0.8 / length
    car = scene.unveil_selection.objects[0]
    assert 1.0 < car.size[2] * length < 2.0
    bpy.ops.unveil.add_box(class_name="skip")
    addon.module("choice.selection").arguments(scene)
    (entry,) = json.loads((workspace / "marked.json").read_text())
    # On the ground ten metres ahead, where the camera looks: not at the world's origin.
    own = np.array(entry["centre"]) - offset
    camera = np.array(scene.camera.matrix_world)
    away = own - camera[:3, 3] * length
    assert 9 < -away @ camera[:3, 2] < 11 and np.abs(own[2] - 0.8 - ground_at(own)) < 0.2
    assert np.allclose(entry["size"], (4.5, 1.9, 1.6), atol=1e-4)


def ground_at(place: np.ndarray) -> float:
    """Height of the lowest points around a place, metres."""
    import bpy

    mesh = bpy.data.objects["Points"].data
    found = np.zeros(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", found)
    places = found.reshape(-1, 3) * bpy.context.scene.unit_settings.scale_length
    near = np.hypot(*(places - place)[:, :2].T) < 2.5
    return float(np.median(np.sort(places[near, 2])[: max(int(near.sum() / 3), 1)]))


def test_a_rig_stays_in_step_though_a_picture_is_missing(addon, scene, street, tmp_path) -> None:
    import bpy

    shutil.copytree(street.parent, tmp_path / "drive")
    document = json.loads(street.read_text())
    for i, frame in enumerate(document["frames"]):
        frame["camera"], frame["timestamp"] = ("front", "left")[i % 2], 50.0 + 0.04 * (i // 2) + 0.01 * (i % 2)
    del document["frames"][3]  # the second of the left camera
    (tmp_path / "drive/transforms.json").write_text(json.dumps(document))
    done = bpy.ops.unveil.open_drive(
        filepath=str(tmp_path / "drive/transforms.json"), workspace=str(tmp_path / "ws"), start_frame=90, cameras="all"
    )
    assert done == {"FINISHED"} and scene.unveil.start_frame == 90
    assert (scene.render.fps, scene.render.fps_base) == (25, 1.0) and (scene.frame_start, scene.frame_end) == (90, 93)
    cameras = {c["unveil_track"]: c for c in addon.module("scene.drive_scene").tracks_of(scene.collection.children[0])}
    names = ("00", "02", "04", "06"), ("01", "01", "05", "07")  # the one before stays in the gap
    for track, stems in zip(("front", "left"), names, strict=True):
        files = addon.module("scene.images.plates").files_of(cameras[track], "original")
        expected = [tmp_path / f"drive/images/{stem}.png" for stem in stems]
        assert [Path(f).read_bytes() for f in files] == [f.read_bytes() for f in expected]
        entries = json.loads((tmp_path / "ws/drive/cameras.json").read_text())["frames"]
        poses = [np.linalg.inv(e["world_to_camera"]) for e in entries if e["camera"] == track]
        scene.frame_set(93)
        assert np.allclose(cameras[track].matrix_world.translation, poses[-1][:3, 3], atol=1e-5)


def test_every_nth_frame_and_some_cameras(addon, scene, street, tmp_path) -> None:
    import bpy

    bpy.ops.unveil.open_drive(filepath=str(street), workspace=str(tmp_path / "ws"), every_nth=3)
    assert scene.unveil.frames == "::3" and (scene.frame_start, scene.frame_end) == (1001, 1003)
    with pytest.raises(RuntimeError, match="rear"):
        bpy.ops.unveil.open_drive(filepath=str(street), workspace=str(tmp_path / "other"), cameras="rear")


def test_a_workspace_that_is_opened_is_gone_on_with(addon, scene, workspace) -> None:
    """Whatever made it: its settings are the scene's, so that nothing is stale."""
    import bpy

    assert scene.unveil.quality == "standard"
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert scene.unveil.quality == "draft"
    states = addon.module("work.stage_states").stage_states(scene).stages
    assert {s.state for s in states.values()} == {"done"}
    document = json.loads((workspace / "workspace.json").read_text())
    told = {
        "quality": "finest",
        "seed": 10**12,
        "shadows": "120,nan",
        "keyframes": [3],
        "frames": "::2",
        "cameras": ["a", "b"],
    }
    document["settings"] |= told
    (workspace / "workspace.json").write_text(json.dumps(document))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    settings = scene.unveil
    assert (settings.quality, settings.seed, settings.shadows, settings.keyframes) == ("draft", 0, "auto", "")
    assert (settings.frames, settings.cameras) == ("::2", "a,b")


# ------------------------------------------------------------------------------------------------------------------ libraries


def test_a_drive_of_a_library_is_left_alone(addon, scene, workspace, tmp_path) -> None:
    """Linked, and overridden: importing here makes a drive of this file's own, and changes nothing of the other."""
    import bpy

    library = tmp_path / "library.blend"
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    for override in (False, True):
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        scene = bpy.context.scene
        with bpy.data.libraries.load(str(library), link=True) as (there, here):
            here.collections = [name for name in there.collections if name == "street"]
        linked = here.collections[0]
        scene.collection.children.link(linked)
        if override:
            linked.override_hierarchy_create(scene, bpy.context.view_layer)
        before = {(b.name, b.library and b.library.filepath) for b in (*bpy.data.objects, *bpy.data.meshes)}
        scene.unveil.workspace = str(workspace)
        assert addon.module("scene.view").shown_drive(scene) is None
        bpy.ops.unveil.load_workspace()
        collection = addon.module("scene.view").shown_drive(scene)
        assert collection is not None and addon.module("scene.blocks").is_own(collection)
        things = list(collection.all_objects)
        assert len(things) > 3 and all(addon.module("scene.blocks").is_own(t) for t in things)
        assert before <= {(b.name, b.library and b.library.filepath) for b in (*bpy.data.objects, *bpy.data.meshes)}


# ---------------------------------------------------------------------------------------------------------------------- paths


def test_paths_are_relative_where_blender_s_preference_says_so(addon, scene, workspace, tmp_path) -> None:
    """A project folder that was moved as a whole opens as it was, wherever in it the workspace lies."""
    import bpy

    project = tmp_path / "project"
    (project / "shots").mkdir(parents=True)
    shutil.move(workspace, project / "cache/unveil/ws")
    blend = project / "shots/street.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), compress=False)
    bpy.ops.unveil.load_workspace(directory=str(project / "cache/unveil/ws"))
    bpy.ops.wm.save_mainfile(compress=False)
    assert scene.unveil.workspace == str(project / "cache/unveil/ws")  # absolute as long as it is open
    assert str(project).encode() not in raw(blend)
    project.rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved/shots/street.blend"))
    scene = bpy.context.scene
    assert scene.unveil.workspace == str(tmp_path / "moved/cache/unveil/ws")
    files = [
        Path(bpy.path.abspath(b.filepath)) for b in (*bpy.data.images, *bpy.data.movieclips) if b.get("unveil_drive")
    ]
    assert len(files) > 8 and all(f.is_file() for f in files)
    assert addon.module("scene.view").shown_drive(scene) is not None
    bpy.context.preferences.filepaths.use_relative_paths = False
    try:
        bpy.ops.wm.save_mainfile(compress=False)
        assert str(tmp_path / "moved/cache/unveil/ws").encode() in raw(tmp_path / "moved/shots/street.blend")
    finally:
        bpy.context.preferences.filepaths.use_relative_paths = True


def raw(blend: Path) -> bytes:
    """What a .blend holds, without its own path."""
    content = blend.read_bytes()
    assert content[:7] == b"BLENDER", "a .blend that is packed cannot be searched"
    return content.replace(str(blend).encode(), b"")


def test_a_moved_workspace_is_found_by_its_folder(addon, scene, workspace, tmp_path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    new = tmp_path / "far/away"
    new.parent.mkdir()
    workspace.rename(new)
    with pytest.raises(RuntimeError, match="Not a results folder"):
        bpy.ops.unveil.find_workspace(directory=str(tmp_path))
    assert bpy.ops.unveil.find_workspace(directory=str(new)) == {"FINISHED"}
    assert scene.unveil.workspace == str(new) and addon.module("scene.view").shown_drive(scene) is not None
    assert all(Path(bpy.path.abspath(i.filepath)).is_file() for i in bpy.data.images if i.get("unveil_drive"))


# -------------------------------------------------------------------------------------------------------------------- drawing


def test_drawing_and_pointing_touch_no_disk(addon, scene, workspace, monkeypatch) -> None:
    """Nor do they write: a wire cube that is moved while a run reads marked.json leaves it as it was."""
    import bpy
    from check_run import drawn

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.ops.unveil.add_box(class_name="skip")
    scene.unveil.show_more = True
    panels = [
        addon.module("ui.panel_run").UNVEIL_PT_work,
        addon.module("ui.panel_run").UNVEIL_PT_run,
        addon.module("ui.panel_run").UNVEIL_PT_reading,
        addon.module("ui.panel_run").UNVEIL_PT_stages,
        addon.module("ui.panel_drive").UNVEIL_PT_drive,
        addon.module("ui.panel_selection").UNVEIL_PT_selection,
    ]
    watch = addon.module("work.stage_states")._watch
    monkeypatch.setattr(addon.module("scene.versions"), "has_window", lambda: True)
    monkeypatch.setattr(addon.module("worker.states_watch").threading, "Thread", Unstarted)
    touched: list[str] = []

    def watched(name: str, call):  # type: ignore[no-untyped-def]
        def record(*args, **kwargs):  # type: ignore[no-untyped-def]
            touched.append(f"{name}{args[:1]}")
            return call(*args, **kwargs)

        return record

    places = [(os, n) for n in ("stat", "lstat", "open", "scandir", "listdir", "readlink")]
    for owner, name in [*places, (os.path, "realpath"), (builtins, "open"), (io, "open")]:
        monkeypatch.setattr(owner, name, watched(name, getattr(owner, name)))
    for panel in panels:
        drawn(panel)
    gizmos = addon.module("choice.box_gizmos")
    assert gizmos.UNVEIL_GGT_boxes.poll(bpy.context) and gizmos.lines_of(bpy.context, 5)
    assert touched == [] and watch.pending
    watch.pending = False
    monkeypatch.undo()
    assert not (workspace / "marked.json").exists()


class Unstarted:
    """Stands for the thread that reads the states."""

    def __init__(self, **_: object) -> None:
        pass

    def start(self) -> None:
        pass


def test_a_drive_can_be_dropped(addon, scene) -> None:
    import bpy

    handler = bpy.types.UNVEIL_FH_drive
    assert ".json" in handler.bl_file_extensions.split(";")
    assert handler.bl_import_operator == "unveil.open_drive" and hasattr(bpy.ops.unveil, "open_drive")

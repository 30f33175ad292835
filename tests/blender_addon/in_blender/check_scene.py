"""Drives and results in the scene: exact cameras, choices, and nothing twice, however often it is loaded."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import outside

MAKE = """
import sys
from pathlib import Path
from tests.drives.tiny_drive import edit, make_tiny_drive
folder = Path(sys.argv[1])
tiny = make_tiny_drive(folder / "tiny", offset=(352155.25, 5812961.5, 36.0))
def skew(document):
    document.update(cx=13.25, cy=14.5)
    for frame, stem in zip(document["frames"], ("1533.10", "1533.25", "1533.31", "1533.42"), strict=True):
        for key, value in list(frame.items()):
            if key.endswith("_path"):
                path = folder / "tiny" / value
                new = path.with_name(stem + path.suffix)
                if path.exists():
                    path.rename(new)
                frame[key] = str(new.relative_to(folder / "tiny"))
edit(tiny, skew)
def rig(document):
    for i, frame in enumerate(document["frames"]):
        frame["camera"] = ("front", "left")[i % 2]
        frame["fl_x"] = 25.0 if i % 2 == 0 else 20.0 + i
edit(make_tiny_drive(folder / "rig"), rig)
from tests.drives.formats.colmap.test_model import write_model
write_model(folder / "colmap", True)
"""


@pytest.fixture(scope="session")
def made(street: Path, finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``tiny/``, a drive with far coordinates, oblong pixels and odd names; ``rig/``, one of two cameras; ``colmap/``, which
    lies askew and has no metres; ``street/`` and ``ws/``, its finished workspace."""
    folder = tmp_path_factory.mktemp("made")
    outside("-c", MAKE, str(folder))
    shutil.copytree(street.parent, folder / "street")
    shutil.copytree(finished, folder / "ws")
    return folder


def blocks() -> dict[str, list[str]]:
    """Every data block of the file, by kind."""
    import bpy

    kinds = (
        "objects",
        "meshes",
        "cameras",
        "images",
        "actions",
        "collections",
        "materials",
        "movieclips",
        "node_groups",
    )
    return {kind: sorted(b.name for b in getattr(bpy.data, kind)) for kind in kinds}


def undo() -> None:
    import bpy

    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo()


def greatest_error(addon, camera, workspace: Path, points: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    """Pixels between Blender's projection and the drive's own of points (N, 3) of its local coordinates, over its frames."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    scene = bpy.context.scene
    worst = 0.0
    entries = json.loads((workspace / "drive/cameras.json").read_text())["frames"]
    for n, e in enumerate(x for x in entries if x["camera"] == camera["unveil_track"]):
        scene.frame_set(scene.unveil.start_frame + n)
        seen = np.array(e["world_to_camera"]) @ np.concatenate([points, np.ones((len(points), 1))], axis=1).T
        u = e["fx"] * seen[0] / seen[2] + e["cx"]
        v = e["fy"] * seen[1] / seen[2] + e["cy"]
        use = (seen[2] > 0.5) & (np.abs(u) < 2 * e["width"]) & (np.abs(v) < 2 * e["height"])
        assert use.sum() > 5
        for i in np.flatnonzero(use)[:40]:
            x, y, _ = world_to_camera_view(scene, camera, Vector(points[i]))
            worst = max(worst, abs(x * e["width"] - u[i]), abs((1 - y) * e["height"] - v[i]))
    return worst


# -------------------------------------------------------------------------------------------------------------------- import


def test_import_shows_the_drive_as_it_is(addon, scene, made: Path, tmp_path: Path) -> None:
    import bpy

    ws = tmp_path / "ws"
    assert bpy.ops.unveil.import_drive(filepath=str(made / "tiny/transforms.json"), workspace=str(ws)) == {"FINISHED"}
    (collection,) = scene.collection.children
    assert collection.name == "tiny" and scene.unveil.drive == str(made / "tiny/transforms.json")
    offset = json.loads((ws / "drive/cameras.json").read_text())["to_world"]["translation"]
    assert list(collection["unveil_offset"]) == offset and offset[1] > 5_000_000
    camera = scene.camera
    generator = np.random.default_rng(3)
    points = generator.uniform((0, -4, -3), (25, 4, 3), (300, 3))
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1001, 1004, 1001)
    assert greatest_error(addon, camera, ws, points) < 0.01
    assert (scene.render.resolution_x, scene.render.resolution_y) == (32, 24)
    # Blender reads sequences by their numbers, which these names are not.
    background = camera.data.background_images[0]
    assert background.show_background_image and background.image.source == "SEQUENCE"
    user = background.image_user  # frame 1001 of the timeline shows file 0
    assert (user.frame_start, user.frame_duration, user.frame_offset) == (1001, 4, -1)
    files = addon.module("scene.images.plates").files_of(camera, "original")
    originals = [made / f"tiny/images/{n}.png" for n in ("1533.10", "1533.25", "1533.31", "1533.42")]
    assert [Path(f).read_bytes() for f in files] == [f.read_bytes() for f in originals]
    assert [Path(f).name for f in files] == [f"{i:06d}.png" for i in range(4)]


def test_a_rig_has_a_camera_per_track(addon, scene, made: Path, tmp_path: Path) -> None:
    """Also where the lens changes from frame to frame, and the pixels are of another shape for each camera."""
    import bpy

    bpy.ops.unveil.import_drive(filepath=str(made / "rig/transforms.json"), workspace=str(tmp_path / "ws"))
    tracks = {c["unveil_track"]: c for c in addon.module("scene.drive_scene").tracks_of(scene.collection.children[0])}
    assert set(tracks) == {"front", "left"} and scene.frame_end == 1002
    points = np.random.default_rng(3).uniform((0, -4, -3), (25, 4, 3), (300, 3))
    for track, camera in tracks.items():
        bpy.ops.unveil.look_through(track=track)
        assert scene.camera == camera
        files = addon.module("scene.images.plates").files_of(camera, "original")
        assert (
            len(files) == 2
            and Path(files[0]).read_bytes() == (made / f"rig/images/0{track == 'left':d}.png").read_bytes()
        )
    tracks_of = addon.module("scene.drive_scene").tracks_of
    own = bpy.data.objects.new("Own", bpy.data.cameras.new("Own"))  # as of a matchmove: it shows its own plate
    scene.collection.objects.link(own)
    scene.camera = own
    assert scene.camera not in tracks_of(scene.collection.children[0])
    bpy.ops.unveil.look_through(track="front")
    assert scene.camera in tracks_of(scene.collection.children[0])
    assert greatest_error(addon, tracks["front"], tmp_path / "ws", points) < 0.01
    values = []
    for n in (1001, 1002):
        scene.frame_set(n)
        values.append(tracks["left"].data.lens * 32 / 36)
    assert np.allclose(values, (21, 23), atol=1e-4)


def test_every_kind_of_drive_is_imported_by_whatever_of_it_is_picked(addon, scene, made: Path, tmp_path: Path) -> None:
    """In the file dialog: a file of a COLMAP model, its folder, a transforms.json, a workspace's own copy of a drive."""
    import bpy

    ws = tmp_path / "ws"
    done = bpy.ops.unveil.open_drive(filepath=str(made / "colmap/sparse/0/images.bin"), workspace=str(ws))
    assert done == {"FINISHED"} and scene.unveil.drive == str(made / "colmap")
    drive = addon.module("formats.drive_files").read_drive(ws)
    assert drive.units_per_metre != 1 and not np.allclose(drive.rotation, np.eye(3), atol=0.1)
    assert np.allclose(drive.from_drive(drive.to_drive(np.eye(3))), np.eye(3))
    generator = np.random.default_rng(3)
    entries = json.loads((ws / "drive/cameras.json").read_text())["frames"]
    ahead = np.linalg.inv(entries[0]["world_to_camera"])
    points = generator.uniform((-1, -1, 1), (1, 1, 8), (300, 3)) @ ahead[:3, :3].T + ahead[:3, 3]
    assert greatest_error(addon, scene.camera, ws, points) < 0.01
    # The model has y down; in the scene z is up, and its origin lies amid the cameras.
    assert scene.camera.matrix_world[2][1] > 0.7 and scene.camera.matrix_world.translation.length < 30
    pick = addon.module("work.opening.operators_open_drive").drive_of
    for folder in ("colmap", "colmap/sparse", "colmap/sparse/0"):
        (made / folder / "cameras.txt").touch()
        assert pick(made / folder / "cameras.txt") == made / "colmap"
        (made / folder / "cameras.txt").unlink()
    assert pick(made / "colmap") == made / "colmap"
    assert pick(made / "tiny/transforms.json") == made / "tiny/transforms.json"
    again = tmp_path / "again"
    picked = made / "ws/drive/cameras.json"
    assert bpy.ops.unveil.open_drive(filepath=str(picked), workspace=str(again)) == {"FINISHED"}
    assert len(list((again / "drive/images").rglob("*.png"))) == 8 and len(scene.collection.children) == 2
    with pytest.raises(RuntimeError, match="holds pictures alone"):
        bpy.ops.unveil.open_drive(filepath=str(made / "rig/images/00.png"), workspace=str(tmp_path / "none"))


def test_the_camera_goes_straight_from_frame_to_frame(addon, scene, made: Path) -> None:
    addon.module("work.loading").load(__import__("bpy").context, made / "ws")
    camera = scene.camera
    places = []
    for frame, part in ((1003, 0.0), (1003, 0.5), (1004, 0.0)):
        scene.frame_set(frame, subframe=part)
        places.append(np.array(camera.matrix_world))
    assert np.allclose(places[1][:3, 3], (places[0] + places[2])[:3, 3] / 2, atol=1e-5)


def encoded(tones: np.ndarray) -> np.ndarray:
    """(N, 3) from 0 to 255 of linear colours."""
    linear = tones[:, :3].astype(float)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def test_points_are_vertices_as_photographed(addon, scene, made: Path) -> None:
    from types import SimpleNamespace

    import bpy

    scene.unveil.workspace = str(made / "ws")
    drive = addon.module("formats.drive_files").read_drive(made / "ws")
    collection = addon.module("scene.drive_scene").place(scene, drive).collection
    (thing,) = [o for o in collection.all_objects if o.name == "Points"]
    mesh, dots = thing.data, addon.module("scene.overlays.points")
    count = len(np.load(made / "ws/objects/point_labels.npy"))
    assert len(mesh.vertices) == count == thing["unveil_points"] and not len(mesh.polygons)
    ply = addon.module("formats.ply_file").read_ply(made / "ws/drive/points.ply")
    found, tones = dots.arrays_of(mesh)
    colors = np.full((count, 3), 160) if ply.colors is None else ply.colors
    assert np.allclose(found, ply.positions, atol=1e-4)
    assert np.abs(encoded(tones) - colors).max() < 0.6
    labels = np.zeros(count, np.int32)
    mesh.attributes["label"].data.foreach_get("value", labels)
    scene.unveil_view.points = "CLASS"
    car = int(np.flatnonzero(labels == 13)[0])
    assert np.abs(encoded(dots.arrays_of(mesh)[1])[car] - (0, 0, 142)).max() < 0.6
    # Through a camera they would hide what is judged; from elsewhere they are all there is.
    bpy.context.view_layer.update()
    space = SimpleNamespace(
        overlay=SimpleNamespace(show_overlays=True), region_3d=SimpleNamespace(view_perspective="PERSP")
    )
    context = SimpleNamespace(scene=scene, space_data=space, view_layer=bpy.context.view_layer)
    assert dots.shown_points(context) == thing
    space.region_3d.view_perspective = "CAMERA"
    assert dots.shown_points(context) is None
    scene.unveil_view.points_in_camera = True
    assert dots.shown_points(context) == thing
    scene.unveil_view.shown = set()
    assert dots.shown_points(context) is None


def test_a_folder_that_is_no_workspace_is_one_line(addon, scene, tmp_path: Path) -> None:
    import bpy

    with pytest.raises(RuntimeError, match="Not a results folder"):
        bpy.ops.unveil.load_workspace(directory=str(tmp_path))
    with pytest.raises(RuntimeError, match="Not found"):
        bpy.ops.unveil.import_drive(filepath=str(tmp_path / "nowhere.json"))
    assert list(scene.collection.children) == []


# ----------------------------------------------------------------------------------------------------------------- selection


def test_choices_become_options(addon, scene, made: Path) -> None:
    import bpy

    selection = addon.module("choice.selection")
    assert selection.arguments(scene) == [] and selection.problem(scene) == ""  # nothing is imported yet
    # The workspace's own run took all cars; what it took is chosen here, too.
    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    listed = scene.unveil_selection
    (car,) = listed.objects
    assert (car.number, car.class_name, car.frames, car.chosen) == (5, "car", 8, True)
    assert 1.0 < car.size[2] < 2.0 and 1 < car.distance < 8 and Path(car.thumbnail).is_file()
    assert selection.arguments(scene) == []  # the workspace keeps what it was made with: all that can be removed
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.unveil.toggle_object("EXEC_DEFAULT", True, number=5)
    assert not scene.unveil_selection.objects[0].chosen and selection.arguments(scene) == []
    assert selection.problem(scene) == "Nothing is chosen: tick what is to go, or click its box"
    with pytest.raises(RuntimeError, match="Nothing is chosen"):
        bpy.ops.unveil.run()
    undo()
    scene = bpy.context.scene
    assert scene.unveil_selection.objects[0].chosen and selection.problem(scene) == ""
    scene.unveil_selection.classes["car"].chosen = False
    assert not scene.unveil_selection.objects[0].chosen
    bpy.ops.unveil.choose(which="VEHICLES")
    assert scene.unveil_selection.classes["car"].chosen and selection.arguments(scene) == []
    scene.unveil_selection.classes["building"].chosen = True  # has no single objects
    assert selection.arguments(scene) == ["--remove", "building,car"]
    bpy.ops.unveil.choose(which="NONE")
    assert selection.problem(scene)


def test_classes_can_be_chosen_where_there_are_no_single_objects(addon, scene, made: Path) -> None:
    """As where a matchmove gave next to no points."""
    import bpy

    selection = addon.module("choice.selection")
    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    listed = bpy.context.scene.unveil_selection
    bpy.ops.unveil.choose(which="NONE")
    listed.objects.clear()
    listed.classes["car"].objects = 0
    assert "tick a class" in selection.problem(scene)
    assert addon.module("ui.next_step").next_step(bpy.context).operator == "unveil.choose"
    bpy.ops.unveil.choose(which="MOVABLE")
    assert selection.problem(scene) == ""
    listed.classes.clear()
    assert "no labelled objects" in selection.problem(scene)


def test_boxes_lie_around_their_objects(addon, scene, made: Path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    selection, ply_file = addon.module("choice.selection"), addon.module("formats.ply_file")
    points = ply_file.read_ply(made / "ws/drive/points.ply").positions
    own = points[np.load(made / "ws/objects/point_objects.npy") == 5]
    corners = selection.box_of(scene.unveil_selection.objects[0]).corners
    inside = ((own > corners.min(axis=0) - 0.05) & (own < corners.max(axis=0) + 0.05)).all(axis=1)
    assert inside.mean() > 0.9 and np.prod(np.ptp(corners, axis=0)) < 40


def test_a_wire_cube_becomes_an_instance(addon, scene, made: Path, tmp_path: Path) -> None:
    import bpy
    from mathutils import Euler

    ws = tmp_path / "ws"
    bpy.ops.unveil.import_drive(filepath=str(made / "street/transforms.json"), workspace=str(ws))
    bpy.ops.unveil.choose(which="NONE")
    scene.cursor.location = (7.0, -2.5, -1.6)
    bpy.ops.unveil.add_box(class_name="skip")
    marker = bpy.context.view_layer.objects.active
    assert marker.display_type == "WIRE" and marker.select_get()
    marker.location = (7.25, -2.55, -0.9)
    marker.scale, marker.rotation_euler = (3.8, 2.0, 1.6), Euler((0, 0, 0.1))
    selection = addon.module("choice.selection")
    arguments = selection.arguments(scene)
    assert arguments == ["--instances", "1001", "--marked", str(ws / "marked.json")]
    (entry,) = json.loads((ws / "marked.json").read_text())
    offset = json.loads((ws / "drive/cameras.json").read_text())["to_world"]["translation"]
    assert np.allclose(entry["centre"], np.array((7.25, -2.55, -0.9)) + offset, atol=1e-5)
    assert np.allclose(entry["size"], (3.8, 2.0, 1.6), atol=1e-5) and abs(entry["yaw"] - 0.1) < 1e-5
    # Importing again keeps it, chosen or not, and what the command finds in it comes back into the list.
    scene.unveil_selection.objects["skip 1001"].chosen = False
    assert bpy.ops.unveil.import_drive() == {"FINISHED"}
    assert not scene.unveil_selection.objects["skip 1001"].chosen
    bpy.ops.unveil.toggle_object(number=1001)
    skip = scene.unveil_selection.objects["skip 1001"]
    assert skip.frames > 3 and skip.points > 30 and skip.chosen and skip.marker == marker
    # Another file finds the wire cube in the workspace; deleting it forgets the object.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    bpy.ops.unveil.load_workspace(directory=str(ws))
    again = scene.unveil_selection.objects["skip 1001"]
    box = selection.box_of(again)
    assert np.allclose(box.centre, (7.25, -2.55, -0.9), atol=1e-4) and np.allclose(box.size, (3.8, 2.0, 1.6), atol=1e-4)
    bpy.ops.unveil.choose(which="ALL")
    assert selection.chosen_numbers(scene) == [1001]
    with bpy.context.temp_override(selected_objects=[again.marker]):
        bpy.ops.object.delete()
    assert selection.chosen_numbers(scene) == []
    assert selection.arguments(scene)[:2] == ["--remove", "car"]
    assert json.loads((ws / "marked.json").read_text()) == []


def test_mattes_become_an_instance(addon, scene, made: Path, tmp_path: Path) -> None:
    import bpy

    ws = tmp_path / "ws"
    bpy.ops.unveil.import_drive(filepath=str(made / "street/transforms.json"), workspace=str(ws))
    with pytest.raises(RuntimeError, match="holds no pictures"):
        bpy.ops.unveil.add_mattes(directory=str(made / "tiny/nothing"))
    bpy.ops.unveil.add_mattes(directory=str(made / "street/truth/removed"), class_name="van")
    arguments = addon.module("choice.selection").arguments(scene)
    assert arguments[:2] == ["--instances", "1001"]
    assert json.loads((ws / "marked.json").read_text())[0]["mattes"] == str(made / "street/truth/removed")
    bpy.ops.unveil.remove_mark(number=1001)
    assert json.loads(Path(addon.module("choice.selection").arguments(scene)[-1]).read_text()) == []


# ------------------------------------------------------------------------------------------------------------------- results


def test_results_are_ordinary_blender_data(addon, scene, made: Path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    plates, versions = addon.module("scene.images.plates"), addon.module("scene.versions")
    camera = scene.camera
    kinds = ["original", "clean", "render", "inpainted", "regions", "provenance", "removed", "shadows", "unobserved"]
    assert plates.kinds_of(camera) == kinds
    assert {s.name: len(s.elements) for s in versions.strips_of(scene)} == {"camera original": 8, "camera clean": 8}
    assert not scene.render.use_sequencer  # F12 still renders the scene
    clips = {c.name: c.frame_duration for c in bpy.data.movieclips}
    assert clips["camera clean"] == 8 and all(c.use_fake_user for c in bpy.data.movieclips)
    for state, count in (("before", "full"), ("after", "empty")):
        mesh = bpy.data.objects[f"Mesh {state}"].data
        ply = addon.module("formats.ply_file").read_ply(made / f"ws/meshes/{count}.ply")
        assert len(mesh.vertices) == len(ply.vertices) and len(mesh.polygons) == len(ply.triangles)
        offset = np.array(json.loads((made / "ws/drive/cameras.json").read_text())["to_world"]["translation"])
        assert np.allclose(mesh.vertices[7].co, ply.positions[7] - offset, atol=1e-4)
        color = np.array(mesh.color_attributes["Col"].data[7].color_srgb[:3]) * 255
        assert np.abs(color - ply.colors[7]).max() < 0.6 and mesh.materials[0] is not None
        assert not mesh.validate()
        native = addon.module("scene.versions").has_native_splats()  # elsewhere they are not offered
        assert (f"Gaussians {state}" in bpy.data.objects) == native


def test_before_and_after_at_one_click(addon, scene, made: Path) -> None:
    import bpy

    def visible() -> set[str]:
        bpy.context.view_layer.update()
        return {o.name for o in scene.objects if o.type == "MESH" and o.visible_get()}

    def background() -> str:
        (shown,) = [b for b in scene.camera.data.background_images if b.show_background_image]
        return shown.image.name

    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    assert visible() == set() and background() == "camera clean"  # through the camera a mesh would cover the frames
    scene.unveil_view.shown = {"MESH"}
    assert visible() == {"Mesh after"} and background() == "camera clean"
    bpy.ops.unveil.before_after()
    assert visible() == {"Mesh before"} and background() == "camera original"
    bpy.ops.unveil.before_after()
    assert visible() == {"Mesh after"} and background() == "camera clean"
    scene.unveil_view.state = "BEFORE"  # by the panel: the background goes along
    assert visible() == {"Mesh before"} and background() == "camera original"
    scene.unveil_view.state = "AFTER"
    assert visible() == {"Mesh after"} and background() == "camera clean"
    scene.unveil_view.shown, scene.unveil_view.background = {"POINTS", "MESH"}, "regions"
    assert visible() == {"Mesh after"} and background() == "camera regions"
    scene.unveil_view.state = "BEFORE"
    assert background() == "camera regions"  # another background was chosen
    scene.unveil_view.background = "none"
    assert not [b for b in scene.camera.data.background_images if b.show_background_image]


def test_nothing_is_there_twice(addon, scene, made: Path, tmp_path: Path) -> None:
    """Loaded again, saved, opened, loaded again; and what the artist renamed or moved elsewhere is found all the same."""
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    first = blocks()
    strips = addon.module("scene.versions").strips_of
    counts = len(strips(scene)), len(scene.timeline_markers)
    bpy.ops.unveil.load_workspace()
    assert blocks() == first and (len(strips(scene)), len(scene.timeline_markers)) == counts
    bpy.data.objects["Mesh after"].name = "my street"
    bpy.data.images["camera clean"].name = "plate"
    bpy.data.collections["street"].name = "shot 12"
    scene.unveil_view.background = "removed"
    scene.unveil_selection.objects[0].chosen = False
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    scene = bpy.context.scene
    bpy.ops.unveil.load_workspace()
    assert {k: len(v) for k, v in blocks().items()} == {k: len(v) for k, v in first.items()}
    assert (len(strips(scene)), len(scene.timeline_markers)) == counts
    # What the artist decided stays.
    assert "my street" in bpy.data.objects and scene.unveil_view.background == "removed"
    assert not scene.unveil_selection.objects[0].chosen


def test_new_results_replace_the_old_ones(addon, scene, made: Path, tmp_path: Path) -> None:
    import bpy

    shutil.copytree(made / "ws", tmp_path / "ws")
    shutil.rmtree(tmp_path / "ws/frames")
    shutil.rmtree(tmp_path / "ws/meshes")
    bpy.ops.unveil.load_workspace(directory=str(tmp_path / "ws"))  # what is there of an unfinished run
    assert (
        "clean" not in addon.module("scene.images.plates").kinds_of(scene.camera)
        and "Mesh after" not in bpy.data.objects
    )
    shutil.copytree(made / "ws/frames", tmp_path / "ws/frames")
    shutil.copytree(made / "ws/meshes", tmp_path / "ws/meshes")
    bpy.ops.unveil.load_workspace()
    mesh = bpy.data.objects["Mesh after"].data
    before = len(mesh.vertices)
    shutil.copyfile(made / "ws/meshes/full.ply", tmp_path / "ws/meshes/empty.ply")
    bpy.ops.unveil.load_workspace()
    assert bpy.data.objects["Mesh after"].data == mesh
    assert len(mesh.vertices) == len(bpy.data.objects["Mesh before"].data.vertices) != before
    # Keyframes, then others: the artist's own markers stay.
    scene.timeline_markers.new("mine", frame=6)
    for frame in ("01", "03"):
        told = {"keyframes": [{"camera": "camera", "frame": frame}]}
        (tmp_path / "ws/inpaint/keyframes.json").write_text(json.dumps(told))
        bpy.ops.unveil.load_workspace()
        assert {m.name: m.frame for m in scene.timeline_markers} == {
            "mine": 6,
            f"Fill {1001 + int(frame)}": 1001 + int(frame),
        }
        kept = {i.name: i.filepath for i in bpy.data.images if str(i.get("unveil_role")).startswith("keyframe:")}
        assert kept == {f"Fill {1001 + int(frame)}": str(tmp_path / f"ws/inpainted/camera/{frame}.png")}
    # A workspace that was moved is the same drive; a second one beside it is another.
    (tmp_path / "ws").rename(tmp_path / "moved")
    bpy.ops.unveil.load_workspace(directory=str(tmp_path / "moved"))
    assert len(scene.collection.children) == 1
    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    assert len(scene.collection.children) == 2


def test_lists_and_boxes_are_drawn_from_plain_functions(addon, scene, made: Path) -> None:
    """What a window draws, without one: lines and colours of the boxes, and the texts of the rows."""
    from types import SimpleNamespace

    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    bpy.ops.unveil.load_workspace(directory=str(made / "ws"))
    gizmos, panels = addon.module("choice.box_gizmos"), addon.module("ui.panel_selection")
    ((ends, color, width),) = gizmos.lines_of(bpy.context, None)
    assert len(ends) == 24 and color == gizmos.GOES and width == gizmos.ACTIVE_PX
    bpy.ops.unveil.toggle_object(number=5)
    assert gizmos.lines_of(bpy.context, None)[0][1] == gizmos.STAYS
    assert gizmos.lines_of(bpy.context, 5)[0][1] == gizmos.POINTED
    assert gizmos.UNVEIL_GGT_boxes.poll(bpy.context)
    # The view through the camera, in a region of twice the picture's size: the pointer is on the car, then beside it.
    depsgraph, camera = bpy.context.evaluated_depsgraph_get(), scene.camera
    width, height = 256, 160
    matrix = camera.calc_matrix_camera(depsgraph, x=width, y=height) @ camera.matrix_world.inverted()
    view = SimpleNamespace(
        scene=scene,
        region=SimpleNamespace(width=width, height=height),
        region_data=SimpleNamespace(perspective_matrix=matrix),
    )
    middle = world_to_camera_view(scene, camera, Vector(scene.unveil_selection.objects[0].centre))
    assert gizmos.box_at(view, (middle.x * width, middle.y * height)) == 5
    assert gizmos.box_at(view, (3, 150)) is None
    scene.unveil_selection.boxes = "NONE"
    assert gizmos.lines_of(bpy.context, 5) == [] and not gizmos.UNVEIL_GGT_boxes.poll(bpy.context)
    size, distance, frames = panels.measures(scene.unveil_selection.objects[0])
    assert 2 < float(size) < 6 and float(distance) > 0 and frames == "8"

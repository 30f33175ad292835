"""Plates for compositing: the sequences, the node group, and that a compositor dials an object back with it."""

from __future__ import annotations

import importlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import outside

START = 1001


@pytest.fixture(scope="module")
def exported(addon, finished: Path, tmp_path_factory) -> Path:  # type: ignore[no-untyped-def]
    """A finished workspace whose plates the button has made. Not to be changed."""
    import bpy

    folder = Path(shutil.copytree(finished, tmp_path_factory.mktemp("exported") / "workspace"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.unveil.load_workspace(directory=str(folder))
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    return folder


@pytest.fixture
def workspace(workspace: Path) -> Path:
    """One whose stages left no stamps: these tests put results of their own in their places."""
    shutil.rmtree(workspace / ".made")
    return workspace


@pytest.fixture
def made(addon, exported: Path, scene, workspace: Path):  # type: ignore[no-untyped-def]
    """The scene of a finished workspace, as it is after the button."""
    import bpy

    shutil.copytree(exported / "plates", workspace / "plates")
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    show = addon.module("work.operators_plates")._show
    show(bpy.context, str(workspace), lens="DELIVERED", add=False)
    return bpy.data.node_groups["Unveil camera"]


def sockets(group, way: str) -> dict[str, object]:  # type: ignore[no-untyped-def]
    return {i.name: i for i in group.interface.items_tree if i.item_type == "SOCKET" and i.in_out == way}


def linear(picture: np.ndarray) -> np.ndarray:
    return np.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)


def pixels(path: Path, *, as_stored: bool) -> np.ndarray:
    """(H, W, 3) from the upper edge, as the file has them."""
    import bpy

    image = bpy.data.images.load(str(path), check_existing=False)
    if as_stored:
        image.colorspace_settings.is_data = True
    found = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(found)
    width, height = image.size
    found = found.reshape(height, width, -1)[::-1, :, :3]
    bpy.data.images.remove(image)
    return found


def composed(scene, group, output: str, factors: dict[str, float], frame: int, path: Path) -> np.ndarray:  # type: ignore[no-untyped-def]
    """What the compositor makes of an output of the group, by a render of one frame to an EXR of 32 bits."""
    import bpy

    tree = importlib.import_module("bl_ext.user_default.unveil.scene.versions").compositor_of(scene)
    tree.nodes.clear()
    before_5 = hasattr(bpy.types, "CompositorNodeComposite")
    result = tree.nodes.new("CompositorNodeComposite" if before_5 else "NodeGroupOutput")
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    for name, value in factors.items():
        node.inputs[name].default_value = value
    tree.links.new(node.outputs[output], result.inputs["Image"])
    render, settings = scene.render, scene.render.image_settings
    render.engine, scene.cycles.samples, render.use_sequencer = "CYCLES", 1, False
    render.resolution_percentage = 100
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    scene.view_settings.exposure = 2.0  # of no account
    scene.frame_set(frame)
    render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return pixels(path, as_stored=True)


def test_without_delivered_frames_there_is_nothing_to_do(addon, scene, workspace) -> None:
    import bpy

    assert not bpy.ops.unveil.plates.poll() and not bpy.ops.unveil.add_to_compositor.poll()
    shutil.rmtree(workspace / "frames")
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert not bpy.ops.unveil.plates.poll()


def test_the_group_plays_the_plates(addon, scene, workspace, made) -> None:
    import bpy

    folder = workspace / "plates"
    for place in ("png/camera", "mattes/camera/car_0005", "mattes/camera/provenance", "mattes/camera/certainty"):
        stem = Path(place).name
        assert sorted(p.name for p in (folder / place).iterdir()) == [f"{stem}.{START + i}.png" for i in range(8)]
    assert list(sockets(made, "INPUT")) == [o.name for o in scene.unveil_selection.objects] == ["car 5"]
    factor = sockets(made, "INPUT")["car 5"]
    assert (factor.min_value, factor.max_value, factor.default_value, factor.subtype) == (0, 1, 1, "FACTOR")
    assert list(sockets(made, "OUTPUT")) == ["Image", "Matte", "Provenance", "Certainty"]
    nodes = {n["unveil_role"]: n for n in made.nodes if n.bl_idname == "CompositorNodeImage"}
    assert set(nodes) == {"photograph", "clean", "car_0005", "provenance", "certainty"}
    for kind, node in nodes.items():
        assert (node.frame_start, node.frame_duration, node.use_auto_refresh) == (START, 8, True)
        assert node.image.source == "SEQUENCE"
        assert node.image.colorspace_settings.is_data == (kind not in ("photograph", "clean"))
        first = Path(bpy.path.abspath(node.image.filepath))
        assert first.is_file() and (node.frame_offset == int(first.stem.split(".")[-1]) - 1)
    assert Path(bpy.path.abspath(nodes["clean"].image.filepath)) == folder / "png/camera/camera.1001.png"
    # Made available, and no more.
    assert made.use_fake_user and addon.module("scene.versions").shown_compositor(scene) is None


def test_once_more_leaves_one_group_and_the_artists_work(addon, scene, workspace, made) -> None:
    import bpy

    def there() -> tuple[int, int]:
        return len(bpy.data.node_groups), len(bpy.data.images)

    before = there()
    made.name = "mine"
    extra = made.nodes.new("CompositorNodeBlur")
    scene.unveil.start_frame = 11
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    assert there() == before and extra in list(made.nodes)
    (clean,) = (n for n in made.nodes if n.get("unveil_role") == "clean")
    assert (clean.frame_start, clean.frame_offset) == (11, 10)
    assert Path(bpy.path.abspath(clean.image.filepath)).name == "camera.0011.png"
    # Another object is removed: its input comes, the others and their values stay.
    assert bpy.ops.unveil.add_to_compositor() == {"FINISHED"} == bpy.ops.unveil.add_to_compositor()
    tree = addon.module("scene.versions").shown_compositor(scene)
    (node,) = (n for n in tree.nodes if n.bl_idname == "CompositorNodeGroup")
    assert not any(s.is_linked for s in (*node.inputs, *node.outputs))
    node.inputs["car 5"].default_value = 0.25
    entries = json.loads((workspace / "instances.json").read_text())
    (workspace / "instances.json").write_text(json.dumps([*entries, {**entries[0], "id": 9}]))
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    assert list(sockets(made, "INPUT")) == ["car 5", "car 9"]
    assert [s.default_value for s in node.inputs] == [0.25, 1.0]


def test_a_factor_brings_the_object_back(addon, scene, workspace, made, tmp_path) -> None:
    """By a render through the compositor: pixels of the clean plate, of the photograph, and half of each."""
    frame, name = 1005, "04"
    photograph = linear(pixels(workspace / f"drive/images/camera/{name}.png", as_stored=True))
    clean = linear(pixels(workspace / f"plates/png/camera/camera.{frame}.png", as_stored=True))
    matte = pixels(workspace / f"plates/mattes/camera/car_0005/car_0005.{frame}.png", as_stored=True)[..., :1]
    changed = np.abs(photograph - clean).max(axis=2)
    assert changed.max() > 0.05 and (matte[changed > 0] == 1).all()
    for factor in (1.0, 0.0, 0.5):
        found = composed(scene, made, "Image", {"car 5": factor}, frame, tmp_path / f"{factor}.exr")
        expected = photograph + factor * matte * (clean - photograph)
        assert found.shape == (80, 128, 3)
        assert np.abs(found - expected).max() < 2e-5, factor
    shown = composed(scene, made, "Matte", {"car 5": 0.5}, frame, tmp_path / "matte.exr")
    assert np.abs(shown[..., 0] - 0.5 * matte[..., 0]).max() < 2e-5
    for kind, white in (("provenance", 255), ("certainty", 1)):
        told = composed(scene, made, kind.capitalize(), {}, frame, tmp_path / f"{kind}.exr")
        stored = pixels(workspace / f"{kind}/camera/{name}.png", as_stored=True)
        assert np.abs(told - white * stored).max() < 1e-4 and np.ptp(stored) > 0


def test_a_picture_before_a_gap_stays(addon, scene, workspace) -> None:
    """Two pictures were lost after the fourth: all sequences hold it as long as the others of a rig would go on."""
    import bpy

    path = workspace / "drive/cameras.json"
    document = json.loads(path.read_text())
    document["frame_rate"] = 10.0
    for i, entry in enumerate(document["frames"]):
        entry["timestamp"] = 0.1 * (i if i < 4 else i + 2)
    path.write_text(json.dumps(document))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    stored = {"photograph": "drive/images/camera/{:02d}.png", "clean": "frames/camera/{:02d}.png"}
    for node in bpy.data.node_groups["Unveil camera"].nodes:
        if node.bl_idname != "CompositorNodeImage":
            continue
        assert (node.frame_start, node.frame_duration, node.frame_offset) == (START, 10, -1)
        first = Path(bpy.path.abspath(node.image.filepath))
        found = [first.with_name(f"{n:06d}{first.suffix}").read_bytes() for n in range(10)]
        assert found[3] == found[4] == found[5] and len(set(found)) > 4
        if node["unveil_role"] in stored:
            order = [0, 1, 2, 3, 3, 3, 4, 5, 6, 7]
            assert found == [(workspace / stored[node["unveil_role"]].format(n)).read_bytes() for n in order]


SPLIT = """
import sys, pathlib, json, cv2
root = pathlib.Path(sys.argv[1])
for path in (root / "drive/instances/camera").iterdir():
    path, ids = path.resolve(), cv2.imread(str(path), -1)
    columns = (ids == 5).any(axis=0).nonzero()[0]
    left = ids[:, : (columns[0] + columns[-1]) // 2] if len(columns) else ids[:, :0]
    left[left == 5] = 9
    (root / "drive/instances/camera" / path.name).unlink()
    cv2.imwrite(str(root / "drive/instances/camera" / path.name), ids)
entries = json.loads((root / "instances.json").read_text())
(root / "instances.json").write_text(json.dumps([*entries, {**entries[0], "id": 9}]))
"""


def test_one_of_two_objects_comes_back(addon, scene, workspace, tmp_path) -> None:
    """The car in two halves that touch: where the right one is dialled back stands the photograph, else the clean plate."""
    import bpy

    outside("-c", SPLIT, str(workspace))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert bpy.ops.unveil.plates() == {"FINISHED"}
    group = bpy.data.node_groups["Unveil camera"]
    photograph = linear(pixels(workspace / "drive/images/camera/04.png", as_stored=True))
    clean = linear(pixels(workspace / "plates/png/camera/camera.1005.png", as_stored=True))
    mattes = [
        pixels(workspace / f"plates/mattes/camera/car_000{n}/car_000{n}.1005.png", as_stored=True)[..., :1]
        for n in (5, 9)
    ]
    changed = np.abs(photograph - clean).max(axis=2) > 0
    assert (np.maximum(*mattes)[changed] == 1).all()
    found = composed(scene, group, "Image", {"car 5": 0.0, "car 9": 1.0}, 1005, tmp_path / "one.exr")
    assert np.abs(found - (photograph + mattes[1] * (clean - photograph))).max() < 2e-5
    for matte, expected in zip((mattes[0] * (mattes[1] == 0), mattes[1]), (photograph, clean), strict=True):
        own = (matte[..., 0] == 1) & changed
        assert own.sum() > 50 and np.abs(found - expected)[own].max() < 2e-5


def test_the_button_shows_and_asks_no_disk(addon, scene, workspace, monkeypatch) -> None:
    import bpy
    from check_run import drawn

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    for name in ("stat", "lstat", "open", "scandir", "listdir"):
        monkeypatch.setattr(os, name, forbidden)
    drawn(addon.module("ui.panel_results").UNVEIL_PT_results)
    assert bpy.ops.unveil.plates.poll() and not bpy.ops.unveil.add_to_compositor.poll()


def forbidden(*_: object, **__: object) -> None:
    raise AssertionError("the disk was asked")


def test_damaged_plates_are_one_line(addon, scene, workspace, made) -> None:
    import bpy

    read = addon.module("formats.plate_files").read_plates
    drive = addon.module("formats.drive_files").read_drive(workspace)
    (workspace / "plates/mattes/camera/car_0005/car_0005.1003.png").unlink()
    with pytest.raises(ValueError, match=r"car_0005\.1003\.png is missing \(make the plates again\)"):
        read(drive)
    told = workspace / "plates/mattes/export.json"
    content = json.loads(told.read_text())
    content["mattes"][0]["name"] = "../../.."
    told.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="not a file name"):
        read(drive)
    told.unlink()
    with pytest.raises(ValueError, match="there are no plates yet"):
        read(drive)
    shutil.rmtree(workspace / "plates")
    shutil.rmtree(workspace / "masks/removed")
    with pytest.raises(RuntimeError, match="masks/removed"):
        bpy.ops.unveil.plates()


# ------------------------------------------------------------------------------------------------------------------------ lens

PREPARE = """
import sys, pathlib, shutil
from unveil_core.drives.imported import read_imported
from unveil_core.delivery.lens import write_st_maps
root = pathlib.Path(sys.argv[1])
drive = read_imported(root / "drive", points=False)
for frame in drive.frames:
    shutil.copyfile(frame.footage.path, root / "frames/camera" / (frame.name + ".png"))
first = drive.frames[0]
write_st_maps(first.footage, first.camera, root / "st_maps/camera")
"""


def test_undistorted_fits_behind_the_camera(addon, scene, street, workspace, tmp_path) -> None:
    """Footage of 128x80 in a lens, a scene of 64x40: the undistorted plate is what import undistorted, at full size."""
    import bpy

    shutil.copytree(street.parent, tmp_path / "street")
    document = json.loads((tmp_path / "street/transforms.json").read_text())
    document["camera_model"], document["k1"] = "OPENCV", -0.2
    (tmp_path / "street/transforms.json").write_text(json.dumps(document))
    outside(
        "-m", "unveil_core", "import", str(tmp_path / "street"), "-o", str(workspace), "--replace", "--work-side", "64"
    )
    for place in ("masks/removed", "masks/shadows", "provenance", "certainty"):
        halve(workspace / place / "camera")
    outside("-c", PREPARE, str(workspace))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert bpy.ops.unveil.plates(lens="UNDISTORTED") == {"FINISHED"}
    group = bpy.data.node_groups["Unveil camera"]
    maps = {i["unveil_role"]: i for i in bpy.data.images if str(i.get("unveil_role")).startswith("st:")}
    assert set(maps) == {"st:undistort:camera", "st:redistort:camera"}
    assert all(i.colorspace_settings.is_data and tuple(i.size) == (128, 80) for i in maps.values())
    scene.render.resolution_x, scene.render.resolution_y = 128, 80
    flat = composed(scene, group, "Image", {}, 1004, tmp_path / "flat.exr")
    assert flat.shape == (80, 128, 3)
    assert bpy.ops.unveil.plates(lens="DELIVERED") == {"FINISHED"}
    assert bpy.data.node_groups["Unveil camera"] == group and not any(
        n.bl_idname == "CompositorNodeMapUV" for n in group.nodes
    )
    bent = composed(scene, group, "Image", {}, 1004, tmp_path / "bent.exr")
    footage = linear(pixels(workspace / "drive/footage/camera/03.png", as_stored=True))
    assert np.abs(bent - footage).max() < 2e-5
    inner = (slice(8, -8), slice(8, -8))
    expected = read_at(footage, pixels(workspace / "st_maps/camera/undistort.exr", as_stored=True))[inner]
    error, before = (float(np.abs(picture[inner] - expected).mean()) for picture in (flat, bent))
    print(f"mean difference from the ST map's: {error:.5f} undistorted, {before:.5f} as delivered")
    sharp = "filter_type" not in bpy.types.CompositorNodeMapUV.bl_rna.properties  # up to 4.5 Blender smooths
    assert error < (0.02 if sharp else 0.4) * before


def read_at(picture: np.ndarray, st: np.ndarray) -> np.ndarray:
    """A picture (H, W, 3) read where an ST map says, linearly between pixels."""
    height, width = picture.shape[:2]
    x = np.clip(st[..., 0] * width - 0.5, 0, width - 1.001)
    y = np.clip((1 - st[..., 1]) * height - 0.5, 0, height - 1.001)
    i, j = x.astype(int), y.astype(int)
    u, v = (x - i)[..., None], (y - j)[..., None]
    upper, lower = (picture[j + k, i] * (1 - u) + picture[j + k, i + 1] * u for k in (0, 1))
    return upper * (1 - v) + lower * v


def halve(folder: Path) -> None:
    """Pictures of 128x80 as such of 64x40."""
    program = (
        "import sys, pathlib, cv2\n"
        "for p in pathlib.Path(sys.argv[1]).iterdir():\n"
        "    cv2.imwrite(str(p), cv2.imread(str(p), -1)[::2, ::2])"
    )
    outside("-c", program, str(folder))

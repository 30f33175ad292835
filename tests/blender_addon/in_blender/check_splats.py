"""The Gaussians of a workspace as a point cloud of Blender's own type, which Blender 5.3 has.

Before that it is said to be there, and a cloud is made from a mesh; the attributes are those that are written.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import outside

FACTS = ("label", "instance", "provenance")


@pytest.fixture
def native(addon, monkeypatch):  # type: ignore[no-untyped-def]
    """A Blender that is said to have native Gaussians."""
    import bpy

    versions = addon.module("scene.versions")
    if versions.has_native_splats():
        return
    if "POINTCLOUD" not in bpy.ops.object.convert.get_rna_type().properties["target"].enum_items:
        pytest.skip("Blender 4.2 makes no point clouds, by its own operator or another")

    def new_splat_cloud(name: str, count: int):  # type: ignore[no-untyped-def]
        mesh = bpy.data.meshes.new(name)
        mesh.vertices.add(count)
        thing = bpy.data.objects.new(name, mesh)
        bpy.context.scene.collection.objects.link(thing)
        with bpy.context.temp_override(object=thing, active_object=thing, selected_objects=[thing]):
            bpy.context.view_layer.objects.active = thing
            thing.select_set(True)
            assert bpy.ops.object.convert(target="POINTCLOUD") == {"FINISHED"}
        cloud = thing.data
        bpy.data.objects.remove(thing)
        if mesh.name in bpy.data.meshes and not mesh.users:
            bpy.data.meshes.remove(mesh)
        return cloud

    monkeypatch.setattr(versions, "has_native_splats", lambda: True)
    monkeypatch.setattr(versions, "new_splat_cloud", new_splat_cloud)


@pytest.fixture
def surfels(finished: Path, tmp_path: Path) -> Path:
    """A workspace without what takes long to load."""
    return Path(shutil.copytree(finished, tmp_path / "ws"))


def values(cloud, name: str, part: str, width: int) -> np.ndarray:  # type: ignore[no-untyped-def]
    found = np.empty(len(cloud.points) * width, np.float32)
    cloud.attributes[name].data.foreach_get(part, found)
    return found.reshape(-1, width)


def test_this_blender_is_asked_not_its_version(addon) -> None:
    import bpy

    versions = addon.module("scene.versions")
    has_type = "type" in bpy.types.PointCloud.bl_rna.properties
    assert versions.has_native_splats() == has_type


def test_all_gaussians_have_the_attributes_of_the_file(addon, scene, native, surfels: Path) -> None:
    import bpy

    scene.unit_settings.scale_length = 0.01
    assert bpy.ops.unveil.load_workspace(directory=str(surfels)) == {"FINISHED"}
    thing = bpy.data.objects["Gaussians after"]
    cloud = thing.data
    ply = addon.module("formats.ply_file").read_ply(surfels / "surfels/empty.ply")
    table = ply.vertices
    assert thing.type == "POINTCLOUD" and len(cloud.points) == len(table) == thing["unveil_gaussians_shown"] > 1000
    assert np.allclose(values(cloud, "position", "vector", 3), ply.positions * 100, rtol=1e-5)
    scales = np.stack([np.exp(table[f"scale_{i}"]) for i in range(3)], axis=1) * 100
    shown, in_file = values(cloud, "scale", "vector", 3), np.maximum(scales, 0.01)
    short = in_file.max(axis=1) <= 100  # a metre: longer ones may be needles
    assert short.mean() > 0.5 and np.allclose(shown[short], in_file[short], rtol=1e-4)
    assert (shown <= in_file * 1.0001).all()
    assert cloud.attributes["rotation"].data_type == "QUATERNION"
    quats = np.stack([table[f"rot_{i}"] for i in range(4)], axis=1)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    assert np.allclose(values(cloud, "rotation", "value", 4), quats, atol=1e-5)
    kind, part = addon.module("scene.versions").four_floats()
    assert cloud.attributes["radiance:base"].data_type == kind and cloud.attributes["radiance:base"].domain == "POINT"
    base = values(cloud, "radiance:base", part, 4)
    assert np.allclose(base[:, :3], np.stack([table[f"f_dc_{i}"] for i in range(3)], axis=1), atol=1e-6)
    assert np.allclose(base[:, 3], 1 / (1 + np.exp(-table["opacity"].astype(float))), atol=1e-6)
    further = sum(name.startswith("f_rest_") for name in table.dtype.names) // 3
    assert sum(a.name.startswith("radiance:sh_") for a in cloud.attributes) == further
    scene.unveil_view.shown, scene.unveil_view.state = {"SPLATS"}, "AFTER"
    bpy.context.view_layer.update()
    assert thing.visible_get() and not bpy.data.objects["Gaussians before"].visible_get()


def test_it_equals_what_blenders_own_importer_makes_of_the_export(addon, scene, surfels: Path) -> None:
    import bpy

    if not addon.module("scene.versions").has_native_splats():
        pytest.skip("this Blender has no Gaussians of its own")
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    for state in ("full", "empty"):
        exported = ("export", str(surfels), "--to", "splat-ply", "--state", state, "-o", str(surfels / "out"))
        outside("-m", "unveil_core", *exported)
        ours = bpy.data.objects["Gaussians before" if state == "full" else "Gaussians after"].data
        path = surfels / f"out/{state}_splats.ply"
        shift = json.loads(path.with_name(f"{path.name}.json").read_text())["shift"]
        bpy.ops.wm.ply_import(filepath=str(path), forward_axis="Y", up_axis="Z")
        theirs = bpy.context.view_layer.objects.active.data
        assert ours.type == theirs.type and len(ours.points) == len(theirs.points) > 1000
        part, width = {"FLOAT_VECTOR": "vector", "QUATERNION": "value", "FLOAT4": "vector"}, {"FLOAT_VECTOR": 3}
        compared = [a.name for a in theirs.attributes if a.name in ours.attributes and a.name not in FACTS]
        assert {"position", "scale", "rotation", "radiance:base"} <= set(compared)
        for name in compared:
            kind = theirs.attributes[name].data_type
            assert ours.attributes[name].data_type == kind
            one, other = (values(cloud, name, part[kind], width.get(kind, 4)) for cloud in (ours, theirs))
            if name == "position":  # the drive's coordinates are those of the workspace, moved
                one, other = one - one[0], other - other[0]
            assert np.allclose(one, other, rtol=1e-5, atol=1e-4 if name == "position" else 1e-6), (name, shift)
        assert np.array_equal(whole(ours, "instance"), values(theirs, "instance", "value", 1)[:, 0].astype(int))


def test_what_was_deleted_and_moved_becomes_a_state_of_the_workspace(addon, scene, native, surfels: Path) -> None:
    import bpy

    scene.unit_settings.scale_length = 0.01
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    thing = bpy.data.objects["Gaussians after"]
    read_ply = addon.module("formats.ply_file").read_ply
    before = read_ply(surfels / "surfels/empty.ply")
    assert bpy.ops.unveil.keep_splats() == {"FINISHED"}  # nothing was changed
    same = read_ply(surfels / "surfels/edited.ply")
    assert same.comments == before.comments
    short = np.stack([before.vertices[f"scale_{k}"] for k in range(2)]).max(axis=0) <= 0  # to a metre: no needles
    every = np.arange(len(before.vertices))
    one, other = (addon.module("formats.gaussians").gaussians_of(file, 1.0, every) for file in (same, before))
    for name in ("positions", "scales", "rotations", "base", "harmonics"):
        rows = short if name == "scales" else slice(None)
        assert np.allclose(
            getattr(one, name)[..., rows, :], getattr(other, name)[..., rows, :], atol=1e-4, rtol=1e-4
        ), name
    assert np.array_equal(same.vertices["label"], before.vertices["label"])
    thing.location.x = 300.0  # three metres
    bpy.context.view_layer.update()
    assert bpy.ops.unveil.keep_splats() == {"FINISHED"}
    moved = read_ply(surfels / "surfels/edited.ply")
    assert np.allclose(moved.positions - before.positions, (3, 0, 0), atol=1e-4)
    assert np.array_equal(moved.vertices["instance"], whole(thing.data, "instance"))
    if hasattr(thing.data, "resize"):  # a modifier, or Edit Mode, deletes some
        thing.location.x = 0.0
        thing.data.resize(500)
        bpy.context.view_layer.update()
        assert bpy.ops.unveil.keep_splats() == {"FINISHED"}
        assert np.allclose(read_ply(surfels / "surfels/edited.ply").positions, before.positions[:500], atol=1e-4)
    thing.scale = (1.0, 2.0, 1.0)
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match="scaled differently"):
        bpy.ops.unveil.keep_splats()
    outside(
        "-m",
        "unveil_core",
        "export",
        str(surfels),
        "--to",
        "splat-ply",
        "--state",
        "edited",
        "-o",
        str(surfels / "out"),
    )
    assert (surfels / "out/edited_splats.ply").is_file()


def whole(cloud, name: str) -> np.ndarray:  # type: ignore[no-untyped-def]
    found = np.empty(len(cloud.points), np.int32)
    cloud.attributes[name].data.foreach_get("value", found)
    return found


def test_each_gaussian_tells_class_object_and_provenance(addon, scene, native, surfels: Path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(surfels))
    before, after = (bpy.data.objects[f"Gaussians {state}"].data for state in ("before", "after"))
    edit = np.load(surfels / "surfels/edit.npz")
    removed = edit["removed"]
    assert set(whole(before, "instance")[removed]) <= {0, 5} and (whole(before, "instance") == 5).sum() > 10
    assert set(whole(after, "instance")) <= {0} | set(whole(before, "instance"))
    added = len(edit["origin"])
    assert set(whole(after, "provenance")[-added:]) <= {3, 4} and set(whole(after, "provenance")[:-added]) <= {1, 2}
    assert len(set(whole(after, "label"))) > 2


RENDER = """
import sys
import numpy as np
import torch
from pathlib import Path
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.imported import read_imported
from unveil_core.raster.picture import picture_of
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.sky import load_sky
root = Path(sys.argv[1])
camera = read_imported(root / "drive", points=False).frames[3].camera
scene, sky = read_surfels(root / "surfels/empty.ply"), load_sky(root / "surfels/sky.npz")
nothing = scene.select(torch.zeros(0, dtype=torch.int64))
pictures = [picture_of(shown, sky, camera, near=NEAR_M, far=FAR_M) for shown in (scene, nothing)]
np.savez(sys.argv[2], street=pictures[0], sky=pictures[1])
"""
"""Writes the picture of the empty scene that ``unveil render`` makes, and the sky behind it."""


def flat_emission():  # type: ignore[no-untyped-def]
    """A material that shows the Gaussians' colours as the numbers that were optimized, encoded as sRGB."""
    import bpy

    material = bpy.data.materials.new("flat")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()

    def made(kind: str, *inputs, **settings):  # type: ignore[no-untyped-def]
        node = tree.nodes.new(f"ShaderNode{kind}")
        for name, value in settings.items():
            setattr(node, name, value)
        for socket, value in zip(node.inputs, inputs, strict=False):
            if isinstance(value, float):
                socket.default_value = value
            else:
                tree.links.new(value, socket)
        return node.outputs[0] if len(node.outputs) else None

    radiance = made("Attribute", attribute_name="radiance", attribute_type="GEOMETRY")  # scene linear
    split = tree.nodes.new("ShaderNodeSeparateColor")
    tree.links.new(radiance, split.inputs[0])
    encoded = []
    for channel in split.outputs[:3]:
        root = made("Math", made("Math", channel, 0.0, operation="MAXIMUM"), 1 / 2.4, operation="POWER")
        curve = made("Math", root, 1.055, -0.055, operation="MULTIPLY_ADD")
        line = made("Math", channel, 12.92, operation="MULTIPLY")
        encoded.append(made("Math", curve, line, operation="MINIMUM"))  # the line is the lower one below 0.0031
    color = made("CombineColor", *encoded)
    made("OutputMaterial", made("Emission", color, 1.0))
    return material


def test_a_render_of_them_is_unveils_own_on_the_mean(addon, scene, surfels: Path, tmp_path: Path) -> None:
    """In flat emission of the numbers that were optimized; as Blender shows them it blends in linear light, which is brighter."""
    import bpy

    if not addon.module("scene.versions").has_native_splats():
        pytest.skip("this Blender draws no Gaussians of its own")
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    outside("-c", RENDER, str(surfels), str(tmp_path / "own.npz"))
    own = {name: np.asarray(values, np.float64) for name, values in np.load(tmp_path / "own.npz").items()}
    largest = 255.0 if own["street"].max() > 2 else 1.0
    for thing in scene.objects:
        thing.hide_render = True
    cloud = bpy.data.objects["Gaussians after"]
    scene.unveil_view.shown, scene.unveil_view.state = {"SPLATS"}, "AFTER"
    cloud.hide_render = False
    render, settings = scene.render, scene.render.image_settings
    render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 16, False
    scene.cycles.pixel_filter_type = "BOX"
    render.film_transparent, render.use_sequencer, render.use_compositing = True, False, False
    addon.module("scene.versions").still_pictures(settings)
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    scene.frame_set(scene.frame_start + 3)
    off = {}
    for name, material in (("as Blender shows them", None), ("flat", flat_emission())):
        if material is not None:
            cloud.data.materials.append(material)
        render.filepath = str(tmp_path / "shot.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath, check_existing=False)
        image.colorspace_settings.is_data = True
        width, height = image.size
        found = np.empty(width * height * 4, np.float32)
        image.pixels.foreach_get(found)
        found = found.reshape(height, width, 4)[::-1].astype(np.float64)
        bpy.data.images.remove(image)
        color, alpha = found[..., :3], found[..., 3:]
        if material is None:
            color = np.where(color <= 0.0031308, 12.92 * color, 1.055 * np.maximum(color, 1e-9) ** (1 / 2.4) - 0.055)
        solid = alpha[..., 0] > 0.99
        shown = np.clip(color + (1 - alpha) * own["sky"] / largest, 0, 1)
        off[name] = 255 * (shown - own["street"] / largest)[solid if material is None else slice(None)].mean()
    assert abs(off["flat"]) < 1, off
    assert -1 < off["as Blender shows them"] < 4, off


def test_loaded_again_it_is_the_same_object(addon, scene, native, surfels: Path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(surfels))
    thing = bpy.data.objects["Gaussians after"]
    cloud = thing.data
    material = bpy.data.materials.new("the artist's")
    cloud.materials.append(material)
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    assert thing.data == cloud  # nothing has changed
    shutil.copy(surfels / "surfels/full.ply", surfels / "surfels/empty.ply")
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    before = bpy.data.objects["Gaussians before"].data
    assert bpy.data.objects["Gaussians after"] == thing and len(thing.data.points) == len(before.points)
    assert thing.data.materials[0] == material and thing.data.name == "Gaussians after"
    assert len(bpy.data.pointclouds) == 2


def test_squares_of_a_version_before_go(addon, scene, native, surfels: Path, monkeypatch) -> None:
    import bpy

    versions, blocks = addon.module("scene.versions"), addon.module("scene.blocks")
    bpy.ops.unveil.load_workspace(directory=str(surfels))
    thing = bpy.data.objects["Gaussians after"]
    mark, place = thing["unveil_drive"], thing.users_collection[0]
    for is_native in (True, False):
        if (cloud := bpy.data.objects.get("Gaussians after")) is not None:
            bpy.data.objects.remove(cloud)
        mesh = bpy.data.meshes.new("Gaussians after")
        blocks.ensure_object(mesh, mark, "splats:empty", "Gaussians after", place)
        monkeypatch.setattr(versions, "has_native_splats", lambda is_native=is_native: is_native)
        bpy.ops.unveil.load_workspace(directory=str(surfels))
        assert "Gaussians after" not in bpy.data.meshes
        assert ("Gaussians after" in bpy.data.objects) == is_native


def test_a_damaged_file_is_named(addon, scene, native, surfels: Path) -> None:
    import bpy

    shutil.copy(surfels / "meshes/empty.ply", surfels / "surfels/empty.ply")
    with pytest.raises(RuntimeError, match="empty.ply.*holds no surfels"):
        bpy.ops.unveil.load_workspace(directory=str(surfels))

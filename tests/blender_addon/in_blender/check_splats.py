"""The Gaussians of a workspace as a point cloud of Blender's own type, which Blender 5.3 has.

No bpy here has that type. So it is said to be there, and a cloud is made from a mesh; the attributes are those that are written.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest


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
    assert np.allclose(values(cloud, "scale", "vector", 3), np.maximum(scales, 0.01), rtol=1e-4)
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

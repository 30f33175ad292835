"""My car in the empty street: the scene renders the artist's objects over the clean plate, with their shadows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest


def new_file():  # type: ignore[no-untyped-def]
    """The scene of Blender's own new file, with its cube, light and camera."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True)
    return bpy.context.scene


def pixels_of(path: Path) -> np.ndarray:
    """(H, W, 3) from 0 to 255."""
    import bpy

    image = bpy.data.images.load(str(path), check_existing=False)
    width, height = image.size
    found = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(found)
    bpy.data.images.remove(image)
    return found.reshape(height, width, 4)[::-1, :, :3] * 255


def test_a_new_files_cube_light_and_camera_are_put_aside(addon, workspace: Path) -> None:
    import bpy

    scene = new_file()
    bpy.data.objects["Light"].location.x += 1  # the artist's now
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.context.view_layer.update()
    seen = {o.name for o in scene.objects if o.visible_get()}
    assert "Light" in seen and not {"Cube", "Camera"} & seen
    assert {o.name for o in bpy.data.collections["Set Aside"].objects} == {"Cube", "Camera"}
    assert scene.camera["unveil_track"] == "camera"
    assert addon.module("scene.cg.aside").put_aside(scene) == []  # once
    assert sum(c.name.startswith("Set Aside") for c in bpy.data.collections) == 1
    scene = new_file()
    scene.unveil.set_up_scene = False
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert "Set Aside" not in bpy.data.collections and scene.camera.name == "Camera"


def test_the_render_is_the_car_in_the_empty_street(addon, workspace: Path, tmp_path: Path) -> None:
    import bpy
    from mathutils import Vector

    scene = new_file()
    with pytest.raises(RuntimeError, match="no clean frames yet|poll"):
        bpy.ops.unveil.set_up_cg()
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    assert bpy.ops.unveil.set_up_cg() == {"FINISHED"}
    assert scene.render.film_transparent and scene.view_settings.view_transform == "Standard"
    mesh = bpy.data.objects["Mesh after"]
    assert mesh.is_shadow_catcher and not mesh.hide_render
    camera = scene.camera
    ahead = camera.matrix_world @ Vector((0, 0, -6))
    bpy.ops.mesh.primitive_cube_add(size=1.0, location=ahead)
    next(o for o in scene.objects if o.type == "LIGHT").rotation_euler = (0.6, 0.0, 0.0)
    car = bpy.context.object
    material = bpy.data.materials.new("Car")
    if material.node_tree is None:  # up to 4.5
        material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 0, 0, 1)
    car.data.materials.append(material)
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.render.filepath = str(tmp_path / "shot.png")
    scene.render.image_settings.file_format = "PNG"
    bpy.ops.render.render(write_still=True)
    shot = pixels_of(tmp_path / "shot.png")
    index = scene.frame_current - scene.frame_start
    clean = pixels_of(sorted((workspace / "frames/camera").glob("*.png"))[index])
    assert shot.shape == clean.shape
    off = np.abs(shot - clean).max(axis=2)
    height, width = off.shape
    middle = shot[height // 2 - 3 : height // 2 + 3, width // 2 - 3 : width // 2 + 3].mean(axis=(0, 1))
    assert middle[0] > 2 * middle[1]  # the car is there, and red
    assert np.median(off[: height // 4]) < 2.5  # above it the plate is as it was delivered
    darker = (clean - shot).min(axis=2) > 10
    assert darker[height // 2 :].sum() > 20  # its shadow lies on the street, which is not drawn itself
    # Once more changes nothing, and what is built by hand stays.
    tree = addon.module("scene.versions").compositor_of(scene)
    before = {n.name for n in tree.nodes}
    links = len(tree.links)
    assert bpy.ops.unveil.set_up_cg() == {"FINISHED"}
    assert {n.name for n in tree.nodes} == before and len(tree.links) == links


def test_what_the_compositor_has_stays_above_the_plate(addon, scene, workspace: Path) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    versions = addon.module("scene.versions")
    tree = versions.compositor_of(scene)
    (result,) = [n for n in tree.nodes if n.bl_idname in ("CompositorNodeComposite", "NodeGroupOutput")]
    blur = tree.nodes.new("CompositorNodeBlur")
    rendered = next(n for n in tree.nodes if n.bl_idname == "CompositorNodeRLayers")
    tree.links.new(rendered.outputs["Image"], blur.inputs["Image"])
    tree.links.new(blur.outputs["Image"], result.inputs["Image"])
    scene.render.use_compositing = False
    switched = "compositing_node_group" not in scene.bl_rna.properties  # up to 4.5
    if switched:
        scene.use_nodes = False
    bpy.ops.unveil.set_up_cg(shadows=False)
    assert scene.render.use_compositing and (not switched or scene.use_nodes)
    over = result.inputs["Image"].links[0].from_node
    below, above = versions.alpha_over_sockets(over)
    assert above.links[0].from_node == blur and below.links[0].from_node.bl_idname == "CompositorNodeScale"
    assert scene.render.engine != "CYCLES" and not bpy.data.objects["Mesh after"].is_shadow_catcher
    assert not [o for o in scene.objects if o.type == "LIGHT"]


def test_the_sky_is_brightened_where_nobody_has_touched_it(addon, workspace: Path) -> None:

    add_sky = addon.module("scene.cg.catcher").add_sky
    scene = new_file()
    color = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND").inputs["Color"]
    assert add_sky(scene) and color.default_value[2] > 0.25
    color.default_value = (1.0, 0.0, 0.0, 1.0)
    assert not add_sky(scene) and tuple(color.default_value) == (1.0, 0.0, 0.0, 1.0)
    scene.world = None
    assert not add_sky(scene)


@pytest.mark.parametrize("found", [None, (225.75, 56.5)])
def test_a_sun_is_added_where_there_is_no_light(addon, scene, workspace: Path, found) -> None:
    import bpy

    told = json.loads((workspace / "workspace.json").read_text())
    told["stages"]["inpaint"]["sun"] = found and {"azimuth_deg": found[0], "elevation_deg": found[1], "score": 0.9}
    (workspace / "workspace.json").write_text(json.dumps(told))
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.ops.unveil.set_up_cg()
    bpy.context.view_layer.update()
    (sun,) = [o for o in scene.objects if o.type == "LIGHT"]
    direction = np.array(sun.matrix_world.to_3x3() @ __import__("mathutils").Vector((0, 0, 1)))  # towards the sun
    azimuth, elevation = np.radians(found or (135, 40))  # of the footage, else of the settings
    wanted = np.array([np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    assert np.abs(direction - wanted).max() < 1e-4

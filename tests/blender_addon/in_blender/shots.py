"""A street of an artist's own in Blender: plates on disk, an animated camera before them, and a mesh of the street."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

FIRST, COUNT, SIZE = 1001, 6, (128, 80)


def write_plates(
    folder: Path, first: int = FIRST, count: int = COUNT, size: tuple[int, int] = SIZE, kind: str = "png"
) -> Path:
    """Numbered pictures that differ, PNG or EXR; returns the first."""
    import bpy

    folder.mkdir(parents=True)
    for k in range(count):
        image = bpy.data.images.new("plate", *size, float_buffer=kind == "exr")
        picture = np.ones((size[1], size[0], 4), np.float32)
        picture[..., 0] = np.linspace(0, 1, size[0])
        picture[..., 1] = (k + 1) / count
        picture[: size[1] // 2, :, 2] = 0.2
        image.pixels.foreach_set(picture.ravel())
        image.filepath_raw = str(folder / f"plate.{first + k}.{kind}")
        image.file_format = {"png": "PNG", "exr": "OPEN_EXR"}[kind]
        image.save()
        bpy.data.images.remove(image)
    return folder / f"plate.{first}.{kind}"


def set_range(scene, size: tuple[int, int] = SIZE, base: float = 1.001) -> None:  # type: ignore[no-untyped-def]
    scene.frame_start, scene.frame_end = FIRST, FIRST + COUNT - 1
    scene.render.fps, scene.render.fps_base = 24, base
    scene.render.resolution_x, scene.render.resolution_y = size


def moving_camera(scene):  # type: ignore[no-untyped-def]
    """A camera that drives along y, turns and zooms, below a parent that is moved and turned."""
    import bpy

    parent = bpy.data.objects.new("rig", None)
    parent.location, parent.rotation_euler = (2.0, -3.0, 0.5), (0.0, 0.0, 0.3)
    data = bpy.data.cameras.new("shotcam")
    data.sensor_width, data.lens = 24.0, 20.0
    camera = bpy.data.objects.new("shotcam", data)
    camera.parent = parent
    for thing in (parent, camera):
        scene.collection.objects.link(thing)
    for k in range(COUNT):
        frame = FIRST + k
        camera.location = (0.1 * k, 1.2 * k, 1.1 + 0.02 * k)
        camera.rotation_euler = (math.radians(85 - k), math.radians(0.5 * k), math.radians(2.0 * k))
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_euler", frame=frame)
    scene.camera = camera
    return camera


def ground(scene, name: str = "ground"):  # type: ignore[no-untyped-def]
    """A mesh of 11x31 vertices on z = 0, selected."""
    import bpy

    x, y = np.meshgrid(np.linspace(-5, 5, 11), np.linspace(0, 30, 31))
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).tolist(), [], [])
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    thing.select_set(True)
    return thing


def behind(camera, first: Path):  # type: ignore[no-untyped-def]
    """The plates as a background image sequence of a camera."""
    import bpy

    plate = camera.data.background_images.new()
    plate.image = bpy.data.images.load(str(first))
    plate.image.source = "SEQUENCE"
    user = plate.image_user
    user.frame_start, user.frame_duration, user.frame_offset = FIRST, COUNT, FIRST - 1
    camera.data.show_background_images = True
    return plate


def poses(camera) -> np.ndarray:  # type: ignore[no-untyped-def]
    """(N, 4, 4) of a camera at the frames of the shot, without its scale."""
    import bpy

    found = []
    for k in range(COUNT):
        bpy.context.scene.frame_set(FIRST + k)
        matrix = np.array(camera.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world, dtype=np.float64)
        matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)
        found.append(matrix)
    return np.array(found)

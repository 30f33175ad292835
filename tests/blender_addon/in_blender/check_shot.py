"""Use This Shot: the artist's camera and plates as a drive, from Blender's own scene and from files of other programs."""

from __future__ import annotations

import json
import math
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from shots import COUNT, FIRST, SIZE, behind, ground, moving_camera, poses, set_range, write_plates

FOCAL = 20.0 / 24.0 * SIZE[0]


def use_shot(folder: Path, **options) -> dict:  # type: ignore[no-untyped-def]
    import bpy

    assert bpy.ops.unveil.use_shot(folder=str(folder), run_import=False, **options) == {"FINISHED"}
    return json.loads((folder / "transforms.json").read_text())


def matrices(drive: dict) -> np.ndarray:
    return np.array([f["transform_matrix"] for f in drive["frames"]])


def test_a_scene_becomes_a_drive(scene, tmp_path: Path) -> None:
    first = write_plates(tmp_path / "plates")
    set_range(scene)
    camera = moving_camera(scene)
    behind(camera, first)
    ground(scene)
    drive = use_shot(tmp_path / "shot")
    assert drive["metric"] and drive["up"] == [0, 0, 1] and drive["keep_origin"]
    assert (drive["w"], drive["h"]) == SIZE and "k1" not in drive
    np.testing.assert_allclose(matrices(drive), poses(camera), atol=1e-6)
    names = [f["file_path"] for f in drive["frames"]]
    assert names == [f"../plates/plate.{FIRST + k}.png" for k in range(COUNT)]
    assert drive["frames"][5]["timestamp"] == pytest.approx(5 * 1.001 / 24)
    assert drive["frames"][0]["fl_x"] == pytest.approx(FOCAL, rel=1e-6)
    assert drive["frames"][0]["fl_y"] == pytest.approx(FOCAL, rel=1e-6)
    assert (drive["frames"][0]["cx"], drive["frames"][0]["cy"]) == pytest.approx((64, 40))
    assert b"element vertex 341\n" in (tmp_path / "shot/points.ply").read_bytes()


@pytest.mark.parametrize("kind", ["abc", "fbx", "usdc"])
def test_cameras_of_other_programs(scene, tmp_path: Path, kind: str) -> None:
    import bpy

    first = write_plates(tmp_path / "plates")
    set_range(scene, base=1.0)  # Blender's reader of FBX places keys of 23.976 frames a second a thousandth late
    camera = moving_camera(scene)
    true = poses(camera)
    path = str(tmp_path / f"shot.{kind}")
    if kind == "abc":
        bpy.ops.wm.alembic_export(filepath=path, start=FIRST, end=FIRST + COUNT - 1)
    elif kind == "fbx":
        bpy.ops.export_scene.fbx(
            filepath=path,
            bake_anim_simplify_factor=0.0,
            bake_anim_use_all_actions=False,
            bake_anim_use_nla_strips=False,
        )
    else:
        bpy.ops.wm.usd_export(filepath=path, export_animation=True)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    set_range(scene, base=1.0)
    if kind == "abc":
        bpy.ops.wm.alembic_import(filepath=path, as_background_job=False, set_frame_range=False)
    elif kind == "fbx":
        bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0)
    else:
        bpy.ops.wm.usd_import(filepath=path, set_frame_range=False)
    set_range(scene, base=1.0)
    (scene.camera,) = (o for o in bpy.data.objects if o.type == "CAMERA")
    behind(scene.camera, first)
    drive = use_shot(tmp_path / "shot")
    np.testing.assert_allclose(matrices(drive), true, atol=1e-4)
    assert [f["fl_x"] for f in drive["frames"]] == pytest.approx([FOCAL] * COUNT, rel=1e-4)


def test_units_shift_and_pixel_aspect(scene, tmp_path: Path) -> None:
    """What another camera sees of a point is what the numbers of the drive say."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    scene.unit_settings.scale_length = 0.01
    scene.render.pixel_aspect_x = 2.0
    camera = moving_camera(scene)
    camera.data.shift_x, camera.data.shift_y, camera.data.sensor_fit = 0.1, -0.05, "VERTICAL"
    behind(camera, first)
    drive = use_shot(tmp_path / "shot")
    scene.frame_set(FIRST)
    point = Vector((1.0, 20.0, 2.0))
    seen = world_to_camera_view(scene, camera, point)
    frame = drive["frames"][0]
    local = np.linalg.inv(np.array(frame["transform_matrix"])) @ [*np.array(point) * 0.01, 1]
    x = frame["cx"] + frame["fl_x"] * local[0] / -local[2]
    y = frame["cy"] - frame["fl_y"] * local[1] / -local[2]
    assert (x, y) == pytest.approx((seen.x * SIZE[0], (1 - seen.y) * SIZE[1]), abs=1e-2)
    assert frame["fl_y"] == pytest.approx(2 * frame["fl_x"])
    assert not (tmp_path / "shot/points.ply").exists() and "ply_file_path" not in drive
    assert bpy.context.scene.frame_current == FIRST


def test_a_clip_starts_where_it_is_told(scene, tmp_path: Path) -> None:
    """A clip that begins at frame 1003 of the timeline with its second file; other frames are left out."""
    import bpy

    first = write_plates(tmp_path / "plates", first=7)
    set_range(scene)
    camera = moving_camera(scene)
    clip = bpy.data.movieclips.load(str(first))
    clip.frame_start, clip.frame_offset = 1003, 1
    plate = camera.data.background_images.new()
    plate.source, plate.clip = "MOVIE_CLIP", clip
    lens = clip.tracking.camera
    lens.sensor_width, lens.focal_length, lens.k1, lens.k2 = 24.0, 10.0, -0.1, 0.02
    drive = use_shot(tmp_path / "shot")
    names = [Path(f["file_path"]).name for f in drive["frames"]]
    assert names[-4:] == [f"plate.{n}.png" for n in (8, 9, 10, 11)] and names[:-4] == ["plate.7.png"]
    assert drive["k1"] == pytest.approx(-0.1 * 4) and drive["k2"] == pytest.approx(0.02 * 16)


def test_a_camera_that_stands_still_is_told(scene, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    """As after an import with another frame rate, whose keys lie elsewhere."""
    first = write_plates(tmp_path / "plates")
    set_range(scene)
    camera = moving_camera(scene)
    behind(camera, first)
    use_shot(tmp_path / "moving")
    assert "stands still" not in capfd.readouterr().out
    camera.animation_data_clear()
    assert len(use_shot(tmp_path / "standing")["frames"]) == COUNT
    assert "shotcam stands still in these frames: check the frame range" in capfd.readouterr().out


def test_what_cannot_be_used_is_told(scene, tmp_path: Path) -> None:
    import bpy

    set_range(scene)
    first = write_plates(tmp_path / "plates")

    def told() -> str:
        with pytest.raises(RuntimeError) as error:
            bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False)
        return str(error.value)

    camera = moving_camera(scene)
    assert "shotcam has no pictures behind it: add the plates" in told()
    plate = behind(camera, first)
    scene.render.resolution_x = 200
    assert "The plates are 128x80 and the scene renders 200x80" in told()
    scene.render.resolution_x = 128
    scene.frame_start, scene.frame_end = 1, 5
    assert "No frame of 1 to 5 has a plate" in told()
    set_range(scene)
    camera.scale.x = -1
    assert "is mirrored" in told()
    camera.scale = 0, 0, 0
    assert "has a scale of 0" in told()
    camera.scale = 1, 1, 1
    clip = bpy.data.movieclips.load(str(first))
    clip.frame_start = FIRST
    plate.source, plate.clip = "MOVIE_CLIP", clip
    clip.tracking.camera.distortion_model, clip.tracking.camera.division_k1 = "DIVISION", 0.1
    assert "has the model Division, which is not read: undistort the plates" in told()
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not bpy.ops.unveil.use_shot.poll()
    assert not (tmp_path / "shot").exists()


@pytest.mark.parametrize("kind", ["png", "exr"])
def test_it_is_imported_to_the_same_place(scene, tmp_path: Path, kind: str) -> None:
    """The same frames, far from the origin, in centimetres; nothing of the scene is changed."""
    import bpy

    first = write_plates(tmp_path / "plates", kind=kind)
    set_range(scene)
    scene.unit_settings.scale_length = 0.01
    camera = moving_camera(scene)
    camera.parent.location, camera.parent.scale = (50_000.0, -30_000.0, 0.0), (100.0,) * 3
    behind(camera, first)
    street = ground(scene)
    street.location, street.scale = camera.parent.location, (100.0,) * 3
    bpy.context.view_layer.update()
    true = poses(camera)
    done = bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), workspace=str(tmp_path / "work"))
    assert done == {"FINISHED"}
    assert scene.camera == camera and (scene.frame_start, scene.frame_end) == (FIRST, FIRST + COUNT - 1)
    (own,) = (o for o in bpy.data.objects if o.get("unveil_track"))
    np.testing.assert_allclose(poses(own)[:, :3, 3], true[:, :3, 3], atol=0.01)  # a tenth of a millimetre
    np.testing.assert_allclose(poses(own)[:, :3, :3], true[:, :3, :3], atol=1e-4)
    points = next(o for o in bpy.data.objects if o.name.startswith("Points"))
    assert points["unveil_points"] == 341
    (plate,) = (b for b in own.data.background_images if b.image is not None)
    assert plate.image.filepath.endswith(f".{kind}") and plate.image_user.frame_start == FIRST


def test_a_chan_of_the_camera_is_the_same_drive(scene, tmp_path: Path) -> None:
    """Written as Nuke does, y up: the core reads the cameras that Use This Shot makes."""
    import bpy
    from mathutils import Matrix

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    camera = moving_camera(scene)
    behind(camera, first)
    ground(scene)
    drive = use_shot(tmp_path / "shot")
    y_up = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
    fov = math.degrees(2 * math.atan(SIZE[1] / 2 / FOCAL))
    lines = []
    for frame, matrix in zip(range(FIRST, FIRST + COUNT), poses(camera), strict=True):
        turned = y_up @ Matrix(matrix.tolist())
        angles = turned.to_euler("ZXY")
        numbers = (*turned.translation, *(math.degrees(a) for a in angles), fov)
        lines.append(f"{frame} " + " ".join(f"{v:.8f}" for v in numbers))
    (tmp_path / "cam.chan").write_text("\n".join(lines) + "\n")
    program = (
        "import sys, json, numpy as np; from unveil_core.drives.formats.registry import open_drive as o;"
        "print(json.dumps([[f.image_path.name, f.camera.world_to_camera.tolist(), f.camera.fx, f.camera.fy]"
        " for f in o(sys.argv[1]).frames]))"
    )
    command = [os.environ["UNVEIL_PYTHON"], "-c", program]
    of_chan, of_shot = (
        json.loads(subprocess.run([*command, str(tmp_path / name)], check=True, capture_output=True).stdout)
        for name in ("cam.chan", "shot")
    )
    assert len(of_chan) == COUNT == len(drive["frames"])
    for one, other in zip(of_chan, of_shot, strict=True):
        assert one[0] == other[0]
        np.testing.assert_allclose(np.array(one[1]) @ np.array(y_up), other[1], atol=1e-4)
        assert one[2:] == pytest.approx(other[2:], rel=1e-4)
    assert bpy.context.scene.camera == camera

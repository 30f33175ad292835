"""Use This Shot with what the Movie Clip Editor knows: reconstructed tracks, lenses, and movies."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from shots import COUNT, FIRST, SIZE, behind, moving_camera, poses, set_range, write_plates


def seen_points(scene, camera) -> np.ndarray:  # type: ignore[no-untyped-def]
    """(24, 3) that the camera shows in all frames."""
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    generator = np.random.default_rng(0)
    scene.frame_set(FIRST)
    ahead = np.array(camera.matrix_world)
    local = generator.uniform((-3, -1.5, -30), (3, 1.5, -12), (400, 3))
    points = local @ ahead[:3, :3].T + ahead[:3, 3]
    shown = np.ones(len(points), bool)
    for k in range(COUNT):
        scene.frame_set(FIRST + k)
        at = np.array([tuple(world_to_camera_view(scene, camera, Vector(p))) for p in points])
        shown &= (at[:, :2] > 0.02).all(axis=1) & (at[:, :2] < 0.98).all(axis=1) & (at[:, 2] > 0)
    assert shown.sum() >= 24
    return points[shown][:24]


def bent(x: float, y: float, lens: tuple[float, ...]) -> tuple[float, float]:
    """Normalized coordinates, y down, by OpenCV's lens."""
    k1, k2, p1, p2, k3 = lens[:5]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def solved_clip(scene, camera, first: Path, points: np.ndarray, lens: dict | None = None, numbers=(0.0,) * 8):  # type: ignore[no-untyped-def]
    """A clip whose tracks show points of the scene, solved by Blender itself.

    Args:
        lens: what the clip's lens is set to; numbers: of OpenCV, by which the tracks are bent.
    """
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    clip = bpy.data.movieclips.load(str(first))
    clip.frame_start = FIRST
    own = clip.tracking.camera
    own.sensor_width, own.units = camera.data.sensor_width, "MILLIMETERS"
    own.focal_length = camera.data.lens
    for name, value in (lens or {}).items():
        setattr(own, name, value)
    focal = camera.data.lens / camera.data.sensor_width
    aspect = SIZE[0] / SIZE[1]
    tracks = [clip.tracking.tracks.new(name=f"t{i}", frame=1) for i in range(len(points))]
    for k in range(COUNT):
        scene.frame_set(FIRST + k)
        for track, point in zip(tracks, points, strict=True):
            seen = world_to_camera_view(scene, camera, Vector(point))
            x, y = bent((seen.x - 0.5) / focal, (0.5 - seen.y) / focal / aspect, numbers)
            track.markers.insert_frame(1 + k, co=(0.5 + x * focal, 0.5 - y * focal * aspect))
    settings = clip.tracking.settings
    clip.tracking.objects[0].keyframe_a, clip.tracking.objects[0].keyframe_b = 1, COUNT
    settings.use_keyframe_selection = False
    window = bpy.context.window_manager.windows[0]
    area = window.screen.areas[0]
    area.type = "CLIP_EDITOR"
    area.spaces.active.clip = clip
    with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
        assert bpy.ops.clip.solve_camera() == {"FINISHED"}
    assert clip.tracking.objects[0].reconstruction.is_valid
    return clip


@pytest.mark.parametrize(
    "lens",
    [
        {"distortion_model": "POLYNOMIAL", "k1": -0.2, "k2": 0.05, "k3": 0.01},
        {"distortion_model": "BROWN", "brown_k1": -0.2, "brown_k2": 0.05, "brown_p1": 0.03, "brown_p2": -0.02},
    ],
    ids=["polynomial", "brown"],
)
def test_a_lens_bends_as_blenders_solver_has_it(addon, scene, tmp_path: Path, lens: dict) -> None:
    """Tracks that are bent by the numbers that a drive gets are what Blender takes for straight ones, and no others are."""
    opencv_of_clip = addon.module("formats.shot.lens").opencv_of_clip
    first = write_plates(tmp_path / "plates")
    set_range(scene)
    camera = moving_camera(scene)
    points = seen_points(scene, camera)
    every = {f"brown_{n}": 0.0 for n in ("k1", "k2", "k3", "k4", "p1", "p2")} | lens
    numbers = opencv_of_clip(lens["distortion_model"], every)
    clip = solved_clip(scene, camera, first, points, lens, numbers)
    right = clip.tracking.objects[0].reconstruction.average_error
    assert right < 1e-4
    behind(camera, first).source = "MOVIE_CLIP"
    camera.data.background_images[0].clip = clip
    drive = use_shot(tmp_path / "shot")
    np.testing.assert_allclose([drive.get(n, 0.0) for n in ("k1", "k2", "p1", "p2", "k3")], numbers[:5], atol=1e-6)
    for wrong in ([-1, 1, 1, 1, 1], [1, 1, -1, -1, 1], [1, 1, -1, 1, 1]):
        other = tuple(n * w for n, w in zip(numbers, [*wrong, 1, 1, 1], strict=True))
        if other != tuple(numbers):
            clip = solved_clip(scene, camera, first, points, lens, other)
            assert clip.tracking.objects[0].reconstruction.average_error > 0.01


def use_shot(folder: Path) -> dict:
    import bpy

    assert bpy.ops.unveil.use_shot(folder=str(folder), run_import=False) == {"FINISHED"}
    return json.loads((folder / "transforms.json").read_text())


def read_points(path: Path) -> np.ndarray:
    content = path.read_bytes()
    at = content.index(b"end_header\n") + len(b"end_header\n")
    return np.frombuffer(content[at:], "<f8").reshape(-1, 3)


@pytest.mark.parametrize("baked", [False, True], ids=["constraint", "keys"])
def test_reconstructed_tracks_are_points(scene, tmp_path: Path, baked: bool) -> None:
    """A camera that follows the solve, below an object that gives it scale and place; also once its way was made keys."""
    import bpy

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    true = moving_camera(scene)
    points = seen_points(scene, true)
    clip = solved_clip(scene, true, first, points)
    data = true.data.copy()
    camera = bpy.data.objects.new("solved", data)
    scene.collection.objects.link(camera)
    camera.location, camera.rotation_euler, camera.scale = (1, 2, 3), (0.1, 0.2, 0.3), (2.0,) * 3
    follow = camera.constraints.new("CAMERA_SOLVER")
    follow.use_active_clip, follow.clip = False, clip
    scene.camera = camera
    if baked:
        way = poses(camera)
        camera.constraints.remove(follow)
        for k in range(COUNT):
            from mathutils import Matrix

            scene.frame_set(FIRST + k)
            camera.matrix_world = Matrix(way[k].tolist())
            camera.scale = (2.0,) * 3
            for name in ("location", "rotation_euler"):
                camera.keyframe_insert(name, frame=FIRST + k)
    plate = data.background_images.new()
    plate.source, plate.clip = "MOVIE_CLIP", clip
    assert bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False) == {"FINISHED"}
    found = read_points(tmp_path / "shot/points.ply")
    drive = json.loads((tmp_path / "shot/transforms.json").read_text())
    assert found.shape == (24, 3)
    for frame, marker in zip(drive["frames"], range(1, COUNT + 1), strict=True):  # they are where the tracks are
        back = np.linalg.inv(np.array(frame["transform_matrix"]))
        seen = found @ back[:3, :3].T + back[:3, 3]
        x = frame["cx"] + frame["fl_x"] * seen[:, 0] / -seen[:, 2]
        y = frame["cy"] - frame["fl_y"] * seen[:, 1] / -seen[:, 2]
        tracked = np.array([tuple(t.markers.find_frame(marker).co) for t in clip.tracking.tracks]) * SIZE
        np.testing.assert_allclose(np.stack([x, SIZE[1] - y], axis=1), tracked, atol=0.3)


def test_a_camera_of_another_way_takes_no_tracks(scene, tmp_path: Path) -> None:
    import bpy

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    true = moving_camera(scene)
    clip = solved_clip(scene, true, first, seen_points(scene, true))
    camera = bpy.data.objects.new("other", true.data.copy())
    scene.collection.objects.link(camera)
    for k in range(COUNT):
        camera.location = (9.0 * k, 0, 1)
        camera.keyframe_insert("location", frame=FIRST + k)
    scene.camera = camera
    plate = camera.data.background_images.new()
    plate.source, plate.clip = "MOVIE_CLIP", clip
    assert bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False) == {"FINISHED"}
    assert not (tmp_path / "shot/points.ply").exists()


def test_a_movie_is_extracted(scene, tmp_path: Path) -> None:
    """Written by Blender without loss; a clip that starts at frame 1002 of the timeline."""
    import bpy

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    movie = tmp_path / "clip.mkv"
    encode(movie, first)
    camera = moving_camera(scene)
    clip = bpy.data.movieclips.load(str(movie))
    assert clip.source == "MOVIE"
    clip.frame_start = 1002
    plate = camera.data.background_images.new()
    plate.source, plate.clip = "MOVIE_CLIP", clip
    before = {s.name for s in bpy.data.scenes}
    assert bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False) == {"FINISHED"}
    drive = json.loads((tmp_path / "shot/transforms.json").read_text())
    assert [f["file_path"] for f in drive["frames"]] == [f"images/{FIRST + k}.png" for k in range(1, COUNT)]
    for k in range(1, COUNT):
        own, made = (
            levels(p)
            for p in (first.with_name(f"plate.{FIRST + k - 1}.png"), tmp_path / f"shot/images/{FIRST + k}.png")
        )
        assert (
            own.shape == made.shape and np.abs(own - made).max() <= 3
        )  # its colours are stored as brightness and two more
    assert {s.name for s in bpy.data.scenes} == before


@pytest.fixture
def movie(scene, tmp_path: Path) -> Path:
    """A movie behind the camera over the frame range."""
    import bpy

    first = write_plates(tmp_path / "plates")
    set_range(scene)
    movie = tmp_path / "clip.mkv"
    encode(movie, first)
    plate = moving_camera(scene).data.background_images.new()
    plate.source, plate.clip = "MOVIE_CLIP", bpy.data.movieclips.load(str(movie))
    plate.clip.frame_start = FIRST
    return movie


def test_pictures_of_a_movie_go_into_a_folder_of_their_own(scene, movie: Path, tmp_path: Path) -> None:
    """Through no link, and over nothing that somebody put or painted there."""
    import bpy

    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / f"{FIRST}.png").write_bytes(b"mine")
    (tmp_path / "shot").mkdir()
    images = tmp_path / "shot/images"
    images.symlink_to(mine)
    for replace in (False, True):
        with pytest.raises(RuntimeError, match="images: is a link"):
            bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False, replace=replace)
    assert [p.name for p in mine.iterdir()] == [f"{FIRST}.png"] and (mine / f"{FIRST}.png").read_bytes() == b"mine"
    images.unlink()
    mine.rename(images)
    with pytest.raises(RuntimeError, match=f"{FIRST}.png: Not written by Unveil"):
        bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False)
    assert (images / f"{FIRST}.png").read_bytes() == b"mine"
    assert bpy.ops.unveil.use_shot(folder=str(tmp_path / "shot"), run_import=False, replace=True) == {"FINISHED"}
    assert levels(images / f"{FIRST}.png").shape == (SIZE[1], SIZE[0], 3)
    (images / f"{FIRST}.png").write_bytes(b"painted")
    with pytest.raises(RuntimeError, match=f"{FIRST}.png: Changed since Unveil wrote it"):
        use_shot(tmp_path / "shot")


def test_pictures_are_made_anew_where_the_movie_is_another(scene, movie: Path, tmp_path: Path) -> None:
    """Also an older one."""
    import bpy

    use_shot(tmp_path / "shot")
    made = tmp_path / f"shot/images/{FIRST}.png"
    as_made = made.stat().st_mtime_ns
    use_shot(tmp_path / "shot")
    assert made.stat().st_mtime_ns == as_made
    encode(tmp_path / "other.mkv", write_plates(tmp_path / "others", count=COUNT * 2))
    os.utime(tmp_path / "other.mkv", (0, 0))
    scene.camera.data.background_images[0].clip = bpy.data.movieclips.load(str(tmp_path / "other.mkv"))
    scene.camera.data.background_images[0].clip.frame_start = FIRST
    use_shot(tmp_path / "shot")
    assert made.stat().st_mtime_ns != as_made


@pytest.mark.skipif(os.name == "nt", reason="no rights of POSIX")
def test_pictures_of_a_private_movie_are_private(scene, movie: Path, tmp_path: Path) -> None:
    movie.chmod(0o600)
    use_shot(tmp_path / "shot")
    assert {stat.S_IMODE(p.stat().st_mode) for p in (tmp_path / "shot/images").iterdir()} == {0o600}


def test_a_link_beside_a_blend_is_no_place(scene, movie: Path, tmp_path: Path) -> None:
    """Where nobody named the folder."""
    import bpy

    (tmp_path / "mine").mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    (tmp_path / "scene_shotcam_shot").symlink_to(tmp_path / "mine")
    with pytest.raises(RuntimeError, match="is a link"):
        bpy.ops.unveil.use_shot(run_import=False)
    assert not list((tmp_path / "mine").iterdir())


def levels(path: Path) -> np.ndarray:
    """(H, W, 3) of a picture, 0 to 255."""
    import bpy

    image = bpy.data.images.load(str(path), check_existing=False)
    found = np.empty(4 * image.size[0] * image.size[1], np.float32)
    image.pixels.foreach_get(found)
    size = tuple(image.size)
    bpy.data.images.remove(image)
    return found.reshape(size[1], size[0], 4)[..., :3] * 255


def encode(movie: Path, first: Path) -> None:
    """A movie of the plates, by Blender's sequencer."""
    import bpy

    scene = bpy.data.scenes.new("encode")
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strip = strips.new_image("plates", str(first), 1, 1)
    for k in range(1, COUNT):
        strip.elements.append(f"plate.{FIRST + k}.png")
    scene.frame_start, scene.frame_end = 1, COUNT
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *SIZE, 100
    render.fps = 30  # another rate than the shot's: each picture is a frame all the same
    render.filepath, render.use_sequencer, render.dither_intensity = str(movie), True, 0.0
    settings = render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "VIDEO"
    settings.file_format = "FFMPEG"
    render.ffmpeg.format, render.ffmpeg.codec = {".mkv": "MKV", ".mp4": "MPEG4"}[movie.suffix], "H264"
    render.ffmpeg.constant_rate_factor = "LOSSLESS"
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    bpy.ops.render.render(animation=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
    assert movie.is_file()

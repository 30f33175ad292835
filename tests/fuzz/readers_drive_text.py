"""Readers of the text files of drives, each with small sound files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from tests.drives.formats.shot.shots import chan, plates
from tests.drives.formats.shot.test_photogrammetry import HEADING, metashape
from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.tiny_drive import edit, make_tiny_drive
from tests.fuzz.reader import Opened, Reader, Wrong
from tests.fuzz.sound import sound_camera, sound_drive, sound_frame
from unveil_core.drives.camera_path import read_camera_path
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.formats import kitti_raw, pandaset
from unveil_core.drives.formats.cameras import read_numbers
from unveil_core.drives.formats.colmap.reader import read_colmap
from unveil_core.drives.formats.kitti import boxes as kitti_boxes
from unveil_core.drives.formats.kitti.boxes import read_boxes_360, read_tracklets
from unveil_core.drives.formats.kitti.text import read_calibration, read_stamps, usable_pose
from unveil_core.drives.formats.nuscenes import tables as nuscenes
from unveil_core.drives.formats.processed import drivestudio, street_gaussians
from unveil_core.drives.formats.processed.shared import Matrices
from unveil_core.drives.formats.shot.reader import read_shot
from unveil_core.drives.formats.transforms_json import read_transforms_json
from unveil_core.drives.marked import read_marked
from unveil_core.drives.points import write_points

__all__ = ["READERS"]

POINTS = PointCloud(np.array([[4.0, 0, 1], [5, 1, 0], [6, -1, 0.5], [9, 2, 1]]), np.full((4, 3), 90, np.uint8))
BOX = {"id": 3, "class": "car", "centre": [5.0, 1.0, 0.5], "size": [4.0, 2.0, 1.5], "yaw": 0.2}


def _tiny(folder: Path) -> Path:
    """A nerfstudio drive of two frames and four points."""
    path = make_tiny_drive(folder)
    edit(path, lambda d: d.update(frames=d["frames"][:2]))
    write_points(POINTS, folder / "points.ply")
    return path


def _transforms(folder: Path) -> Opened:
    path = _tiny(folder)
    document = json.loads(path.read_text())
    first = {**document["frames"][0], "boxes": [BOX], "camera": "front", "camera_model": "OPENCV_FISHEYE", "k1": 0.01}
    lens = {"k1": 0.1, "k2": 0.01, "p1": 0.0, "p2": 0.001, "k3": 0.0, "camera_model": "OPENCV"}
    applied = {"applied_transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "applied_scale": 0.5}
    more = {**document, **lens, **applied, "up": [0, 0, 1], "metric": None, "fisheye_crop_radius": 15}
    more |= {"frames": [first, {**document["frames"][1], "time": 1}], "depth_unit_scale_factor": 0.001}
    angle = {k: v for k, v in document.items() if k not in ("w", "h", "fl_x", "fl_y")} | {"camera_angle_x": 1.1}
    files = [path, folder / "more.json", folder / "angle.json"]
    for file, content in zip(files[1:], (more, angle), strict=True):
        file.write_text(json.dumps(content))
    return Opened(tuple(files), lambda p: sound_drive(read_transforms_json(p)))


def _colmap(folder: Path) -> Opened:
    model = folder / "sparse/0"
    (folder / "images/a").mkdir(parents=True)
    for name in ("a/0.jpg", "1.jpg"):  # a model without pictures is refused
        (folder / "images" / name).write_bytes(b"\xff\xd8\xff")
    model.mkdir(parents=True)
    lines = {
        "cameras": ["# Cameras", "1 PINHOLE 48 32 40 40 24 16", "2 OPENCV 48 32 40 40 24 16 0.1 0 0 0"],
        "images": ["1 1 0 0 0 0.1 0.2 0.3 1 a/0.jpg", "1.5 2.5 7", "2 0.9 0.1 0 0 1 2 3 2 1.jpg", ""],
        "points3D": [f"{i} {i}.5 1 2 9 8 7 0.5 1 0 2 1 1 3" for i in range(1, 5)],
    }
    for name, text in lines.items():
        (model / f"{name}.txt").write_text("\n".join(text) + "\n")
    return Opened(tuple(model / f"{n}.txt" for n in lines), lambda p: sound_drive(read_colmap(folder)))


def _shot(folder: Path) -> Opened:
    """A .chan with all that may lie beside it, and the same pictures with Metashape's and RealityScan's cameras."""
    plates(folder / "chan/plates", count=3)
    path = chan(folder / "chan/cam.chan", count=3)
    said = {
        "fps": 24,
        "zoom": "vertical_fov",
        "sensor_mm": [24, 13],
        "lens": {"k1": 0.1},
        "points": "points.csv",
        "up": "y",
    }
    beside = folder / "chan/shot.json"
    beside.write_text(
        json.dumps({**said, "plates": "plates/plate.####.png", "frame_offset": 0, "units_per_metre": 100})
    )
    points = folder / "chan/points.csv"
    points.write_text("name,x,y,z\na,1,2,3\nb,4,5,6\n")
    plates(folder / "xml/images", count=3)
    plates(folder / "csv/images", count=3)
    xml, table = metashape(folder / "xml/cameras.xml"), folder / "csv/cameras.csv"
    table.write_text(f"{HEADING}\nplate.1001.png,1,2,3,90,80,0,24,0.1,0,-0.1,0.02,0,0,0.001,0\n")
    return Opened((path, beside, points, xml, table), lambda p: sound_drive(read_shot(p.parent)))


def _marked(folder: Path) -> Opened:
    (folder / "mattes").mkdir(parents=True)
    (folder / "mattes/0.png").write_bytes(b"\x89PNG")
    path = folder / "marked.json"
    path.write_text(json.dumps([BOX, {"id": 4, "class": "dog", "mattes": "mattes"}]))
    return Opened((path,), read_marked)


def _camera_path(folder: Path) -> Opened:
    path = _tiny(folder)
    drive = read_transforms_json(path)
    pose = json.loads(path.read_text())["frames"][0]["transform_matrix"]
    viewer = {
        "camera_type": "perspective", "render_height": 24, "render_width": 32, "default_fov": 60,
        "camera_path": [
            {"camera_to_world": [v for row in pose for v in row], "fov": 50, "aspect": 1.0, "name": "a"},
            {"camera_to_world": pose},
        ],
    }  # fmt: skip
    own = {
        "to_world": drive.to_world.to_json(),
        "frames": [
            {
                "name": "0", "camera": "front", "width": 32, "height": 24, "fx": 20.0, "fy": 20.0, "cx": 16.0, "cy": 12.0,
                "world_to_camera": drive.frames[0].camera.world_to_camera.tolist(),
            }
        ],
    }  # fmt: skip
    files = [path, folder / "viewer.json", folder / "own.json"]
    for file, content in zip(files[1:], (viewer, own), strict=True):
        file.write_text(json.dumps(content))

    def read(file: Path) -> None:
        views = read_camera_path(file, drive)
        for view in views:
            sound_camera(view.camera)
        if len({(v.track, v.name) for v in views}) < len(views):
            raise Wrong("two views of one name are taken")

    return Opened(tuple(files), read)


def _kitti_text(folder: Path) -> Opened:
    day = WRITERS["KITTI raw"](folder, tiny_street(2))
    drive = day / "2011_09_26_drive_0001_sync"
    poses = folder / "poses.txt"
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n0 0 1 3 0 1 0 1 -1 0 0 2\n")
    cameras, scanner, stamps = (
        day / "calib_cam_to_cam.txt",
        day / "calib_velo_to_cam.txt",
        drive / "oxts/timestamps.txt",
    )
    packets = sorted((drive / "oxts/data").iterdir())

    def read(file: Path) -> None:
        if file == cameras:
            read_calibration(file, {"R_rect_00": 9, "P_rect_02": 12}, "download it again")
        elif file == scanner:
            kitti_raw._rigid(file)
        elif file == stamps:
            read_stamps(file)
        elif file == poses:
            [usable_pose(line, file) for line in read_numbers(file, "download it again")]
        elif not all(np.isfinite(pose).all() for pose in kitti_raw._vehicle_poses(file.parent)[0].values()):
            raise Wrong("a pose that is not finite is taken")

    return Opened((cameras, scanner, stamps, poses, *packets), read)


def _tracklets(folder: Path) -> Opened:
    day = WRITERS["KITTI raw"](folder, tiny_street(2))
    path = day / "2011_09_26_drive_0001_sync/tracklet_labels.xml"
    return Opened((path,), read_tracklets)


def _boxes_360(folder: Path) -> Opened:
    WRITERS["KITTI-360"](folder, tiny_street(2))
    path = next(p for p in folder.rglob("*.xml"))

    def read(file: Path) -> object:
        kitti_boxes._boxes_360.cache_clear()
        return read_boxes_360(file)

    return Opened((path,), read)


def _nuscenes(folder: Path) -> Opened:
    root = WRITERS["nuScenes"](folder, tiny_street(2))
    tables = next(p.parent for p in root.rglob("sample_data.json"))

    def read(file: Path) -> object:
        nuscenes._read_scene.cache_clear()
        nuscenes.scene_names(tables)
        return nuscenes.read_scene(tables, "scene-0061")

    return Opened(tuple(sorted(tables.glob("*.json"))), read)


def _pandaset(folder: Path) -> Opened:
    root = WRITERS["PandaSet"](folder, tiny_street(2)) / "002"
    camera = root / "camera/front_camera"

    def read(file: Path) -> None:
        if file.parent == camera:
            for frame in pandaset._camera_frames(camera, {}):
                sound_frame(frame)
        else:
            pandaset._stamps(file)

    return Opened((*sorted(camera.glob("*.json")), root / "lidar/timestamps.json"), read)


def _processed(folder: Path) -> Opened:
    """Matrices, boxes and time stamps of DriveStudio and of Street Gaussians."""
    one = WRITERS["DriveStudio"](folder / "drivestudio", tiny_street(2))
    other = WRITERS["Street Gaussians"](folder / "gaussians", tiny_street(2))
    pose, instances = next(one.rglob("ego_pose/*.txt")), next(one.rglob("instances_info.json"))
    tracks, stamps = next(other.rglob("track/*.txt")), next(other.rglob("timestamps.json"))
    scenes = [p.parents[1] for p in (pose, instances)]

    def read(file: Path) -> None:
        if file == pose:
            Matrices(scenes[0]).matrix(f"ego_pose/{file.name}")
        elif file == instances:
            drivestudio._boxes(file, drivestudio._Poses(scenes[1]))
        elif file == tracks:
            street_gaussians._boxes(file, Matrices(file.parents[1]))
        else:
            street_gaussians._stamps(file)

    return Opened((pose, instances, tracks, stamps), read)


READERS = (
    Reader("transforms.json", "text", _transforms),
    Reader("COLMAP text", "text", _colmap),
    Reader("shots", "text", _shot),
    Reader("marked objects", "text", _marked),
    Reader("camera path", "text", _camera_path),
    Reader("KITTI text", "text", _kitti_text),
    Reader("KITTI tracklets", "text", _tracklets),
    Reader("KITTI-360 boxes", "text", _boxes_360),
    Reader("nuScenes tables", "text", _nuscenes),
    Reader("PandaSet JSON", "text", _pandaset),
    Reader("DriveStudio and Street Gaussians text", "text", _processed),
)

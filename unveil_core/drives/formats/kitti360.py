"""KITTI-360, as released: one folder a kind of data, and in it one a sequence.

    calibration/calib_cam_to_pose.txt  calib_cam_to_velo.txt  perspective.txt
    data_2d_raw/2013_05_28_drive_0000_sync/image_00/data_rect/0000000000.png …  timestamps.txt       and image_01
    data_2d_semantics/train/<sequence>/image_00/semantic/0000000000.png …  instance/…
    data_3d_raw/<sequence>/velodyne_points/data/0000000000.bin …  timestamps.txt
    data_3d_bboxes/train/<sequence>.xml
    data_poses/<sequence>/poses.txt

The number of a file is that of the frame. Frames in which the vehicle hardly moves have no pose. Poses are world from IMU, whose
x is ahead, y to the right and z down; the world is z up, in metres, and one for all sequences. Sweeps are measured while the
vehicle moves, see :func:`unveil_core.drives.formats.kitti.sweeps.untwisted`. The fisheye cameras image_02 and image_03 are left
out. Facts: autonomousvision/kitti360Scripts (``helpers/``, ``devkits/``); the documentation at cvlibs.net.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_instance_image, read_label_image
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox, boxes_at
from unveil_core.drives.cityscapes import LABEL_IDS, table
from unveil_core.drives.drive import Drive, Frame, FrameLabels, PointCloud, Sweep
from unveil_core.drives.formats.cameras import read_numbers, rigid
from unveil_core.drives.formats.kitti.boxes import CLASSES_360, Boxes360, read_boxes_360
from unveil_core.drives.formats.kitti.sweeps import motions, sweep_reader, untwisted
from unveil_core.drives.formats.kitti.text import (
    absolute,
    at,
    left_out,
    numbered,
    pictures,
    read_calibration,
    read_size,
    read_stamps,
    rectified_lens,
    usable_pose,
)
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["is_one", "read_kitti360", "recognizes", "scenes"]

CAMERAS = ("image_00", "image_01")
"""The rectified cameras; the first that a sequence has is read unless others are asked for."""
FISHEYES = ("image_02", "image_03")
EGO_ID = 1
"""The label of the ego vehicle."""
OF_LABEL = table(
    LABEL_IDS
    | {number: name for number, name in CLASSES_360.values()}
    | {
        9: "road",
        14: "fence",
        15: "building",
        16: "building",
        18: "pole",
        34: "building",
        35: "fence",
        37: "pole",
        38: "pole",
    }
)
"""TrainIds of the labels of pictures. Beside those of Cityscapes: caravans, trailers and unknown vehicles as for boxes; parking 9,
guard rail 14, bridge 15, tunnel 16, polegroup 18, garage 34, gate 35, small pole 37, lamp 38."""
OBJECT_IDS = np.array([number for number, _ in CLASSES_360.values()])
"""Labels of the classes whose instances are told apart here."""
BOX_REACH_M = 120.0
"""Static boxes this near to the vehicle are given to a frame; a sequence has thousands. So far do cars have some twenty pixels."""
MEND_CALIBRATION = "download calibration.zip and unpack it into the data set's folder"
MEND_POSES = "download data_poses.zip and unpack it into the data set's folder"


def is_one(folder: Path) -> bool:
    """Whether a folder is a sequence itself."""
    return any((folder / c / "data_rect").is_dir() for c in CAMERAS)


def _raw_folder(path: Path) -> Path:
    """The folder data_2d_raw of a path to it, to the data set or to one sequence."""
    if (path / "data_2d_raw").is_dir():
        return path / "data_2d_raw"
    return absolute(path).parent if is_one(path) else path


def recognizes(path: Path) -> bool:
    """Whether a folder is the data set, its data_2d_raw, or a sequence therein."""
    return path.is_dir() and bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the sequences that a folder holds; "." where it is one."""
    if is_one(path):
        return ["."]
    folder = _raw_folder(path)
    return [p.name for p in sorted(folder.iterdir()) if p.is_dir() and is_one(p)] if folder.is_dir() else []


def read_kitti360(path: Path, scene: str = ".") -> Drive:
    """Read a sequence.

    Args:
        path: folder of the data set, its data_2d_raw, or the folder of a sequence therein; scene: which sequence, "." = that.
    Raises:
        DriveError: with the file and the mend.
    """
    folder = absolute(_raw_folder(path))
    images = absolute(path) if scene == "." else folder / scene
    root, name = folder.parent, images.name
    camera_names = [c for c in CAMERAS if pictures(images / c / "data_rect")]
    if not camera_names:
        raise DriveError("has no rectified photographs", path=images, mend="download data_2d_raw, too")
    calibration = root / "calibration"
    perspective, to_pose = calibration / "perspective.txt", calibration / "calib_cam_to_pose.txt"
    counts = {f"{kind}_rect_{c[-2:]}": n for c in camera_names for kind, n in (("P", 12), ("R", 9))}
    rectified = read_calibration(perspective, counts, MEND_CALIBRATION)
    in_imu = read_calibration(to_pose, dict.fromkeys({*camera_names, "image_00"}, 12), MEND_CALIBRATION)
    pose_file = root / "data_poses" / name / "poses.txt"
    poses, unusable = _poses(pose_file)
    notices = left_out("poses", unusable, unusable + len(poses), "have NaN or no rotation: their frames are left out")
    bounding = next((p for p in sorted(root.glob(f"data_3d_bboxes/*/{name}.xml"))), None)
    boxes = {} if bounding is None else _boxes_of_frames(read_boxes_360(bounding), poses)
    frames: list[Frame] = []
    label_files: list[Path] = []
    for camera_name in camera_names:
        found, stamps = (
            pictures(images / camera_name / "data_rect"),
            read_stamps(images / camera_name / "timestamps.txt"),
        )
        calibrated = read_size(perspective, f"S_rect_{camera_name[-2:]}")
        first = next(iter(found.values()))
        lens = rectified_lens(rectified[f"P_rect_{camera_name[-2:]}"], first, perspective, calibrated)
        turn = rectified[f"R_rect_{camera_name[-2:]}"].reshape(3, 3)
        rectify = rigid(np.column_stack([turn, np.zeros(3)]), perspective, "R_rect")
        imu_from_camera = rigid(in_imu[camera_name], to_pose, camera_name) @ rigid_inverse(rectify)
        semantic, instance = (_label_files(root, name, camera_name, kind) for kind in ("semantic", "instance"))
        for n, image in found.items():
            if n in poses:
                labels = partial(_labels, semantic[n], instance.get(n)) if n in semantic else None
                label_files += [p for p in (semantic.get(n), instance.get(n)) if p is not None]
                camera = lens.camera(poses[n] @ imu_from_camera)
                frames.append(
                    Frame(
                        image.stem,
                        camera_name,
                        camera,
                        image,
                        timestamp=at(stamps, n),
                        boxes=boxes.get(n, ()),
                        labels=labels,
                    )
                )
        without = sum(n not in poses for n in found)
        notices += left_out(camera_name, without, len(found), "photographs have no pose and are left out")
    if not frames:
        raise DriveError("has no photograph with a pose", path=pose_file, mend=MEND_POSES)
    notices += [f"{c}: the fisheye camera is left out" for c in FISHEYES if (images / c).is_dir()]
    labelled = [f for f in frames if f.labels is not None]
    if labelled and len(labelled) < len(frames):
        notices.append(f"semantics: {len(labelled)} of {len(frames)} photographs are labelled")
    velodyne = root / "data_3d_raw" / name / "velodyne_points"
    to_velo = calibration / "calib_cam_to_velo.txt"
    sweeps: list[Sweep] = []
    if velodyne.is_dir():
        imu_from_velo = rigid(in_imu["image_00"], to_pose, "image_00") @ rigid_inverse(_bare(to_velo))
        sweeps = _sweeps(velodyne, {n: pose @ imu_from_velo for n, pose in poses.items()}, boxes)
    notices += left_out("velodyne_points", len(poses) - len(sweeps), len(poses), "sweeps are missing")
    there = len(numbered(velodyne / "data", (".bin",)))
    notices += left_out("velodyne_points", there - len(sweeps), there, "sweeps have no pose and are left out")
    stamp_files = (*(images / c / "timestamps.txt" for c in camera_names), velodyne / "timestamps.txt")
    return Drive(
        root=images,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        semantic_classes="cityscapes" if labelled else None,
        sources=tuple(
            p
            for p in (perspective, to_pose, to_velo, pose_file, *stamp_files, bounding, *label_files)
            if p is not None and p.is_file()
        ),
        front_cameras=(camera_names[0],),
        notices=tuple(notices),
        key_frames=frozenset(f.name for f in labelled) if 0 < len(labelled) < len(frames) else None,
    )


def _bare(path: Path) -> Float64:
    """(4, 4) of a file of 12 numbers."""
    return rigid([v for line in read_numbers(path, MEND_CALIBRATION) for v in line], path, "velo from camera 0")


def _poses(path: Path) -> tuple[dict[int, Float64], int]:
    """Poses (4, 4) of the IMU by frame number, and how many lines hold none."""
    if not path.is_file():
        raise DriveError("Not found: poses of this sequence", path=path, mend=MEND_POSES)
    poses: dict[int, Float64] = {}
    lines = read_numbers(path, MEND_POSES)
    for line in lines:
        if len(line) != 13 or not 0 <= line[0] < 1e9 or line[0] != int(line[0]):
            raise DriveError("Not a frame number and 12 numbers: a line in it", path=path, mend=MEND_POSES)
        pose = usable_pose(line[1:], path)
        if pose is not None:
            poses[int(line[0])] = pose
    if not poses:
        raise DriveError("holds no pose", path=path, mend=MEND_POSES)
    return dict(sorted(poses.items())), len(lines) - len(poses)


def _label_files(root: Path, name: str, camera_name: str, kind: str) -> dict[int, Path]:
    """Label pictures by frame number, of the training data or whatever other part has them."""
    folders: Iterable[Path] = sorted(root.glob(f"data_2d_semantics/*/{name}/{camera_name}/{kind}"))
    found: dict[int, Path] = {}
    for folder in folders:
        found = numbered(folder, (".png",)) | found
    return found


def _labels(semantic: Path, instance: Path | None) -> FrameLabels:
    """An instance picture holds class id * 1000 + number, and these are the ids; the number 0 is none."""
    labels = read_label_image(semantic)
    ids = None
    if instance is not None:
        ids = read_instance_image(instance)
        if ids.shape != labels.shape:
            raise DriveError("has another size than the picture of classes", path=instance, mend="download both again")
        ids = np.where((ids % 1000 > 0) & np.isin(ids // 1000, OBJECT_IDS), ids, 0).astype(np.uint16)
    ego = labels == EGO_ID
    return FrameLabels(OF_LABEL[labels], ids, ego if ego.any() else None)


def _boxes_of_frames(found: Boxes360, poses: Mapping[int, Float64]) -> dict[int, tuple[TrackedBox, ...]]:
    """Boxes by frame number: static ones that are near, and dynamic ones while they are annotated."""
    fixed, dynamic = found
    still = list(fixed.values())
    centres = np.array([b.centre for b in still]).reshape(-1, 3)
    frames: dict[int, dict[int, TrackedBox]] = {}
    for n, pose in poses.items():
        near = np.flatnonzero(np.linalg.norm(centres - pose[:3, 3], axis=1) < BOX_REACH_M)
        frames[n] = {still[k].id: still[k] for k in near}
    numbers = list(poses)
    for way in dynamic.values():
        stamps, boxes = list(way), [(b,) for b in way.values()]
        for n in numbers[bisect.bisect_left(numbers, stamps[0]) : bisect.bisect_right(numbers, stamps[-1])]:
            frames[n] |= {b.id: b for b in boxes_at(n, stamps, boxes)}
    return {n: tuple(some.values()) for n, some in frames.items()}


def _sweeps(folder: Path, poses: dict[int, Float64], boxes: Mapping[int, tuple[TrackedBox, ...]]) -> list[Sweep]:
    stamps, numbers = read_stamps(folder / "timestamps.txt"), sorted(poses)
    sweeps = []
    for n, path in numbered(folder / "data", (".bin",)).items():
        if n in poses:
            before, after = motions(n, poses, numbers, stamps)
            read = sweep_reader(path, poses[n], correct=partial(untwisted, before=before, after=after))
            sweeps.append(Sweep(path, read, at(stamps, n), boxes.get(n, ())))
    return sweeps

"""The street as the three KITTI datasets have it."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from tests.drives.formats.kitti.files import numbers, write_sweep, write_text
from tests.drives.formats.street.street import Array, Street, rigid, saved, transformed, turned_about_z
from unveil_core.drives.boxes import TrackedBox

__all__ = ["write_kitti360", "write_kitti_odometry", "write_kitti_raw"]

AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Camera from what looks ahead along x."""
CAM0_FROM_VELO = rigid(AXES, (0.06, -0.08, -0.27))
VELO_FROM_IMU = rigid(np.eye(3), (-0.81, 0.32, -0.8))
LATITUDE, LONGITUDE, RADIUS_M = 49.011, 8.416, 6378137.0
TURN_S = 0.1
SEQUENCE = "2013_05_28_drive_0000_sync"
TRACKLET_NAMES = {"car": "Car", "truck": "Truck", "person": "Pedestrian", "rider": "Cyclist", "train": "Tram"}
SEMANTIC_KITTI = {
    0: 40,
    1: 48,
    2: 50,
    4: 51,
    5: 80,
    7: 81,
    8: 70,
    9: 72,
    11: 30,
    12: 31,
    13: 10,
    14: 18,
    17: 15,
    18: 11,
}
LABEL_360 = dict(enumerate([7, 8, 11, 12, 13, 17, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 31, 32, 33]))
BOX_360 = {"car": (13, 26), "truck": (14, 27), "person": (19, 24), "rider": (20, 25), "bicycle": (18, 33)}
"""Number of a box, and the id of the pictures for its class."""


def _stamps(street: Street, day: str, shift: float = 0.0) -> str:
    return "\n".join(f"{day} 13:02:{25 + t + shift:012.9f}" for t in street.times)


def _projection(street: Street, shift: float = 0.0) -> Array:
    return np.column_stack([street.calibration(), (shift * street.focal, 0.0, 0.0)])


def _twisted(points: Array, poses: list[Array], times: Array, i: int) -> Array:
    """World points as a scanner measures them that moves while it turns clockwise, ahead at frame i."""

    def motion(j: int) -> tuple[Array, Array]:
        step = np.linalg.inv(poses[i]) @ poses[j]
        seconds = times[j] - times[i]
        return cv2.Rodrigues(step[:3, :3])[0].ravel() / seconds, step[:3, 3] / seconds

    last = len(poses) - 1
    before, after = motion(i - 1 if i else 1), motion(i + 1 if i < last else last - 1)
    still = transformed(np.linalg.inv(poses[i]), points)
    seen = still
    for _ in range(5):
        when = -np.arctan2(seen[:, 1], seen[:, 0]) / (2 * math.pi) * TURN_S
        turn = np.where(when[:, None] < 0, before[0], after[0]) * when[:, None]
        shift = np.where(when[:, None] < 0, before[1], after[1]) * when[:, None]
        seen = Rotation.from_rotvec(turn).inv().apply(still - shift)
    return seen


def write_kitti_raw(root: Path, street: Street) -> Path:
    """A synchronized drive in the folder of its day; returns the folder of the day."""
    day = root / "2011_09_26"
    drive = day / "2011_09_26_drive_0001_sync"
    text = "calib_time: 09-Jan-2012 13:57:47\n"
    for k in ("00", "02"):
        text += f"S_rect_{k}: {street.size[0]} {street.size[1]}\nR_rect_{k}: {numbers(np.eye(3))}\n"
        text += f"P_rect_{k}: {numbers(_projection(street, 0.06 if k == '02' else 0.0))}\n"
    write_text(day / "calib_cam_to_cam.txt", text)
    for name, pose in (("velo_to_cam", CAM0_FROM_VELO), ("imu_to_velo", VELO_FROM_IMU)):
        write_text(day / f"calib_{name}.txt", f"R: {numbers(pose[:3, :3])}\nT: {numbers(pose[:3, 3])}\n")
    velo_from_camera = np.linalg.inv(rigid(np.eye(3), (0.06, 0, 0)) @ CAM0_FROM_VELO)
    scanners = [p @ np.linalg.inv(velo_from_camera) for p in street.poses]
    imus = [p @ VELO_FROM_IMU for p in scanners]
    scale = math.cos(math.radians(LATITUDE))
    middle = math.log(math.tan(math.pi / 4 + math.radians(LATITUDE) / 2))
    for i, pose in enumerate(imus):
        east, north, up = pose[:3, 3] - imus[0][:3, 3]
        latitude = math.degrees(2 * math.atan(math.exp(middle + north / (scale * RADIUS_M))) - math.pi / 2)
        longitude = LONGITUDE + math.degrees(east / (scale * RADIUS_M))
        roll, pitch, yaw = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        packet = [latitude, longitude, 112.8 + up, roll, pitch, yaw, *[0.0] * 19, 4, 11, 4, 4, 0]
        write_text(drive / f"oxts/data/{i:010d}.txt", " ".join(f"{v:.17g}" for v in packet))
        saved(drive / f"image_02/data/{i:010d}.png", street.images[i])
        points = _twisted(street.sweep(i)[0], scanners, street.times, i)
        write_sweep(drive / f"velodyne_points/data/{i:010d}.bin", points)
    for folder in ("image_02", "oxts", "velodyne_points"):
        write_text(drive / folder / "timestamps.txt", _stamps(street, "2011-09-26"))
    for ending, shift in (("start", -TURN_S / 2), ("end", TURN_S / 2)):
        write_text(drive / f"velodyne_points/timestamps_{ending}.txt", _stamps(street, "2011-09-26", shift))
    write_text(drive / "tracklet_labels.xml", _tracklets(street, scanners))
    return day


def _tracklets(street: Street, scanners: list[Array]) -> str:
    items = ""
    for k, box in enumerate(street.boxes):
        length, width, height = box.size
        items += f"<item><objectType>{TRACKLET_NAMES[box.class_name]}</objectType><h>{height}</h><w>{width}</w>"
        items += f"<l>{length}</l><first_frame>0</first_frame><poses><count>{street.count}</count>"
        for pose in scanners:
            own = street.local_boxes(pose)[k][1]
            x, y, z = own[:3, 3]
            yaw = math.atan2(own[1, 0], own[0, 0])
            items += f"<item><tx>{x}</tx><ty>{y}</ty><tz>{z - height / 2}</tz><rx>0</rx><ry>0</ry><rz>{yaw}</rz>"
            items += "<state>2</state></item>"
        items += "</poses><finished>1</finished></item>"
    head = f"<count>{len(street.boxes)}</count><item_version>1</item_version>"
    return f"<?xml version='1.0'?><boost_serialization><tracklets>{head}{items}</tracklets></boost_serialization>"


def write_kitti_odometry(root: Path, street: Street) -> Path:
    """Sequence 00 with the labels of SemanticKITTI; it has no boxes."""
    folder = root / "dataset/sequences/00"
    text = "".join(f"P{k}: {numbers(_projection(street))}\n" for k in range(4))
    write_text(folder / "calib.txt", text + f"Tr: {numbers(CAM0_FROM_VELO[:3])}\n")
    write_text(folder / "times.txt", "\n".join(f"{t:e}" for t in street.times))
    first = np.linalg.inv(street.poses[0])
    write_text(root / "dataset/poses/00.txt", "\n".join(numbers((first @ p)[:3]) for p in street.poses))
    (folder / "labels").mkdir()
    for i in range(street.count):
        saved(folder / f"image_2/{i:06d}.png", street.images[i])
        points, kinds = street.sweep(i)
        velo = np.linalg.inv(street.poses[i] @ CAM0_FROM_VELO)
        write_sweep(folder / f"velodyne/{i:06d}.bin", transformed(velo, points))
        labels = np.array([SEMANTIC_KITTI.get(int(k), 0) for k in kinds], "<u4")
        labels.tofile(folder / f"labels/{i:06d}.label")
    return root


def write_kitti360(root: Path, street: Street) -> Path:
    """A sequence with labelled pictures and static boxes; the IMU has x ahead, y to the right, z down."""
    images, down = root / "data_2d_raw" / SEQUENCE, np.diag([1.0, -1.0, -1.0])
    imu_from_camera = rigid(down, (0, 0, 0)) @ street.vehicle_from_camera
    velo_from_camera = rigid(AXES.T, (0.8, 0.3, -0.18))
    calibration = root / "calibration"
    text = f"S_rect_00: {street.size[0]} {street.size[1]}\nR_rect_00: {numbers(np.eye(3))}\n"
    write_text(calibration / "perspective.txt", text + f"P_rect_00: {numbers(_projection(street))}\n")
    write_text(calibration / "calib_cam_to_pose.txt", f"image_00: {numbers(imu_from_camera[:3])}\n")
    write_text(calibration / "calib_cam_to_velo.txt", numbers(velo_from_camera[:3]))
    imus = [p @ np.linalg.inv(imu_from_camera) for p in street.poses]
    lines = "\n".join(f"{i} {numbers(p[:3])}" for i, p in enumerate(imus))
    write_text(root / "data_poses" / SEQUENCE / "poses.txt", lines)
    scanners = [p @ np.linalg.inv(velo_from_camera) for p in street.poses]
    velodyne = root / "data_3d_raw" / SEQUENCE / "velodyne_points"
    labelled = root / "data_2d_semantics/train" / SEQUENCE / "image_00"
    ids = {b.id: BOX_360[b.class_name][1] * 1000 + b.id for b in street.boxes}
    of_class = np.array([LABEL_360.get(k, 0) for k in range(256)])
    for i in range(street.count):
        saved(images / f"image_00/data_rect/{i:010d}.png", street.images[i])
        semantic = of_class[street.semantics[i]]
        objects = np.vectorize(lambda k: ids.get(int(k), 0))(street.instances[i])
        saved(labelled / f"semantic/{i:010d}.png", semantic.astype(np.uint8))
        saved(labelled / f"instance/{i:010d}.png", np.where(objects > 0, objects, semantic * 1000).astype(np.uint16))
        points = _twisted(street.sweep(i)[0], scanners, street.times, i)
        write_sweep(velodyne / f"data/{i:010d}.bin", points)
    for folder in (images / "image_00", velodyne):
        write_text(folder / "timestamps.txt", _stamps(street, "2013-05-28"))
    write_text(root / "data_3d_bboxes/train" / f"{SEQUENCE}.xml", _boxes_360(street.boxes))
    return root


def _boxes_360(boxes: tuple[TrackedBox, ...]) -> str:
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    items = ""
    for k, box in enumerate(boxes):
        transform = rigid(turned_about_z(box.yaw) @ np.diag(box.size), box.centre)
        number = BOX_360[box.class_name][0]
        items += f"<object{k}><transform><rows>4</rows><cols>4</cols><data>{numbers(transform)}</data></transform>"
        items += f"<vertices><rows>8</rows><cols>3</cols><data>{numbers(corners)}</data></vertices>"
        items += f"<semanticId>{number}</semanticId><instanceId>{box.id}</instanceId><timestamp>-1</timestamp>"
        items += f"</object{k}>"
    return f"<?xml version='1.0'?><opencv_storage>{items}</opencv_storage>"

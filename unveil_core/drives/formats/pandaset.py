"""PandaSet (Hesai and Scale AI), as released: one folder a sequence.

    camera/<name>/00.jpg … intrinsics.json poses.json timestamps.json
    lidar/00.pkl.gz …      poses.json timestamps.json
    annotations/cuboids/00.pkl.gz …    annotations/semseg/00.pkl.gz … (some sequences)

Poses are world from sensor, quaternions wxyz; cameras have OpenCV axes; points and cuboids are in the world, z up, metres. A
cuboid's x is its width, y its length, and its yaw turns the length from y. Facts: scaleapi/pandaset-devkit (README,
``geometry.py``, ``annotations.py``); checked against sequence 002.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.checks.sizes import calibration_size
from unveil_core.drives.cityscapes import table
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, picture_size, pose_of, scenes_of
from unveil_core.drives.formats.on_disk.unread import other_pictures
from unveil_core.drives.formats.pandas_tables import read_table

__all__ = ["is_one", "read_pandaset", "recognizes", "scenes"]

FRONT = "front_camera"
EGO_ROWS = {"back_camera": 250}
"""Lowest rows that show the ego vehicle, of 1080, by camera; as NeuRAD's reader crops them."""
BOX_CLASSES: dict[str, str] = {
    "Car": "car",
    "Pickup Truck": "car",
    "Emergency Vehicle": "car",
    "Other Vehicle - Uncommon": "car",
    "Other Vehicle - Construction Vehicle": "truck",
    "Medium-sized Truck": "truck",
    "Semi-truck": "truck",
    "Towed Object": "truck",
    "Bus": "bus",
    "Train": "train",
    "Trolley": "train",
    "Tram / Subway": "train",
    "Motorcycle": "motorcycle",
    "Motorized Scooter": "motorcycle",
    "Other Vehicle - Pedicab": "bicycle",
    "Personal Mobility Device": "bicycle",
    "Bicycle": "bicycle",
    "Pedestrian": "person",
    "Pedestrian with Object": "person",
}
"""Cityscapes classes of cuboids; labels that are not listed, as cones and signs, stay in the street."""
POINT_CLASSES: dict[int, str | None] = {
    5: "vegetation", 6: "terrain", 7: "road", 8: "road", 9: "road", 10: "road", 11: "sidewalk", 12: "sidewalk",
    13: "car", 14: "car", 15: "truck", 16: "truck", 17: "truck", 18: "motorcycle", 19: "truck", 20: "car", 21: "bicycle",
    22: "car", 23: "bus", 24: "bicycle", 25: "motorcycle", 26: "bicycle", 27: "train", 28: "train", 29: "train",
    30: "person", 31: "person", 35: "fence", 36: "traffic sign", 38: "traffic sign", 39: "fence", 41: "building",
    42: "pole",
}  # fmt: skip
"""Of the ids in classes.json; 42 is "Other Static Object", mostly poles and street furniture."""


def is_one(folder: Path) -> bool:
    """Whether a folder is a sequence itself."""
    return (folder / "lidar/poses.json").is_file() and any((folder / "camera").glob("*/intrinsics.json"))


def recognizes(path: Path) -> bool:
    """Whether a folder is a sequence of PandaSet, or holds such."""
    return path.is_dir() and bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the sequences that a folder holds; "." where it is one."""
    return scenes_of(path, is_one)


def read_pandaset(path: Path, scene: str = ".") -> Drive:
    """Read a sequence.

    Args:
        path: folder of the sequence, or of several; scene: which of them, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path / scene
    sources: list[Path] = [root / "lidar/poses.json", root / "lidar/timestamps.json"]
    notices: list[str] = []
    stamps = _stamps(root / "lidar/timestamps.json")
    boxes, files = _cuboids(root)
    sources += files
    frames: list[Frame] = []
    for folder in sorted(p for p in (root / "camera").iterdir() if p.is_dir()):
        if not (folder / "intrinsics.json").is_file():
            notices.append(f"camera {folder.name} is left out: it has no intrinsics.json")
            continue
        sources += [folder / n for n in ("intrinsics.json", "poses.json", "timestamps.json")]
        own = _camera_frames(folder, boxes)
        frames += own
        notices += other_pictures(own, "frames are named by numbers as")
        if len(own) < len(stamps):
            notices.append(f"{len(own)} of {len(stamps)} photographs of {folder.name} are there")
    sweeps = []
    classes = {int(n): p for n, p in _numbered(root / "annotations/semseg", (".pkl.gz", ".pkl")).items()}
    for name, file in _numbered(root / "lidar", (".pkl.gz", ".pkl")).items():
        number = int(name)
        labels = classes.get(number)
        sources += [] if labels is None else [labels]
        time = stamps[number] if number < len(stamps) else None
        sweeps.append(Sweep(file, partial(_points, file, labels), time, boxes.get(number, ())))
    if not frames:
        raise DriveError("has no photographs", path=root / "camera", mend="unpack the camera folders, too")
    if len(sweeps) < len(stamps):
        notices.append(f"{len(sweeps)} of {len(stamps)} LiDAR sweeps are there")
    notices += [] if boxes else ["the sequence has no boxes of objects: annotations/cuboids holds none"]
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=tuple(sources),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


def _numbered(folder: Path, endings: Sequence[str]) -> dict[str, Path]:
    """Files named by a number, by their stem, in order."""
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir(), key=lambda p: natural_key(p.name)) if folder.is_dir() else ():
        for ending in endings:
            if path.name.endswith(ending) and path.name[: -len(ending)].isdigit():
                found.setdefault(path.name[: -len(ending)], path)
    return found


def _list(path: Path) -> list[Any]:
    content = read_json(path)
    if not isinstance(content, list):
        raise DriveError("Not a list", path=path, mend="download it again")
    return content


def _stamps(path: Path) -> list[float]:
    try:
        stamps = [float(t) for t in _list(path)]
    except (TypeError, ValueError, OverflowError) as error:
        raise DriveError(f"holds no time stamps: {error}", path=path, mend="download it again") from error
    if not np.isfinite(stamps).all():
        raise DriveError("holds a time stamp that is not finite", path=path, mend="download it again")
    return stamps


def _camera_frames(folder: Path, boxes: dict[int, tuple[TrackedBox, ...]]) -> list[Frame]:
    intrinsics = read_json(folder / "intrinsics.json")
    try:
        fx, fy, cx, cy = (float(intrinsics[n]) for n in ("fx", "fy", "cx", "cy"))  # type: ignore[index]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        path = folder / "intrinsics.json"
        raise DriveError(f"holds no calibration: {error}", path=path, mend="download it again") from error
    poses, stamps = _list(folder / "poses.json"), _stamps(folder / "timestamps.json")
    frames = []
    size: tuple[int, int] | None = None
    for name, image in _numbered(folder, (".jpg", ".jpeg", ".png")).items():
        number = int(name)
        if number >= len(poses) or number >= len(stamps):
            raise DriveError(f"has no pose and time stamp for frame {name}", path=folder / "poses.json")
        size = calibration_size(picture_size(image), (cx, cy))
        try:
            heading = [float(poses[number]["heading"][n]) for n in "wxyz"]
            position = [float(poses[number]["position"][n]) for n in "xyz"]
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise DriveError(
                f"frame {name} lacks {error}", path=folder / "poses.json", mend="download it again"
            ) from error
        pose = pose_of(heading, position, folder / "poses.json", f"the pose of frame {name}")
        frames.append(
            Frame(
                name=name,
                camera_name=folder.name,
                camera=calibrated_camera(size, (fx, fy), (cx, cy), pose, folder / "intrinsics.json"),
                image_path=image,
                timestamp=stamps[number],
                boxes=boxes.get(number, ()),
                ego_rows=round(EGO_ROWS.get(folder.name, 0) * size[1] / 1080),
            )
        )
    return frames


def _cuboids(root: Path) -> tuple[dict[int, tuple[TrackedBox, ...]], list[Path]]:
    """Boxes by frame number, and the files they were read from. Of the two boxes of an object that both LiDARs see, that of the
    track which lasts longer is taken."""
    files = _numbered(root / "annotations/cuboids", (".pkl.gz", ".pkl"))
    rows: list[tuple[int, dict[str, Any]]] = []
    columns = ["uuid", "label", "yaw", *(f"{n}.{a}" for n in ("position", "dimensions") for a in "xyz")]
    for name, path in files.items():
        found = read_table(path)
        missing = [c for c in columns if c not in found]
        if missing:
            raise DriveError(f"lacks the column {missing[0]}", path=path, mend="download it again")
        siblings = found.get("cuboids.sibling_id", np.full(len(found["uuid"]), "-"))
        for i in range(len(found["uuid"])):
            rows.append((int(name), {**{c: found[c][i] for c in columns}, "sibling": str(siblings[i])}))
    lasts = Counter(str(row["uuid"]) for _, row in rows)
    ids = TrackIds()
    boxes: dict[int, list[TrackedBox]] = {int(name): [] for name in files}
    for number, row in rows:
        class_name = BOX_CLASSES.get(str(row["label"]))
        own, other = str(row["uuid"]), row["sibling"]
        if class_name is None or (other in lasts and (lasts[other], other) > (lasts[own], own)):
            continue
        centre = tuple(float(row[f"position.{a}"]) for a in "xyz")
        width, length, height = (float(row[f"dimensions.{a}"]) for a in "xyz")
        yaw = float(row["yaw"]) + math.pi / 2
        if np.isfinite([*centre, yaw]).all() and min(width, length, height) > 0:
            boxes[number].append(TrackedBox(ids.of(own), class_name, centre, (length, width, height), yaw))  # type: ignore[arg-type]
    return {number: tuple(found) for number, found in boxes.items()}, list(files.values())


def _points(path: Path, labels: Path | None) -> SweepPoints:
    found = read_table(path)
    try:
        positions = np.stack([found[a].astype(np.float64) for a in "xyz"], axis=1)
    except (KeyError, ValueError) as error:
        raise DriveError(f"Not a sweep: {error}", path=path, mend="download it again") from error
    finite = np.isfinite(positions).all(axis=1)
    return SweepPoints(positions[finite], None if labels is None else _classes(labels, len(positions))[finite])


def _classes(path: Path, count: int) -> NDArray[np.uint8]:
    numbers = read_table(path).get("class", np.zeros(0, np.int64)).astype(np.int64)
    if len(numbers) != count:
        raise DriveError(f"labels {len(numbers)} points, the sweep has {count}", path=path, mend="download both again")
    return table(POINT_CLASSES)[np.clip(numbers, 0, 255)]

"""Waymo drives as neuralsim and StreetSurf prepare them, which StreetUnveiler reads, too: one folder a segment.

    scenario.pt (a pickle of dicts and arrays)    images/camera_*/00000000.jpg
    lidars/lidar_*/00000000.npz    masks/camera_*/00000000.npz (trainIds, made by a network)

Poses are world from camera with OpenCV axes, each camera's at its own time, and world from laser; the world is Waymo's, shifted to
the first frame, metres and z up. Photographs are distorted. A laser's rays are in its own axes and the vehicle's motion during the
sweep is taken out of them. Facts: PJLab-ADG/neuralsim (``waymo/preprocess.py``, ``waymo_dataset.py``).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import CITYSCAPES, VOID
from unveil_core.drives.drive import Drive, Frame, FrameLabels, PointCloud, Sweep, SweepPoints
from unveil_core.drives.formats.binary import read_archive
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, rigid, scenes_of
from unveil_core.drives.formats.processed.shared import Boxes, boxes_near, boxes_of_track, lens
from unveil_core.drives.formats.safe_pickle import read_arrays

__all__ = ["is_one", "read_neuralsim", "recognizes", "scenes"]

FRONT = "camera_FRONT"
SCENARIO = "scenario.pt"
SUFFIXES = (".jpg", ".png", ".jpeg")
"""Of photographs: JPEG as prepared, others in copies."""
MEND = "prepare the segment again"
BOX_CLASSES = {"Vehicle": "car", "Pedestrian": "person", "Cyclist": "rider"}
"""Cityscapes classes of objects; "unknown" and "Sign" stay in the street."""


def is_one(folder: Path) -> bool:
    """Whether a folder is a segment itself."""
    return (folder / SCENARIO).is_file()


def recognizes(path: Path) -> bool:
    """Whether a folder is such a segment, or holds such."""
    return bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the segments that a folder holds; "." where it is one."""
    return scenes_of(path, is_one)


def read_neuralsim(path: Path, scene: str = ".") -> Drive:
    """Read a segment.

    Args:
        path: folder of the segment, or of several; scene: which of them, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path / scene
    file = root / SCENARIO
    scenario = read_arrays(file)
    try:
        observers = {str(name): _Observer(file, str(name), o) for name, o in scenario["observers"].items()}
        stamps, boxes = _boxes(scenario.get("objects") or {}, observers, file)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        problem = f"lacks {error}" if isinstance(error, KeyError) else f"Not a scenario of neuralsim: {error}"
        raise DriveError(problem, path=file, mend=MEND) from error
    frames: list[Frame] = []
    notices: list[str] = []
    for name, observer in observers.items():
        if name.startswith("camera_"):
            there = _camera_frames(root, observer, stamps, boxes)
            frames += there
            missing = len(observer.numbers) - len(there)
            notices += [f"{missing} of {len(observer.numbers)} photographs of {name} are missing"] * (missing > 0)
    if not frames:
        raise DriveError("has no photographs", path=root / "images", mend="copy the images folder, too")
    lasers = [o for name, o in observers.items() if name.startswith("lidar_")]
    sweeps = _sweeps(root, lasers, boxes)
    wanted = max((len(o.numbers) for o in lasers), default=0)
    notices += [f"{len(sweeps)} of {wanted} LiDAR sweeps are there"] * (len(sweeps) < wanted)
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=(file, *(p for part in ("lidars", "masks") for p in sorted((root / part).glob("*/*.npz")))),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


class _Observer:
    """One sensor of the scenario, or the vehicle, frame by frame.

    Attributes:
        name: of its folder. numbers: of its frames, by which its files are named.
        stamps: (n,) seconds; None where they are missing.
    """

    def __init__(self, path: Path, name: str, entry: Mapping[str, Any]) -> None:
        self.path, self.name, self.data = path, name, entry["data"]
        count = int(entry["n_frames"])
        self.numbers = self.column("global_frame_ind", (), count).astype(int).tolist()
        self.stamps = self.column("timestamp", (), count) if "timestamp" in self.data else None

    def column(self, key: str, shape: tuple[int, ...], count: int | None = None) -> Float64:
        """(n, *shape) of one of its arrays."""
        values = np.asarray(self.data[key], dtype=np.float64)
        wanted = (len(self.numbers) if count is None else count, *shape)
        if values.shape != wanted or not np.isfinite(values).all():
            problem = f"{key} of {self.name} is {values.shape}, not {wanted}, or holds NaN"
            raise DriveError(problem, path=self.path, mend=MEND)
        return values

    def time(self, i: int) -> float | None:
        return None if self.stamps is None else float(self.stamps[i])


def _required(observer: _Observer, key: str, shape: tuple[int, ...]) -> Float64:
    try:
        return observer.column(key, shape)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        problem = f"{observer.name} lacks a good {key}: {error}"
        raise DriveError(problem, path=observer.path, mend=MEND) from error


def _boxes(
    objects: Mapping[Any, Any], observers: Mapping[str, _Observer], path: Path
) -> tuple[dict[int, float], Boxes]:
    """Time and boxes by frame number; times are those of the vehicle, none where it has none."""
    ids = TrackIds()
    found: dict[int, list[TrackedBox]] = {}
    for key, entry in objects.items():
        class_name = BOX_CLASSES.get(str(entry["class_name"]))
        if class_name is None:
            continue
        for segment in entry["segments"]:
            poses = np.asarray(segment["data"]["transform"], dtype=np.float64)
            sizes = np.asarray(segment["data"]["scale"], dtype=np.float64)
            if poses.shape[1:] != (4, 4) or sizes.shape != (len(poses), 3):
                raise DriveError(f"object {key} has no poses and sizes", path=path, mend=MEND)
            first = int(segment["start_frame"])
            for i, box in enumerate(boxes_of_track(ids.of(str(key)), class_name, poses, sizes)):
                if box is not None:
                    found.setdefault(first + i, []).append(box)
    vehicle = observers.get("ego_car")
    times = {} if vehicle is None or vehicle.stamps is None else dict(zip(vehicle.numbers, vehicle.stamps, strict=True))
    return {n: float(t) for n, t in times.items()}, {n: tuple(b) for n, b in found.items()}


def _camera_frames(root: Path, camera: _Observer, stamps: dict[int, float], boxes: Boxes) -> list[Frame]:
    sizes, k = _required(camera, "hw", (2,)).astype(int), _required(camera, "intr", (3, 3))
    poses = _required(camera, "c2w", (4, 4))
    lenses = _required(camera, "distortion", (5,)) if "distortion" in camera.data else np.zeros((len(poses), 5))
    frames = []
    for i, number in enumerate(camera.numbers):
        name = f"{number:08d}"
        stem = root / "images" / camera.name / name
        image = next((p for s in SUFFIXES if (p := stem.with_suffix(s)).is_file()), None)
        if image is None:
            continue
        pose = rigid(poses[i], camera.path, f"the pose of frame {name} of {camera.name}")
        # Waymo counts the principal point from the edge of the first pixel.
        centre = (k[i, 0, 2] - 0.5, k[i, 1, 2] - 0.5)
        size = (int(sizes[i, 1]), int(sizes[i, 0]))
        mask = root / "masks" / camera.name / f"{name}.npz"
        time = camera.time(i)
        frames.append(
            Frame(
                name=name,
                camera_name=camera.name,
                camera=calibrated_camera(size, (k[i, 0, 0], k[i, 1, 1]), centre, pose, camera.path),
                image_path=image,
                distortion=lens(lenses[i]),
                timestamp=time,
                boxes=boxes_near(time, number, stamps, boxes),
                labels=partial(_labels, mask, size) if mask.is_file() else None,
            )
        )
    return frames


def _labels(path: Path, size: tuple[int, int]) -> FrameLabels:
    (numbers,) = read_archive(path, ["arr_0"])
    if numbers.shape != size[::-1] or numbers.dtype.kind not in "iu":
        problem = f"holds {numbers.dtype} {numbers.shape}, no labels of {size[0]}x{size[1]} pixels"
        raise DriveError(problem, path=path, mend=MEND)
    known = (numbers >= 0) & (numbers < len(CITYSCAPES))
    return FrameLabels(np.where(known, numbers, VOID).astype(np.uint8))


def _sweeps(root: Path, lasers: list[_Observer], boxes: Boxes) -> list[Sweep]:
    """What all lasers saw in a frame is one sweep; what is missing of it is left out."""
    parts: dict[int, list[tuple[Path, Float64]]] = {}
    stamps: dict[int, float | None] = {}
    for laser in lasers:
        poses = _required(laser, "l2w", (4, 4))
        for i, number in enumerate(laser.numbers):
            file = root / "lidars" / laser.name / f"{number:08d}.npz"
            if file.is_file():
                pose = rigid(poses[i], laser.path, f"the pose of frame {number} of {laser.name}")
                parts.setdefault(number, []).append((file, pose))
                stamps.setdefault(number, laser.time(i))
    return [
        Sweep(found[0][0], partial(_points, found), stamps[number], boxes.get(number, ()))
        for number, found in sorted(parts.items())
    ]


def _points(parts: list[tuple[Path, Float64]]) -> SweepPoints:
    return SweepPoints(np.concatenate([_of_laser(path, pose) for path, pose in parts]))


def _of_laser(path: Path, world_from_laser: Float64) -> NDArray[np.float64]:
    origins, directions, ranges = read_archive(path, ["rays_o", "rays_d", "ranges"])
    numbers = all(a.dtype.kind == "f" for a in (origins, directions, ranges))
    if not numbers or origins.shape != (*ranges.shape, 3) or directions.shape != origins.shape:
        problem = f"has rays of {origins.shape} and {directions.shape} with ranges of {ranges.shape}"
        raise DriveError(problem, path=path, mend=MEND)
    lengths = ranges.reshape(-1, 1).astype(np.float64)
    local = origins.reshape(-1, 3) + lengths * directions.reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        local = local[np.isfinite(local).all(axis=1) & (lengths[:, 0] > 0)]
    return local @ world_from_laser[:3, :3].T + world_from_laser[:3, 3]

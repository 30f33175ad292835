"""Real sequences whose cameras are known, solved as plain images: how many frames are placed, how far off the way is, and how long
it takes. Where labels lie beside a sequence they are given.

    .venv/bin/python benchmarks/input/solve.py --data DIR [--only kitti,lund] [--keep DIR] [-o benchmarks/results/solve.json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import UnveilError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, PointCloud
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.geometry.transforms import nearest_rotation
from unveil_core.points.of_drive import found_points
from unveil_core.solve.placing import height_over_way
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.solve import solve

MEND = "given by --data, laid out as the datasets release it"


@dataclass(frozen=True)
class Sequence:
    """Attributes: drive: relative to the data; options: of its reader; labels: folder by frame stem, "" = none; metric: the truth
    is in metres; height: of the camera, as the dataset's makers tell it, else the LiDAR does."""

    drive: str
    options: DriveOptions
    labels: str = ""
    metric: bool = True
    height: float | None = None


SEQUENCES = {
    "kitti": Sequence("kitti_raw", DriveOptions(), "kitti_raw/labels/image_02", height=1.65),
    "pandaset": Sequence("pandaset/002", DriveOptions(cameras=("front_camera",))),
    "lund": Sequence("lund", DriveOptions(), "lund/labels", metric=False),
    "nuscenes": Sequence(
        "nuscenes", DriveOptions(cameras=("CAM_FRONT",), sweeps="key"), "nuscenes/labels/CAM_FRONT"
    ),
}


def plain_images(drive: Drive, labels: Path | None, folder: Path) -> tuple[Path, Path | None]:
    """The photographs of a drive by number alone, and labels named likewise."""
    images, own = folder / "frames", folder / "labels"
    images.mkdir(parents=True)
    for k, frame in enumerate(drive.frames):
        shutil.copyfile(frame.image_path, images / f"{k:04d}{frame.image_path.suffix}")
        if labels is not None:
            own.mkdir(exist_ok=True)
            shutil.copyfile(labels / f"{frame.image_path.stem}.png", own / f"{k:04d}.png")
    return images, None if labels is None else own


def measured(name: str, data: Path, keep: Path, thorough: bool) -> dict[str, object]:
    """Solve a sequence and compare it with its true cameras."""
    sequence = SEQUENCES[name]
    truth = open_drive(data / sequence.drive, sequence.options)
    height = sequence.height or (true_height(truth) if sequence.metric else None)
    folder = keep / name
    shutil.rmtree(folder, ignore_errors=True)
    images, labels = plain_images(truth, data / sequence.labels if sequence.labels else None, folder)
    settings = SolveSettings(labels=labels, camera_height=None if height is None else round(height, 3), thorough=thorough)
    load, begun = os.getloadavg()[0], time.monotonic()
    solved = solve([images], folder / "drive", settings)
    seconds = time.monotonic() - begun
    found = open_drive(solved.drive)
    by_name = {f.name: f for f in found.frames}
    pairs = [(f, by_name[f"{k:04d}"]) for k, f in enumerate(truth.frames) if f"{k:04d}" in by_name]
    here = np.stack([b.camera.centre for _, b in pairs])
    there = np.stack([a.camera.centre for a, _ in pairs])
    scale, turn, shift = similarity(here, there)
    off = np.linalg.norm(scale * here @ turn.T + shift - there, axis=1)
    way = float(np.linalg.norm(np.diff(there, axis=0), axis=1).sum())
    # The way alone does not tell how the cameras roll about it: their directions are compared by themselves.
    poses = [(a.camera.camera_to_world[:3, :3], b.camera.camera_to_world[:3, :3]) for a, b in pairs]
    between = nearest_rotation(sum(a @ b.T for a, b in poses))[0]
    angles = [angle_deg(a, between @ b) for a, b in poses]
    focal = pairs[0][1].camera.fx / pairs[0][0].camera.fx
    return {
        "frames": len(truth.frames),
        "placed": len(pairs),
        "solved": solved.facts["solved"],
        "standing": solved.facts["standing"],
        "way_units": round(way, 3),
        "error_percent_of_way": round(100 * float(np.sqrt((off**2).mean())) / way, 3),
        "rotation_deg": round(float(np.median(angles)), 3),
        "focal_percent": round(100 * (focal - 1), 2) if sequence.metric else None,
        "scale_percent": None if height is None else round(100 * (1 / scale - 1), 2),
        "camera_height": None if height is None else round(height, 3),
        "error_px": solved.facts["error_px"],
        "points": solved.facts["points"],
        "seconds_a_frame": round(seconds / len(truth.frames), 2),
        "size": f"{truth.frames[0].camera.width}x{truth.frames[0].camera.height}",
        "load_before": round(load, 1),
    }


def measured_points(name: str, data: Path) -> dict[str, object]:
    """Points found in the photographs of a drive whose LiDAR was taken away, by their distance from the cameras: how many, and the
    share that lies within 25 cm of a point of the LiDAR."""
    sequence = SEQUENCES[name]
    truth = open_drive(data / sequence.drive, sequence.options)
    begun = time.monotonic()
    found = found_points(replace(truth, points=PointCloud(np.zeros((0, 3))), sweeps=()))
    seconds = time.monotonic() - begun
    measured = np.concatenate([s.read().positions for s in truth.sweeps])
    apart, _ = cKDTree(measured).query(found.positions)
    far, _ = cKDTree(np.stack([f.camera.centre for f in truth.frames])).query(found.positions)
    told: dict[str, object] = {"points": len(apart), "seconds_a_frame": round(seconds / len(truth.frames), 2)}
    for near, end in ((0, 8), (8, 15), (15, 25), (25, 50)):
        own = (far >= near) & (far < end)
        told[f"{near} to {end} m"] = {
            "points": int(own.sum()),
            "median_m": round(float(np.median(apart[own])), 3),
            "within_25_cm": round(float((apart[own] < 0.25).mean()), 3),
        }
    return told


def true_height(truth: Drive) -> float:
    """Of the cameras over the way, metres, by the LiDAR."""
    roughly = place_drive(truth, camera_height_m=1.0).height
    assert roughly is not None
    points = np.concatenate([s.read().positions for s in truth.sweeps[:: max(1, len(truth.sweeps) // 12)]])
    centres = [f.camera.centre for f in truth.frames]
    return height_over_way(centres, points, np.array([0.0, 0.0, 1.0]), roughly) or roughly


def similarity(here: np.ndarray, there: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation and shift that bring points (N, 3) nearest to others (Umeyama 1991)."""
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    turn = u @ flip @ vt
    scale = float((s * np.diag(flip)).sum() / (a**2).sum())
    return scale, turn, there.mean(axis=0) - scale * turn @ here.mean(axis=0)


def angle_deg(first: np.ndarray, second: np.ndarray) -> float:
    """Angle between two rotations."""
    return float(np.degrees(np.arccos(np.clip((np.trace(first.T @ second) - 1) / 2, -1, 1))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--only", default=",".join(SEQUENCES))
    parser.add_argument("--keep", type=Path, default=None)
    parser.add_argument("--thorough", action="store_true")
    parser.add_argument("--points", action="store_true", help="find points by the true poses instead, and compare with the LiDAR")
    parser.add_argument("-o", "--output", type=Path, default=None)
    given = parser.parse_args()
    keep = given.keep or Path(tempfile.mkdtemp())
    results: dict[str, object] = {}
    if given.output is not None and given.output.is_file():
        results = json.loads(given.output.read_text())["sequences"]
    for name in given.only.split(","):
        key = f"{name}, thorough" if given.thorough else f"{name}, points" if given.points else name
        try:
            run = measured_points(name, given.data) if given.points else measured(name, given.data, keep, given.thorough)
            results[key] = run
        except UnveilError as error:
            results[key] = {"error": str(error)}
        print(key, json.dumps(results[key]), flush=True)
    if given.output is not None:
        about = {"machine": platform.processor() or platform.machine(), "cores": os.cpu_count()}
        about |= {"pycolmap": version("pycolmap"), "opencv": version("opencv-contrib-python-headless")}
        given.output.write_text(json.dumps({**about, "sequences": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()

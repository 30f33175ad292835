"""Import of a long drive: seconds and peak memory of 200 frames of 1920x1280 and 200 sweeps of 170,000 points.

    python benchmarks/input/import_memory.py [FRAMES]

The drive has KITTI's raw layout and is written into a temporary folder: a street of ground and walls, scanned anew every 1.2 m;
photographs and sweeps are few files under many names, the poses differ. ``unveil import`` runs in a process of its own, with the
working size of ``standard``. Results go to benchmarks/results/import_memory.json.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from unveil_core.bench.timing import machine
from unveil_core.drives.points import read_points

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results/import_memory.json"
FRAMES, POINTS, SIZE, STEP_M = 200, 170_000, (1920, 1280), 1.2
DISTINCT = 8
"""Photographs and sweeps that are really made."""
LIMIT_MB = 3000
"""What an import may take at most."""
TURN = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""From the scanner (x ahead, y left, z up) to a camera."""
METRES_PER_DEGREE = 6378137.0 * np.pi / 180


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{v:.9e}" for v in np.asarray(values, dtype=np.float64).ravel())


def sweep(generator: np.random.Generator) -> np.ndarray:
    """(P, 4) of one turn: ground to 60 m, denser near by, and walls 9 m to both sides."""
    count = POINTS * 2 // 3
    angle, distance = generator.uniform(-np.pi, np.pi, count), 3 + 57 * generator.uniform(0, 1, count) ** 2
    ground = np.stack([distance * np.cos(angle), distance * np.sin(angle), np.full(count, -1.7)], axis=1)
    ground[:, 1] = np.clip(ground[:, 1], -9, 9)
    rest = POINTS - count
    side = 9.0 * generator.choice([-1, 1], rest)
    walls = np.stack([generator.normal(0, 25, rest), side, generator.uniform(-1.7, 8, rest)], axis=1)
    points = np.concatenate([ground, walls]) + generator.normal(0, 0.02, (POINTS, 3))
    return np.column_stack([points, np.full(POINTS, 0.3)]).astype("<f4")


def photograph(generator: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8 that JPEG packs as a street: soft shapes with grain."""
    width, height = SIZE
    small = generator.uniform(0, 255, (height // 32, width // 32, 3)).astype(np.float32)
    grain = generator.normal(0, 6, (height, width, 1))
    return np.clip(cv2.resize(small, SIZE, interpolation=cv2.INTER_CUBIC) + grain, 0, 255).astype(np.uint8)


def make_drive(root: Path, frames: int) -> Path:
    """Write the drive; returns its folder."""
    day, generator = root / "2011_09_26", np.random.default_rng(0)
    drive = day / "2011_09_26_drive_0001_sync"
    for name in ("image_02/data", "oxts/data", "velodyne_points/data"):
        (drive / name).mkdir(parents=True)
    unmoved = {"R": np.eye(3), "T": np.zeros(3)}
    width, height = SIZE
    lens = np.array([[1400.0, 0, width / 2, 0], [0, 1400.0, height / 2, 0], [0, 0, 1, 0]])
    calibrations = {
        "cam_to_cam": {"R_rect_00": np.eye(3), "S_rect_02": np.array(SIZE), "P_rect_02": lens},
        "velo_to_cam": {**unmoved, "R": TURN},
        "imu_to_velo": unmoved,
    }
    for name, entries in calibrations.items():
        text = "\n".join(f"{key}: {numbers(value)}" for key, value in entries.items())
        (day / f"calib_{name}.txt").write_text(text + "\n")
    for i in range(frames):
        image, points = (drive / f"{n}/data/{i:010d}" for n in ("image_02", "velodyne_points"))
        image, points = image.with_suffix(".jpg"), points.with_suffix(".bin")
        if i < DISTINCT:
            cv2.imwrite(str(image), photograph(generator))
            sweep(generator).tofile(points)
        else:
            for path in (image, points):
                os.link(path.with_stem(f"{i % DISTINCT:010d}"), path)
        packet = [0.0, STEP_M * i / METRES_PER_DEGREE, 0.0, 0.0, 0.0, 0.0, *[0.0] * 24]
        (drive / f"oxts/data/{i:010d}.txt").write_text(" ".join(f"{v:.12f}" for v in packet))
    return drive


def measure(frames: int) -> dict[str, object]:
    """Import in a child process; how long it took, what it held at most, and how often it told how far it was."""
    with tempfile.TemporaryDirectory() as name:
        drive, workspace = make_drive(Path(name) / "kitti", frames), Path(name) / "workspace"
        command = [sys.executable, "-m", "unveil_core", "import", str(drive), "-o", str(workspace), "--json"]
        begun = time.perf_counter()
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            events = [(time.perf_counter() - begun, json.loads(line)) for line in process.stdout]
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - begun
        if process.returncode:
            raise SystemExit(f"the import ended with {process.returncode}")
        told = [t for t, event in events if event.get("total")]
        return {
            "frames": frames,
            "size": SIZE,
            "sweeps": frames,
            "points_a_sweep": POINTS,
            "seconds": round(seconds, 1),
            "peak_memory_mb": round(used.ru_maxrss / 1024, 1),
            "limit_mb": LIMIT_MB,
            "points_kept": len(read_points(workspace / "drive/points.ply").positions),
            "progress_events": len(told),
            "longest_silence_s": round(float(np.diff([0.0, *told, seconds]).max()), 1),
        }


def main() -> None:
    """Measure once; exit code 1 where the import takes too much."""
    measured = measure(int(sys.argv[1]) if len(sys.argv) > 1 else FRAMES)
    print(json.dumps(measured))
    if measured["frames"] == FRAMES:
        RESULTS.write_text(json.dumps({"machine": machine(), "rows": [measured]}, indent=1) + "\n")
    raise SystemExit(int(float(str(measured["peak_memory_mb"])) > LIMIT_MB))


if __name__ == "__main__":
    main()

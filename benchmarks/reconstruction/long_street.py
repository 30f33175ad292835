"""Fusion of a whole street: seconds, memory and error for 200 m at 5 cm.

    python benchmarks/reconstruction/long_street.py

An analytic street (road, kerbs, walks, facades 10 m high on both sides) is seen by a camera every metre, ray cast
exactly; :func:`unveil_core.mesh.fuse` makes one mesh of the views, and its vertices are held against the true planes. Each
row is a process of its own; results go to benchmarks/results/long_street.json.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.bench.timing import machine
from unveil_core.geometry.camera import Camera
from unveil_core.mesh import DepthView, fuse

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results/long_street.json"
MAX_DEPTH_M = 25.0
EYE_M, ROAD_M, WALK_M, KERB_M, FACADE_M = 1.6, 4.0, 6.5, 0.15, 10.0
TURN = Rotation.from_euler("zyx", (23.0, 2.0, 0.7), degrees=True).as_matrix()
SHIFT = np.array([3.217, -1.873, 0.391])
"""Where the street lies: a plane between two layers of voxels would be too easy, it would be met exactly."""
ROWS = (
    {"length_m": 200, "views": 200, "width": 640, "height": 384, "voxel_m": 0.05},
    {"length_m": 200, "views": 300, "width": 640, "height": 384, "voxel_m": 0.05},
    {"length_m": 200, "views": 300, "width": 1600, "height": 960, "voxel_m": 0.05},
)


def rectangles(length: float) -> list[tuple[int, float, np.ndarray, np.ndarray]]:
    """Axis, coordinate along it, lowest and highest corner of each face of the street."""
    top = KERB_M + FACADE_M
    faces = [(2, 0.0, (0, -ROAD_M, 0), (length, ROAD_M, 0))]
    for side in (-1, 1):
        near, far = sorted((side * ROAD_M, side * WALK_M))
        faces += [
            (1, side * ROAD_M, (0, side * ROAD_M, 0), (length, side * ROAD_M, KERB_M)),
            (2, KERB_M, (0, near, KERB_M), (length, far, KERB_M)),
            (1, side * WALK_M, (0, side * WALK_M, KERB_M), (length, side * WALK_M, top)),
        ]
    return [(axis, value, np.array(low, float), np.array(high, float)) for axis, value, low, high in faces]


def see(camera: Camera, length: float) -> DepthView:
    """Exact depth along the optical axis, and colours that change every half metre."""
    origin, rays = (camera.centre - SHIFT) @ TURN, camera.rays() @ TURN
    depth = np.full(rays.shape[:2], np.inf)
    for axis, value, low, high in rectangles(length):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (value - origin[axis]) / rays[..., axis]
            p = origin + rays * t[..., None]
        p[..., axis] = value
        with np.errstate(invalid="ignore"):
            hit = (t > 0) & (t < depth) & ((p >= low) & (p <= high)).all(axis=-1)
        depth[hit] = t[hit]
    depth[~np.isfinite(depth)] = 0
    cells = np.floor(2 * (origin + rays * depth[..., None])).astype(np.int64)
    rgb = (60 + cells * (37, 59, 83) % 160).astype(np.uint8)
    return DepthView(camera, depth.astype(np.float32), rgb)


def views(row: dict) -> Iterator[DepthView]:
    """Cameras at even steps along the road, looking ahead and a little down."""
    pitch, width, height = 0.06, row["width"], row["height"]
    forward, right = np.array([np.cos(pitch), 0, -np.sin(pitch)]), np.array([0.0, -1.0, 0.0])
    for x in np.arange(row["views"]) * row["length_m"] / row["views"]:
        matrix = np.eye(4)
        matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward]) @ TURN.T
        matrix[:3, 3] = -matrix[:3, :3] @ (TURN @ (x, 0, EYE_M) + SHIFT)
        yield see(Camera(width, height, 0.6 * width, 0.6 * width, width / 2, height / 2, matrix), row["length_m"])


def measure(row: dict) -> dict:
    """Fuse one street in this process."""
    measured = {**row, "memory_before_mb": peak_memory_mb()}
    blocks = seeing = 0.0

    def timed() -> Iterator[DepthView]:
        nonlocal seeing
        begun = time.perf_counter()
        for view in views(row):
            seeing += time.perf_counter() - begun
            yield view
            begun = time.perf_counter()

    def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
        nonlocal blocks
        blocks = metrics.get("blocks", blocks)

    begun = time.perf_counter()
    mesh = fuse(timed(), voxel_size=row["voxel_m"], max_depth=MAX_DEPTH_M, progress=progress)
    seconds = time.perf_counter() - begun - seeing
    peak = peak_memory_mb()
    vertices = (mesh.vertices - SHIFT) @ TURN
    error = np.full(len(vertices), np.inf)
    for _, _, low, high in rectangles(row["length_m"]):
        beside = np.maximum(np.maximum(low - vertices, vertices - high), 0)
        error = np.minimum(error, np.linalg.norm(beside, axis=1))
    return {
        **measured, "seconds": round(seconds, 1), "peak_memory_mb": peak, "blocks": int(blocks),
        "triangles": len(mesh.faces), "error_median_mm": round(1000 * float(np.median(error)), 3),
        "error_95_percent_mm": round(1000 * float(np.quantile(error, 0.95)), 3)
    }


def main() -> None:
    """Measure every row, each in a process of its own."""
    document = {"machine": machine(), "max_depth_m": MAX_DEPTH_M, "rows": []}
    for row in ROWS:
        command = [sys.executable, __file__, json.dumps(row)]
        out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        document["rows"].append(json.loads(out))
        print(out, end="", flush=True)
    RESULTS.write_text(json.dumps(document, indent=1) + "\n")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measure(json.loads(sys.argv[1]))))
    else:
        main()

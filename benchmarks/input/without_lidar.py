"""Sample streets without their LiDAR, with and without the ground that photographs tell.

    python benchmarks/input/without_lidar.py [--quality standard] [--only SCENE_DRIVE_GROUND ...] [--keep DIR]

Of each sample street a drive is made whose points are 3,000 of its own, drawn at random, about as many as structure from motion
finds, and which has its labels (``labels``) or nothing but masks of what goes, a pixel loose (``masks``). Each is run up to its
frames as it is (``photographs``), and in a process in which no ground is looked for in photographs (``points``).
benchmarks/results/without_lidar.json has the figures of the removed region and of cast shadows, and flicker, by
scene, drive and ground, each with the commit that it was measured in; rows that are not run again stay.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.streets.street_figures import FIGURES  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.drives import open_drive  # noqa: E402
from unveil_core.drives.cityscapes import train_id  # noqa: E402
from unveil_core.drives.points import write_points  # noqa: E402
from unveil_core.evaluate import run_evaluation  # noqa: E402
from unveil_core.optimize import start  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402
from unveil_core.semantics.classes import REMOVABLE  # noqa: E402

RESULTS = ROOT / "benchmarks/results/without_lidar.json"
SCENES = ("parked_street", "country_road")
POINTS = 3000


def make_drive(scene: str, folder: Path, *, labels: bool) -> Path:
    """A sample street with few points, and with its labels or with masks; returns its folder."""
    source = ROOT / "sample_scenes" / scene
    folder.mkdir(parents=True, exist_ok=True)
    data = json.loads((source / "transforms.json").read_text())
    points = open_drive(source / "transforms.json").points
    some = np.random.default_rng(0).permutation(len(points.positions))[:POINTS]
    write_points(points.select(some), folder / "points.ply")
    data["ply_file_path"] = "points.ply"
    for name in ("images", *(("semantics", "instances") if labels else ())):
        (folder / name).symlink_to(source / name)
    if not labels:
        for key in ("semantic_classes", "instances"):
            data.pop(key, None)
        ids = [train_id(name) for name in REMOVABLE]
        (folder / "masks").mkdir()
        for frame in data["frames"]:
            frame.pop("instance_path", None)
            label = cv2.imread(str(source / frame.pop("semantic_path")), cv2.IMREAD_UNCHANGED)
            stays = cv2.erode(np.where(np.isin(label, ids), 0, 255).astype(np.uint8), np.ones((3, 3), np.uint8))
            frame["mask_path"] = f"masks/{Path(frame['file_path']).stem}.png"
            cv2.imwrite(str(folder / frame["mask_path"]), stays)
    (folder / "transforms.json").write_text(json.dumps(data))
    return folder


def run_one(drive: Path, workspace: Path, quality: str, *, photographs: bool) -> None:
    """One run up to the frames, in this process."""
    if not photographs:
        start.start_ground = lambda *_, **__: None  # type: ignore[assignment]
    run(drive, workspace, RunSettings(quality=quality, baselines=False), until="deliver")


def figures(workspace: Path, truth: Path) -> dict[str, Any]:
    """What is recorded of a run."""
    found = run_evaluation(workspace, truth)
    regions = found["truth"]["regions"]

    def of(region: str) -> dict[str, Any] | None:
        row = regions.get(region, {}).get("methods", {}).get("ours")
        return None if row is None else {k: row.get(k) for k in FIGURES}

    flicker = found.get("flicker", {}).get("methods", {}).get("ours", {}).get("absolute")
    return {"removed": of("removed"), "cast_shadow": of("cast_shadow"), "flicker": flicker}


def main() -> None:
    """Run them all and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quality", default="standard")
    parser.add_argument("--only", nargs="+", help="rows to measure, as parked_street_masks_photographs")
    parser.add_argument("--keep", type=Path, help="keep the workspaces here")
    parser.add_argument("--one", nargs=3, metavar=("DRIVE", "WORKSPACE", "WAY"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        drive, workspace, way = arguments.one
        run_one(Path(drive), Path(workspace), arguments.quality, photographs=way == "photographs")
        return
    rows = json.loads(RESULTS.read_text())["rows"] if RESULTS.is_file() else {}
    with tempfile.TemporaryDirectory() as scratch:
        root = arguments.keep or Path(scratch)
        for scene, kind, way in itertools.product(SCENES, ("labels", "masks"), ("points", "photographs")):
            name = f"{scene}_{kind}_{way}"
            if arguments.only and name not in arguments.only:
                continue
            drive, workspace = root / f"{scene}_{kind}", root / name
            if not drive.exists():
                make_drive(scene, drive, labels=kind == "labels")
            command = [sys.executable, __file__, "--quality", arguments.quality]
            begun = time.perf_counter()
            subprocess.run([*command, "--one", str(drive), str(workspace), way], check=True)
            seconds = round(time.perf_counter() - begun, 1)
            done = figures(workspace, ROOT / "sample_scenes" / scene / "truth")
            rows[name] = {"seconds": seconds, "program": program_commit(ROOT), **done}
            print(json.dumps({name: rows[name]}), flush=True)
            write_json_atomic(
                RESULTS, {"quality": arguments.quality, "points": POINTS, "rows": rows, "machine": machine()}
            )


if __name__ == "__main__":
    main()

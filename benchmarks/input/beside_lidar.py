"""A real drive unveiled from its plain images alone, beside the run with its LiDAR and its true cameras: how well both show the
street behind planted cars.

    python benchmarks/input/beside_lidar.py --cache DIR [--drives NAMES] [--heights METRES] [--quality draft] [--keep DIR] [-o FILE]

``--cache`` holds planted drives that ``benchmarks/real_drives/real.py`` made. ``unveil solve`` gets their footage with the cars in
it, the labels, and the cameras' height above the ground (``--heights``, one a drive), which gives the scale. What both runs deliver
is compared with the photographs, by car. ``images_less_lidar`` is the mean difference, with its standard error.
In ``--keep`` stay the solved drives, the runs, and strips to look at: photograph, with the cars, from images, with LiDAR.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.measured import FIGURES  # noqa: E402
from benchmarks.real_drives.paired import Figures, estimate, paired  # noqa: E402
from benchmarks.real_drives.planted import KeptRound, kept_rounds  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.frame_cache import FrameCache  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate.delivered import read_delivered  # noqa: E402
from unveil_core.evaluate.holdout.scores import PARTS, HoldoutFrame, measure_holdout  # noqa: E402
from unveil_core.evaluate.perceptual import LpipsModel  # noqa: E402
from unveil_core.solve.settings import SolveSettings  # noqa: E402
from unveil_core.solve.solve import solve  # noqa: E402

RESULTS = ROOT / "benchmarks/results/beside_lidar.json"
DRIVES, HEIGHTS_M = "kitti_0005", "1.65"
ROOM = 1 << 30
STRIP_GAP_PX = 4


def solved_from(kept: KeptRound, height: float, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Solve the footage of a planted drive of one camera; returns the new drive and what the solve tells of itself."""
    (camera,) = [p for p in sorted((kept.drive / "footage").iterdir()) if p.is_dir()]
    labels = kept.drive / "semantics" / camera.name
    solved = solve([camera], folder, SolveSettings(labels=labels, camera_height=height))
    return solved.drive, {n: solved.facts[n] for n in ("solved", "error_px", "points")}


def run_of(drive: Path, workspace: Path, quality: str, arguments: Sequence[str]) -> Path:
    """Run up to the delivered frames, or go on with a run; returns its workspace."""
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace), "--quality", quality]
    subprocess.run([*command, "--until", "deliver", *arguments], check=True, cwd=ROOT)
    return workspace


def shown_by(frames: Sequence[HoldoutFrame], workspace: Path) -> Sequence[HoldoutFrame]:
    """The same frames by the name that their camera has in a workspace of one camera."""
    (name,) = {f.camera_name for f in read_imported(workspace / "drive", points=False).frames}

    def named(i: int) -> HoldoutFrame:
        held = frames[i]
        return replace(held, frame=replace(held.frame, camera_name=name))

    return FrameCache(ROOM).frames(len(frames), named)


def figures_of(kept: KeptRound, workspace: Path, lpips: LpipsModel | None) -> dict[str, Any]:
    """What a run shows behind the cars: see :func:`unveil_core.evaluate.holdout.scores.measure_holdout`."""
    frames = shown_by(kept.frames(), workspace)
    return measure_holdout(frames, kept.cars, kept.planted_drive(), workspace, baseline_frames=0, lpips=lpips)


def of_cars(found: dict[str, Any]) -> dict[str, Figures]:
    """Figures by car."""
    return {
        str(car["number"]): {
            f"{p} {n}": row["methods"]["ours"].get(n) for p, row in car["regions"].items() for n in FIGURES
        }
        for car in found["cars"]
    }


def means(found: dict[str, Any]) -> dict[str, Any]:
    """Of a run: by part and figure the mean over cars, and the share of pixels that changed where nothing should."""
    cars = of_cars(found)
    told: dict[str, Any] = {}
    for part in PARTS:
        values = {n: estimate([car.get(f"{part} {n}") for car in cars.values()]) for n in FIGURES}
        told[part] = {n: v.to_json() for n, v in values.items() if v is not None}
    return {
        **told,
        "outside_changed": found["outside"]["changed"],
        "flicker": found["flicker"]["methods"]["ours"]["absolute"],
    }


def write_strips(kept: KeptRound, workspaces: Sequence[Path], folder: Path) -> None:
    """Photograph, with the cars, and each run, one above the other, of the frames that show a car largest, and half as large."""
    frames, planted = kept.frames(), kept.planted_drive().frames
    shown = [shown_by(frames, w) for w in workspaces]
    areas = np.array([[int((f.region & (f.cars.number == c.number)).sum()) for c in kept.cars] for f in frames])
    folder.mkdir(parents=True, exist_ok=True)
    looked_at = [np.abs(areas - areas.max(axis=0) / k).argmin(axis=0) for k in (1, 2)]
    for i in np.unique(looked_at).tolist():
        rows = [read_image(frames[i].frame.image_path), read_image(planted[i].image_path)]
        rows += [read_delivered(w, s[i].frame) for w, s in zip(workspaces, shown, strict=True)]
        gap = np.full((STRIP_GAP_PX, rows[0].shape[1], 3), 255, np.uint8)
        strip = np.concatenate([part for row in rows for part in (row, gap)][:-1])
        cv2.imwrite(str(folder / f"{frames[i].frame.name}.png"), cv2.cvtColor(strip, cv2.COLOR_RGB2BGR))


def measured(kept: KeptRound, height: float, quality: str, keep: Path, lpips: LpipsModel | None) -> dict[str, Any]:
    """Both runs of a planted drive, and their difference by car."""
    drive, facts = solved_from(kept, height, keep / "drive")
    images = run_of(drive, keep / "images", quality, kept.arguments)
    lidar = run_of(kept.drive, keep / "lidar", quality, kept.arguments)
    found = [figures_of(kept, w, lpips) for w in (images, lidar)]
    write_strips(kept, (images, lidar), keep / "strips")
    difference = paired(*(of_cars(f) for f in found))
    return {
        "quality": quality,
        "frames": found[0]["frames"],
        "cars": len(kept.cars),
        "camera_height": height,
        "solve": facts,
        "images": means(found[0]),
        "lidar": means(found[1]),
        "images_less_lidar": {n: e.to_json() for n, e in difference.items()},
    }


def main() -> None:
    """Measure the drives of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument("--drives", default=DRIVES, help=f"of one camera, with commas between [{DRIVES}]")
    parser.add_argument("--heights", default=HEIGHTS_M, help="of their cameras, metres")
    parser.add_argument("--quality", default="draft", choices=("draft", "standard", "high"))
    parser.add_argument("--lpips", type=Path, help="an LPIPS network, TorchScript or ONNX")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    lpips = None if arguments.lpips is None else LpipsModel(arguments.lpips)
    document: dict[str, Any] = (
        json.loads(arguments.output.read_text()) if arguments.output.is_file() else {"drives": {}}
    )
    with tempfile.TemporaryDirectory() as scratch:
        root = arguments.keep or Path(scratch)
        for name, height in zip(arguments.drives.split(","), arguments.heights.split(","), strict=True):
            kept = kept_rounds(arguments.cache / name)[0]
            row = measured(kept, float(height), arguments.quality, root / name, lpips)
            document["drives"][f"{name}, {arguments.quality}"] = {"program": program_commit(ROOT), **row}
            print(name, json.dumps(row, indent=1), flush=True)
            write_json_atomic(arguments.output, {**document, "machine": machine()})


if __name__ == "__main__":
    main()

"""Holes planted in a real drive: virtual cars over street that the photographs show, removed by an ordinary run, and measured.

    python benchmarks/real_drives/planted_holes.py DRIVE [--cameras NAMES] [--frames A:B:STEP] [--cars 2]
        [--quality standard] [--keep DIR]

A real drive has no true empty street, but where a virtual car hides what was photographed, the photograph is the truth (``unveil
evaluate --holdout-masks``, see unveil_core/evaluate/holdout). The drive is unveiled twice: as it is, to find out where the street
is free, and with the cars. In benchmarks/results/planted_holes.json, a row for each drive, part of it and quality: PSNR and SSIM
behind the cars (``removed``), and there by whether another frame shows the place; gradient, and lines on the ground found and
false. Beside ours stand the best OpenCV row, and the photograph itself blurred by some pixels: whoever guesses all structure
right, and no more than that, has as much. ``gain_db`` is ours above OpenCV, ``below_blurred_db`` what is missing to the ceiling.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from unveil_core.app.holdout_check import CARS, check_footage, holdout_lines  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.types import Picture  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.evaluate.baselines import BASELINES  # noqa: E402
from unveil_core.evaluate.detail.scores import SPECTRUM_FIGURES  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402

RESULTS = ROOT / "benchmarks/results/planted_holes.json"
BLUR_PX = 4.0
"""Standard deviation of the blur, pixels of the working size, as in ceilings.py: what a guess may be off by to look right."""
REGIONS = ("removed", "seen_elsewhere", "unseen")
DETAILS = ("gradient", *SPECTRUM_FIGURES, "line_recall", "false_lines")


def blurred(photograph: Picture) -> Picture:
    """A photograph (H, W, 3) without its grain and fine lines."""
    return cv2.GaussianBlur(photograph, (0, 0), BLUR_PX)


def row_of(found: dict[str, Any]) -> dict[str, Any]:
    """The figures of a check (see :func:`unveil_core.app.holdout_check.check_footage`) side by side."""
    methods = found["regions"]["removed"]["methods"]
    rivals = [name for name in BASELINES if name in methods and methods[name]["psnr"] is not None]
    best = max(rivals, key=lambda name: methods[name]["psnr"], default=None)
    columns = {"ours": "ours", "best_opencv": best, "blurred": "blurred"}

    def of(region: str, method: str | None) -> dict[str, Any] | None:
        row = found["regions"].get(region, {}).get("methods", {}).get(method)
        if row is None:
            return None
        figures = {"psnr": row["psnr"], "ssim": row["ssim"], "frames": row["frames"]}
        # Of detail the check knows the whole region only.
        return figures | {name: found.get(name, {}).get(method) for name in DETAILS if region == "removed"}

    regions = {
        region: {"pixels": found["regions"][region]["pixels"], **{name: of(region, m) for name, m in columns.items()}}
        for region in REGIONS
        if region in found["regions"]
    }
    flicker = found["flicker"].get("methods", {})

    def apart(one: str, other: str) -> float | None:
        rows = [regions["removed"][name] for name in (one, other)]
        return None if None in rows else round(rows[0]["psnr"] - rows[1]["psnr"], 2)

    return {
        "cars": [{k: car[k] for k in ("along_m", "left_m", "pixels", "psnr")} for car in found["cars"]],
        "frames_with_cars": found["frames"],
        "best_opencv": best,
        "regions": regions,
        "gain_db": apart("ours", "best_opencv"),
        "below_blurred_db": apart("blurred", "ours"),
        "flicker": {m: flicker[m]["absolute"] for m in ("ours", "truth", best) if m in flicker},
        "outside": found["outside"],
        "full_size": found.get("full_size"),
    }


def main() -> None:
    """Check the drive of the command line, and record its row in place of one of the same drive, part and quality."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drive", type=Path)
    parser.add_argument("--cameras", default="", help="of a rig; by default a dataset's front camera")
    parser.add_argument("--frames", default=None, help="A:B:STEP, part of the drive")
    parser.add_argument("--cars", type=int, default=CARS)
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--work-side", type=int, default=None, help="longer side of the images that are worked on, pixels")
    parser.add_argument("--keep", type=Path, default=None, help="keep drive, workspaces and pictures here, to be looked at")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    part = {
        "drive": arguments.drive.resolve().name,
        "cameras": arguments.cameras,
        "frames": arguments.frames,
        "cars_wanted": arguments.cars,
        "quality": arguments.quality,
        "work_side": arguments.work_side,
    }
    settings = RunSettings(
        remove=("vehicle", "human"),
        quality=arguments.quality,
        work_side=arguments.work_side,
        cameras=tuple(name for name in arguments.cameras.split(",") if name),
        frames=arguments.frames,
    )
    load, begun = round(os.getloadavg()[0], 2), time.perf_counter()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        found = check_footage(
            arguments.drive, folder, cars=arguments.cars, settings=settings, references={"blurred": blurred}
        )
    row = {
        **part,
        "commit": program_commit(ROOT),
        "load_before": load,
        "seconds": round(time.perf_counter() - begun, 1),
        **row_of(found),
    }
    print("\n".join(holdout_lines(found)))
    rows = json.loads(arguments.output.read_text())["runs"] if arguments.output.is_file() else []
    kept = [r for r in rows if {k: r[k] for k in part} != part]
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    write_json_atomic(arguments.output, {"machine": machine(), "blur_px": BLUR_PX, "runs": [*kept, row]})


if __name__ == "__main__":
    main()

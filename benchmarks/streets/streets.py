"""Streets that nobody tuned for: whole runs on streets drawn by seed, held against their truth.

    python benchmarks/streets/streets.py --seeds 0-9 [--cache DIR] [--keep DIR] [--quality standard]

Streets that are missing are rendered first (sample_scenes/generators/streets/make_streets.py, which needs Blender's Python
module). Each run is a process of its own. Results go to benchmarks/results/streets.json after every seed, where those of other
seeds and qualities are kept; a plot of all of them (streets.png) lies beside it. So does a sheet (streets.jpg) of the worst
frames of the worst seeds whose pictures may be looked at: of each, the picture of its latest run on this machine, which lies with
the rendered streets. Without ``--seeds`` nothing is run: means, plot and sheet are made anew from what is there.

Of seeds from 28 on nobody looks at pictures, and nothing is chosen by them, but for those that were looked at after their first
run (``SEEN`` in street_figures.py). The first row of each is kept (``first_looks``) when the seed is run again (``runs``), and
the means of first looks count all of them: a mean of those that nobody looked at since would leave out the worst.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
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

from benchmarks.streets.street_figures import BASELINES, FIGURES, Row, may_be_shown, plot, recorded, summarized  # noqa: E402
from sample_scenes.generators.streets.cache import street_folder, version  # noqa: E402
from sample_scenes.generators.streets.make_streets import make, seeds_of  # noqa: E402
from unveil_core.base.files import write_image_atomic, write_json_atomic  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate import run_evaluation  # noqa: E402
from unveil_core.evaluate.delivered import read_delivered  # noqa: E402
from unveil_core.evaluate.pictures import truth_file, truth_mask  # noqa: E402

RESULTS = ROOT / "benchmarks/results/streets.json"
CHANGED = 8
"""Levels of 255 by which a pixel outside of what was removed must differ from its photograph to count as changed."""
BORDER_PX = 4
"""Pixels around removed objects and shadows that do not count as outside."""
LEAST_SHARE = 0.005
"""A frame in which less than this share is removed is not called the worst: a few pixels say little."""
SHEET_ROW_PX, SHEET_ROWS, SHEET_BYTES = 256, 12, 1_000_000
"""Height of a row of the sheet; how many rows it has at most, so that frames stay large enough to tell faults; its size on disk."""


def run_street(drive: Path, workspace: Path, quality: str) -> dict[str, Any]:
    """Run the program on a drive; returns seconds, peak memory, and the error if it failed."""
    shutil.rmtree(workspace, ignore_errors=True)
    command = [sys.executable, "-m", "unveil_core", "run", str(drive), "-o", str(workspace)]
    command += ["--remove", "vehicle,human", "--quality", quality]
    begun = time.perf_counter()
    with tempfile.TemporaryFile("w+") as said:
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said, env=environment)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        found: dict[str, Any] = {
            "seconds": round(time.perf_counter() - begun, 1),
            "processor_seconds": round(usage.ru_utime + usage.ru_stime, 1),
            "peak_memory_mb": round(usage.ru_maxrss / 1024, 1),
        }
        if process.returncode:
            said.seek(0)
            found["error"] = (said.read().strip().splitlines() or [f"exit {process.returncode}"])[-1][-300:]
    return found


def drawn(street: dict[str, Any]) -> dict[str, Any]:
    """What was drawn, in short."""
    rig, section = street["rig"], street["legs"][0]["section"]
    return {
        "course": street["course"]["kind"],
        "turn_degrees": street["course"]["turn_degrees"],
        "character": street["character"],
        "pavement": section["pavement"],
        "light": street["light"]["kind"],
        "sun_degrees": round(street["light"]["elevation"], 1),
        "exposure_drift_stops": round(street["light"]["drift"], 2),
        "size": [rig["width"], rig["height_px"]],
        "cameras": len(rig["cameras"]),
        "fov_degrees": round(rig["fov"], 1),
        "height_m": round(rig["height"], 2),
        "step_m": round(rig["step"], 2),
        "halt": rig["halt"] is not None,
        "lidar_beams": street["lidar"]["beams"],
        "label_noise_px": None if street["label_noise"] is None else round(street["label_noise"]["border"], 2),
        "things": sum(street["counts"].values()),
        "moving": street["moving"],
        "removed_share": street["removed_share"],
    }


def outside(workspace: Path, truth: Path) -> dict[str, float]:
    """How much was changed where nothing was removed and no shadow lies."""
    pixels = changed = 0
    total = 0.0
    for frame in read_imported(workspace / "drive").frames:
        photograph, clean = read_image(frame.image_path), read_delivered(workspace, frame)
        gone = np.zeros(photograph.shape[:2], dtype=bool)
        for name in ("removed", "shadow"):
            mask = truth_mask(truth / name, frame, photograph.shape)
            gone |= mask if mask is not None else False
        size = 2 * BORDER_PX + 1
        beside = cv2.dilate(gone.astype(np.uint8), np.ones((size, size), np.uint8)) == 0
        apart = np.abs(clean.astype(np.int64) - photograph).max(axis=2)[beside]
        pixels, changed, total = pixels + apart.size, changed + int((apart > CHANGED).sum()), total + float(apart.sum())
    return {"changed_share": round(changed / max(pixels, 1), 5), "mean_levels": round(total / max(pixels, 1), 4)}


def scores(workspace: Path, truth: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The figures of a run, and the frame (and its camera) that came out worst."""
    found = run_evaluation(workspace, truth)
    regions = found["truth"]["regions"]

    def of(region: str, method: str = "ours") -> dict[str, Any] | None:
        row = regions.get(region, {}).get("methods", {}).get(method)
        return None if row is None else {k: row.get(k) for k in FIGURES}

    rivals = {name: of("removed", name) for name in BASELINES}
    there = {name: row for name, row in rivals.items() if row is not None}
    best = max(there, key=lambda n: there[n]["psnr"]) if there else None
    flicker = found.get("flicker", {}).get("methods", {})
    row = {
        "removed": of("removed"),
        "unseen": of("unseen"),
        "seen_elsewhere": of("seen_elsewhere"),
        "cast_shadow": of("cast_shadow"),
        "cast_shadow_input": of("cast_shadow", "input"),
        "input": of("removed", "input"),
        "best_opencv": None if best is None else {"row": best, **there[best]},
        "flicker": {m: round(flicker[m]["absolute"], 2) for m in ("ours", "truth", *BASELINES) if m in flicker},
        "free_views": (found.get("free_views") or {}).get("regions", {}).get("free_removed"),
        "certain": {k: found["certainty"].get(k) for k in ("certain", "certain_right")}
        if found.get("certainty")
        else None,
        "removed_mask_iou": found["truth"].get("removed_mask_iou"),
        "outside": outside(workspace, truth),
        "untouched_max": found["untouched"]["max"],
    }
    drive = read_imported(workspace / "drive")
    size = {(f.name, f.camera_name): f.camera.width * f.camera.height for f in drive.frames}
    measured = [
        f
        for f in found["per_frame"]
        if f.get("psnr", {}).get("ours") is not None
        and f["removed_pixels"] > LEAST_SHARE * size[f["frame"], f["camera"]]
    ]
    worst = min(measured, key=lambda f: f["psnr"]["ours"], default=None)
    return row, {} if worst is None else {"frame": worst["frame"], "camera": worst["camera"]}


def pictures(workspace: Path, truth: Path, worst: dict[str, str], caption: str) -> np.ndarray | None:
    """A row of the sheet: what went in, what came out, what is true."""
    frames = [
        f
        for f in read_imported(workspace / "drive").frames
        if worst and (f.name, f.camera_name) == (worst["frame"], worst["camera"])
    ]
    true = truth_file(truth / "images", frames[0]) if frames else None
    if true is None:
        return None
    three = [read_image(frames[0].image_path), read_delivered(workspace, frames[0]), read_image(true)]
    width = SHEET_ROW_PX * 3 // 2
    small = [cv2.resize(p, (width, SHEET_ROW_PX), interpolation=cv2.INTER_AREA) for p in three]
    row = np.hstack([np.pad(p, ((2, 2), (2, 2), (0, 0)), constant_values=255) for p in small])
    for color, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
        cv2.putText(row, caption, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.42, color, thickness, cv2.LINE_AA)
    return row


def picture_file(seed: int, cache: Path | None, quality: str) -> Path:
    """Where a seed's row of the sheet lies from one call to the next: beside the street itself, so that it goes with it."""
    folder = street_folder(seed, cache)
    return folder.with_name(f"{folder.name}_worst_{quality}.jpg")


def sheet_rows(rows: dict[str, Row], cache: Path | None, quality: str) -> list[np.ndarray]:
    """The pictures that lie ready of seeds that may be shown, the worst ones first, ``SHEET_ROWS`` at most."""
    shown = {int(s): r for s, r in rows.items() if may_be_shown(int(s)) and r.get("removed")}
    worst = sorted(shown, key=lambda seed: shown[seed]["removed"]["psnr"])
    there = [p for p in (picture_file(seed, cache, quality) for seed in worst) if p.is_file()]
    return [read_image(path) for path in there[:SHEET_ROWS]]


def write_sheet(rows: list[np.ndarray], path: Path) -> None:
    """The rows below each other as JPEG, as good as a megabyte allows."""
    sheet = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    for quality in range(90, 20, -8):
        encoded = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        if len(encoded) < SHEET_BYTES:
            break
    path.write_bytes(encoded.tobytes())


def read_document(path: Path) -> dict[str, Any]:
    """The rows so far; none where there is no file yet."""
    empty: dict[str, Any] = {"runs": {}, "first_looks": {}, "means": {}}
    return json.loads(path.read_text()) if path.is_file() else empty


def main() -> None:
    """Measure the seeds of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of, default=[])
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument("--keep", type=Path, default=None, help="keep the workspaces here, to be looked at")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    results: Path = arguments.output
    with tempfile.TemporaryDirectory() as temporary:
        for seed in arguments.seeds:
            drive, _ = make(seed, arguments.cache, "usual")
            workspace = Path(arguments.keep or temporary) / f"{seed:04d}"
            row = {
                "generator": version(),
                "commit": program_commit(ROOT),
                "load_before": round(os.getloadavg()[0], 2),
                "drawn": drawn(json.loads((drive / "street.json").read_text())),
            }
            row.update(run_street(drive, workspace, arguments.quality))
            if "error" not in row:
                figures, worst = scores(workspace, drive / "truth")
                row.update(figures, worst=worst)
                caption = (
                    f"{seed} {worst.get('camera', '')} {worst.get('frame', '')}: {row['removed']['psnr']} dB in all"
                )
                shown = pictures(workspace, drive / "truth", worst, caption) if may_be_shown(seed) else None
                if shown is not None:
                    write_image_atomic(picture_file(seed, arguments.cache, arguments.quality), shown)
            # Read anew: another call may have written rows of other seeds meanwhile.
            document = read_document(results)
            recorded(document, arguments.quality, seed, row)
            document["machine"] = machine()
            results.parent.mkdir(parents=True, exist_ok=True)
            write_json_atomic(results, summarized(document, arguments.quality, version()))
            print(seed, row.get("error") or (row["seconds"], row["removed"], row["best_opencv"]), flush=True)
            if not arguments.keep:
                shutil.rmtree(workspace, ignore_errors=True)
    if not results.is_file():
        return
    document = summarized(read_document(results), arguments.quality, version())
    write_json_atomic(results, document)
    rows = {s: r for s, r in document["runs"].get(arguments.quality, {}).items() if r["generator"] == version()}
    plot(rows, results.with_suffix(".png"), f"streets by seed, {arguments.quality}")
    if sheet := sheet_rows(rows, arguments.cache, arguments.quality):
        write_sheet(sheet, results.with_suffix(".jpg"))


if __name__ == "__main__":
    main()

"""Size: whole runs on ever longer drives, time and memory against frames, and whether the borders of blocks show.

    python benchmarks/machine/scale.py --frames 100,300 [--size 480x320] [--quality standard] [--memory 1G]
                                       [--cache DIR] [--keep DIR] [--borders]

The drives are one street of boxes (tests/worlds/long_street.py), of which a longer drive sees more: its first frames are those of
the shorter. Each run is a process of its own, without the report's baselines. Results of other sizes and qualities in
benchmarks/results/scale.json are kept; scale.png draws them. `--borders` runs a drive of several blocks again with blocks of
another length: frames beside a border of the one run lie between borders in the other, so that what differs is the border.
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

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.worlds.box_worlds import make_box_world  # noqa: E402
from tests.worlds.long_street import long_street, long_way  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.pictures.decoding import read_image  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.drives.imported import read_imported  # noqa: E402
from unveil_core.evaluate.detail.scores import StreetDetail, detail_figures  # noqa: E402
from unveil_core.evaluate.metrics import psnr_of_mse, rounded  # noqa: E402
from unveil_core.ground.blocks import BLOCK_M, cut_into_blocks  # noqa: E402
from unveil_core.workspace.files import frame_file, load_mask  # noqa: E402

RESULTS = ROOT / "benchmarks/results/scale.json"
RAYS = 4000
"""Of the LiDAR at each place."""
BESIDE_M = 10.0
"""Frames so near to a border of two blocks lie beside it, metres."""
UNTIL = "mesh"
OTHER_BLOCK_M = 75.0
"""Length of the blocks of the run that a drive's borders are compared with: most of its own lie elsewhere."""


def drive_of(frames: int, size: tuple[int, int], cache: Path) -> Path:
    """The drive, made if it is not there yet."""
    folder = cache / f"long_street_{size[0]}x{size[1]}_{frames}"
    if not (folder / "transforms.json").is_file():
        new = Path(tempfile.mkdtemp(prefix=".long_street_", dir=cache))
        make_box_world(
            new, long_street(float(frames)), long_way(frames, size=size), rays=RAYS, workers=os.cpu_count() or 1
        )
        new.rename(folder)
    return folder


CODE = """
import sys
from pathlib import Path
from unveil_core.pipeline.run import run
from unveil_core.ground import blocks
from unveil_core.pipeline.settings import RunSettings
drive, workspace, quality, memory, until, length = sys.argv[1:]
blocks.BLOCK_M = float(length)
run(Path(drive), Path(workspace), RunSettings(quality=quality, memory=memory, remove=("vehicle",)), until=until)
"""


def run_drive(
    drive: Path, workspace: Path, quality: str, memory: str, *, until: str = UNTIL, block_m: float = BLOCK_M
) -> dict[str, Any]:
    """Run the program; returns seconds, peak memory, and both by stage."""
    command = [sys.executable, "-c", CODE, str(drive), str(workspace), quality, memory, until, str(block_m)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}
    begun = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{drive}: the run ended with {process.returncode}")
    stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    return {
        "seconds": round(time.perf_counter() - begun, 1),
        "processor_seconds": round(usage.ru_utime + usage.ru_stime, 1),
        "peak_memory_mb": round(usage.ru_maxrss / 1024, 1),
        "workspace_mb": round(sum(p.stat().st_size for p in workspace.rglob("*") if p.is_file()) / 2**20, 1),
        "stages": {
            name: {k: s[k] for k in ("seconds", "peak_memory_mb")} for name, s in stages.items() if "seconds" in s
        },
    }


def errors(workspace: Path, truth: Path, frames: str) -> tuple[np.ndarray, np.ndarray]:
    """Squared error and number of values of each frame, over what was removed.

    Args:
        frames: folder of the pictures in the workspace.
    """
    drive = read_imported(workspace / "drive")
    squared, values = np.zeros(len(drive.frames)), np.zeros(len(drive.frames))
    for i, frame in enumerate(drive.frames):
        removed = load_mask(frame_file(workspace / "masks/removed", frame))
        ours, true = (read_image(frame_file(root, frame)) for root in (workspace / frames, truth))
        squared[i] = np.square(ours[removed].astype(float) - true[removed]).sum()
        values[i] = 3 * removed.sum()
    return squared, values


def psnr(squared: np.ndarray, values: np.ndarray) -> float | None:
    """Of the error of some frames together."""
    return round(psnr_of_mse(float(squared.sum() / values.sum()) / 255**2), 3) if values.any() else None


def details(workspace: Path, truth: Path) -> dict[str, float | None]:
    """What PSNR forgives in the clean frames where something was removed: gradient, spectrum, lines and residue.

    Args:
        truth: the folder that has ``images/``.
    """
    scores = []
    for frame in read_imported(workspace / "drive").frames:
        removed = load_mask(frame_file(workspace / "masks/removed", frame))
        ours, true = (read_image(frame_file(root, frame)) for root in (workspace / "frames", truth / "images"))
        street = StreetDetail(truth, frame, true, read_image(frame.image_path), {"removed": removed})
        scores += street.compare(ours).scores.values()
    return rounded(detail_figures(scores))


def beside_borders(workspace: Path, block_m: float) -> tuple[np.ndarray, int]:
    """(F,) which frames lie beside a border of blocks of a length, and how many blocks there are."""
    drive = read_imported(workspace / "drive")
    blocks = cut_into_blocks(drive, block_m)
    places = np.stack([f.camera.centre for f in drive.frames])
    block = blocks.of_places(places)
    change = (places[1:] + places[:-1])[block[1:] != block[:-1]] / 2
    beside = np.zeros(len(places), dtype=bool)
    if len(change):
        beside = np.linalg.norm(places[:, None] - change[None], axis=2).min(axis=1) < BESIDE_M
    return beside, len(blocks.blocks)


def borders(workspace: Path, other: Path, truth: Path) -> dict[str, Any]:
    """PSNR of frames beside a border in one of two runs only: with that border, and without it in the other run."""
    first, second = (errors(root, truth, "inpainted") for root in (workspace, other))
    in_first, in_second = (beside_borders(root, m)[0] for root, m in ((workspace, BLOCK_M), (other, OTHER_BLOCK_M)))
    of_first, of_second = in_first & ~in_second, in_second & ~in_first

    def pooled(*parts: tuple[tuple[np.ndarray, np.ndarray], np.ndarray]) -> float | None:
        return psnr(*(np.concatenate([run[k][some] for run, some in parts]) for k in (0, 1)))

    return {
        "frames": int(of_first.sum() + of_second.sum()),
        "psnr_beside_a_border": pooled((first, of_first), (second, of_second)),
        "psnr_of_the_same_without": pooled((second, of_first), (first, of_second)),
    }


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Time and memory against frames, a line for each size and quality."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(9, 3.4))
    for kind in dict.fromkeys((tuple(r["size"]), r["quality"]) for r in rows):
        some = sorted((r for r in rows if (tuple(r["size"]), r["quality"]) == kind), key=lambda r: r["frames"])
        frames = [r["frames"] for r in some]
        label = f"{kind[0][0]}x{kind[0][1]}, {kind[1]}"
        axes[0].plot(frames, [r["seconds"] / 60 for r in some], "o-", label=label)
        axes[1].plot(frames, [r["peak_memory_mb"] / 1024 for r in some], "o-", label=label)
    for axis, title in zip(axes, ("minutes", "peak memory, GiB"), strict=True):
        axis.set_xlabel("frames")
        axis.set_title(title)
        axis.set_xlim(left=0)
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run the drives that were asked for, and write after each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", required=True, help="as 100,300")
    parser.add_argument("--size", default="480x320")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--memory", default="1G")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--borders", action="store_true", help="run drives of several blocks again with other blocks")
    parser.add_argument("--keep", type=Path, default=None, help="keep the workspaces here")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    width, height = (int(n) for n in arguments.size.split("x"))
    rows = json.loads(arguments.output.read_text())["rows"] if arguments.output.is_file() else []
    for frames in (int(n) for n in arguments.frames.split(",")):
        drive = drive_of(frames, (width, height), arguments.cache)
        folder = arguments.keep or Path(tempfile.mkdtemp(dir=arguments.cache))
        workspace = folder / f"{width}x{height}_{frames}_{arguments.quality}"
        shutil.rmtree(workspace, ignore_errors=True)
        kind = {"frames": frames, "size": [width, height], "quality": arguments.quality, "memory": arguments.memory}
        truth, run = drive / "truth/images", (arguments.quality, arguments.memory)
        row = {**kind, "processor": machine()["processor"], **run_drive(drive, workspace, *run)}
        row["blocks"] = beside_borders(workspace, BLOCK_M)[1]
        row["psnr"] = psnr(*errors(workspace, truth, "frames"))
        row |= details(workspace, drive / "truth")
        if arguments.borders and row["blocks"] > 1:
            other = folder / f"{workspace.name}_other_blocks"
            shutil.rmtree(other, ignore_errors=True)
            run_drive(drive, other, *run, until="inpaint", block_m=OTHER_BLOCK_M)
            row["borders"] = borders(workspace, other, truth)
        rows = [r for r in rows if any(r[k] != v for k, v in kind.items() if k != "memory")] + [row]
        rows.sort(key=lambda r: (r["size"], r["quality"], r["frames"]))
        write_json_atomic(arguments.output, {"machine": machine(), "rows": rows})
        draw(rows, arguments.output.with_suffix(".png"))
        print({k: v for k, v in row.items() if k != "stages"}, flush=True)
        if arguments.keep is None:
            shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()

"""Holes in charts: footprints of removed objects pasted where the street was seen, filled by the project's own fill, without a run.

    python benchmarks/real_drives/chart_holes.py --cache DIR [--drives NAMES] [--workspaces NAME=DIR ...] [--holes 120]
        [--lpips FILE] [--against REV] [--without NAMES] [--tree PATH] [--fresh] [-o FILE]

A whole run measures six holes a drive in ten minutes; here the chart of the ground that a finished workspace has is filled with a
dozen holes at once, a hundred and more a drive. The drives are those that real.py has in its cache, and any workspace
that has gone through ``inpaint``: of a drawn street, say. Charts and holes are kept in the cache, so every revision fills the same
ones: ``--against REV`` a revision of git, ``--tree PATH`` another checkout in place of this one. ``--without NAMES`` compares the
fill without some mechanisms of the stage ``inpaint`` (see docs/command.md) with that with all of them; how the chart is read is no
matter here. What was seen there is the truth.

In benchmarks/results/chart_holes.json, for each drive and tree: PSNR, SSIM, gradient (a ratio to the truth's) and LPIPS of the
holes in the chart, 4 cm a texel. Holes of different sets lie over each other, so figures are averaged over cells of the street
first, and errors are those of the mean over cells; ``comparisons`` has differences paired over cells, ours minus theirs.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.holes import footprints_of, hole_sets, seen_well  # noqa: E402
from benchmarks.real_drives.paired import Figures, clustered, estimate  # noqa: E402
from benchmarks.real_drives.real import ALL, compared, comparison_lines, recorded  # noqa: E402
from benchmarks.real_drives.table import DRIVES  # noqa: E402
from benchmarks.real_drives.trees import Tree, checked_out, environment_of, tree_at, without  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.base.types import Mask, Picture  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.evaluate.holdout.compared import Compared, PartSums, Photograph, crop_around  # noqa: E402
from unveil_core.evaluate.perceptual import LpipsModel  # noqa: E402
from unveil_core.pipeline.mechanisms import MECHANISMS  # noqa: E402

RESULTS = ROOT / "benchmarks/results/chart_holes.json"
SCRIPT = Path(__file__).resolve().parent / "fill_charts.py"
STAGE = "inpaint"
"""The stage whose code fills charts."""
FIGURES = ("psnr", "ssim", "gradient", "lpips")
CELL_M = (5.0, 2.5)
"""Size of the cells that count as one measurement, along and across the street, metres: about a hole."""


@dataclass(frozen=True)
class ChartOf:
    """A chart in the cache.

    Attributes:
        name: of the drive; workspace: where it was read; folder: with ``chart.npz``, ``sets/`` and what each tree made.
    """

    name: str
    workspace: Path
    folder: Path

    @property
    def sets(self) -> Path:
        """Folder of the sets of holes."""
        return self.folder / "sets"


def called(tree: Path, *arguments: str | Path) -> float:
    """Run the script in a tree's environment; returns seconds.

    Raises:
        RuntimeError: it failed.
    """
    begun = time.perf_counter()
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    done = subprocess.run(command, env=environment_of(tree), capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError("\n".join(done.stderr.strip().splitlines()[-3:]))
    return time.perf_counter() - begun


def prepare(chart: ChartOf, count: int, fresh: bool) -> None:
    """Read the chart and make the holes, where the cache does not have them."""
    if fresh:
        shutil.rmtree(chart.folder, ignore_errors=True)
    if not (chart.folder / "chart.npz").is_file():
        called(ROOT, "read", chart.workspace, chart.folder / "chart.npz")
    if chart.sets.is_dir():
        return
    with np.load(chart.folder / "chart.npz") as data:
        texel = float(data["place"][2])
        good = seen_well(data["source"], data["nearest"], data["objects"], texel)
        stamps = footprints_of(data["objects"], texel)
    partial = chart.folder / ".sets"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    for k, made in enumerate(hole_sets(good, stamps, count=count, texel=texel)):
        np.savez_compressed(partial / f"{k:03d}.npz", holes=made.holes, footprint=made.footprint)
    partial.replace(chart.sets)


def filled(chart: ChartOf, tree: Tree) -> tuple[Path, float]:
    """The folder with what a tree made of the sets, from the cache or made; and its seconds."""
    folder = chart.folder / tree.digest
    mark = folder / "run.json"
    if not mark.is_file():
        shutil.rmtree(folder, ignore_errors=True)
        given = (chart.workspace, chart.folder / "chart.npz", chart.sets, folder)
        took = called(tree.root, "fill", *given, *tree.off)
        write_json_atomic(mark, {"tree": tree.name, "seconds": round(took, 1), "load": os.getloadavg()[0]})
    return folder, json.loads(mark.read_text())["seconds"]


def measured(chart: ChartOf, folder: Path, network: LpipsModel | None) -> tuple[dict[str, Figures], dict[str, str]]:
    """Figures by hole, and the cell of each."""
    figures: dict[str, Figures] = {}
    cells: dict[str, str] = {}
    with np.load(chart.folder / "chart.npz") as data:
        truth = np.round(np.clip(data["color"], 0, 1) * 255).astype(np.uint8)
        texel = float(data["place"][2])
        good = seen_well(data["source"], data["nearest"], data["objects"], texel)
    for path in sorted(chart.sets.glob("*.npz")):
        with np.load(path) as data, np.load(folder / path.name) as made:
            holes, color = data["holes"], made["color"]
        for number in np.unique(holes[holes > 0]).tolist():
            hole = holes == number
            key = f"{chart.name} {path.stem}.{number}"
            figures[key] = of_hole(truth, color, hole & good, crop_around(hole), network)
            rows, columns = np.nonzero(hole)
            at = (rows.mean() * texel // CELL_M[0], columns.mean() * texel // CELL_M[1])
            cells[key] = f"{chart.name} {at[0]:.0f},{at[1]:.0f}"
    return figures, cells


def of_hole(
    truth: Picture, color: Picture, part: Mask, around: tuple[slice, slice], network: LpipsModel | None
) -> dict[str, float | None]:
    """Figures of a hole.

    Args:
        truth, color: (A, B, 3) the chart as seen, and as filled; part: (A, B) the hole's texels whose truth is known.
        around: the crop that is compared.
    """
    part = part[around]
    one = Compared.of(Photograph.of(truth[around], part, None), color[around])
    sums, whole = PartSums(), (slice(None), slice(None))
    sums.add(one, part, None if network is None else network(*one.crop(part, whole)))
    found = sums.figures()
    return {name: found.get(name) for name in FIGURES}


def row_of(
    chart: ChartOf, tree: Tree, seconds: float, holes: dict[str, Figures], by_cell: dict[str, Figures]
) -> dict[str, Any]:
    """The row of a drive and a tree."""
    means = {name: estimate([cell.get(name) for cell in by_cell.values()]) for name in FIGURES}
    told = {"drive": chart.name, "quality": "chart", "tree": tree.name, "digest": tree.digest, "seconds": seconds}
    figures = {name: value.to_json() for name, value in means.items() if value is not None}
    return {**told, "holes": len(holes), "cells": len(by_cell), "figures": figures}


def charts_of(cache: Path, drives: str, workspaces: list[str]) -> list[ChartOf]:
    """The charts of the command line.

    Raises:
        SystemExit: one has no workspace.
    """
    found = []
    wanted = [n for n in drives.split(",") if n] or [
        d.name for d in DRIVES if (cache / d.name / "planted.json").is_file()
    ]
    for name, _, given in (text.partition("=") for text in [*([] if drives == "none" else wanted), *workspaces]):
        workspace = Path(given) if given else cache / name / "footage"
        if not (workspace / "inpaint" / "chart.npz").is_file():
            raise SystemExit(f"Not a workspace that has gone through `unveil inpaint`: {workspace}. Run it first.")
        found.append(ChartOf(name, workspace.resolve(), cache / name / "chart_holes"))
    return found


def main() -> None:
    """Fill the holes of the drives of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, required=True, help="of benchmarks/real_drives/real.py; charts are kept here, too")
    parser.add_argument("--drives", default="", help="names in the cache, by default all; none = only --workspaces")
    parser.add_argument("--workspaces", nargs="*", default=[], metavar="NAME=DIR", help="other finished workspaces")
    parser.add_argument("--holes", type=int, default=120, help="of each drive, where there is room")
    parser.add_argument("--lpips", type=Path, default=None, help="an LPIPS network, TorchScript or ONNX")
    parser.add_argument("--against", default=None, metavar="REV", help="a revision of git to compare with")
    parser.add_argument("--tree", type=Path, default=ROOT, help="a checkout to use in place of this one")
    parser.add_argument("--without", default="", metavar="NAMES", help="mechanisms to do without, compared with all")
    parser.add_argument(
        "--fresh", action="store_true", help="read the charts anew, and make other holes if they changed"
    )
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    if arguments.without and arguments.against:
        parser.error("--without compares with this checkout itself: leave --against out")
    known = [name for name, m in MECHANISMS.items() if m.stage == STAGE]
    if unknown := [n for n in arguments.without.split(",") if n and n not in known]:
        parser.error(f"not a mechanism of {STAGE}: {unknown[0]}")
    now, network = machine(), None if arguments.lpips is None else LpipsModel(arguments.lpips)
    with ExitStack() as stack:
        trees = [tree_at(arguments.tree, STAGE)]
        if arguments.against is not None:
            trees.append(stack.enter_context(checked_out(arguments.against, ROOT, STAGE)))
        if arguments.without:
            trees = [without(trees[0], arguments.without.split(",")), trees[0]]
        every: list[dict[str, Figures]] = [{} for _ in trees]
        rows, comparisons = [], []
        for chart in charts_of(arguments.cache, arguments.drives, arguments.workspaces):
            by_cell = []
            try:
                prepare(chart, arguments.holes, arguments.fresh)
                for tree in trees:
                    folder, seconds = filled(chart, tree)
                    holes, cells = measured(chart, folder, network)
                    by_cell.append(clustered(holes, cells))
                    rows.append(row_of(chart, tree, seconds, holes, by_cell[-1]))
                    print(row_line(rows[-1]), flush=True)
            except RuntimeError as error:  # one drive that fails says nothing of the others
                print(f"{chart.name}: {error}", file=sys.stderr, flush=True)
                continue
            for cells_of, own in zip(every, by_cell, strict=True):
                cells_of |= own
            if len(trees) > 1:
                comparisons.append(compared(chart.name, "chart", trees, *by_cell))
        if len(trees) > 1:
            comparisons.append(compared(ALL, "chart", trees, *every))
        print("\n".join(line for c in comparisons for line in comparison_lines(c, of="cells")))
    document = json.loads(arguments.output.read_text()) if arguments.output.is_file() else {}
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    told = {**recorded(document, rows, comparisons), "machine": now}
    write_json_atomic(arguments.output, {**told, "lpips": None if arguments.lpips is None else arguments.lpips.name})


def row_line(row: dict[str, Any]) -> str:
    """A row for the terminal."""
    cells = (
        f"{name} {value['mean']:.3f}" + ("" if value["se"] is None else f" ±{value['se']:.3f}")
        for name, value in row["figures"].items()
    )
    told = f"{row['drive']}, {row['tree']}: {row['holes']} holes in {row['cells']} cells, {row['seconds']:.0f} s"
    return f"{told}: {'  '.join(cells)}"


if __name__ == "__main__":
    main()

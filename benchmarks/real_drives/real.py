"""Real drives with virtual cars planted in front of street that the photographs show, removed by whole runs, and measured.

    python benchmarks/real_drives/real.py --data DIR --cache DIR [--drives NAMES] [--lpips FILE] [--against REV] [--tree PATH]
                              [--without NAMES] [--quality standard] [--cars 6] [--each 6] [--rounds 2] [--plant-only] [-o FILE]

Behind a virtual car the photograph is the truth (``unveil evaluate --holdout-masks``, see unveil_core/evaluate/holdout). Places
differ: near and far, lane, kerb and sidewalk, sun and shade. Planted drives are made once and kept in the cache, so that every
revision is measured on the very same holes, by the code of this checkout. ``--against REV`` runs a revision of git in a worktree of
its own, too; ``--tree PATH`` runs another checkout as it stands in place of this one. Runs that the cache has of the same code,
drive and quality are not repeated. ``--without NAMES`` compares runs without some mechanisms (see docs/command.md) with those with
all of them: they go on from these, from the first stage that differs, so their seconds are of a part only.

In benchmarks/results/real.json, for each drive and tree: means over cars with standard errors, by part (``removed``, ``unseen``,
``seen_elsewhere``), of ours, the best OpenCV row and the photograph blurred by some pixels, which is the ceiling of who guesses all
structure right and no grain; LPIPS is of crops around each car. ``of_drive`` has what changed where nothing should, flicker,
PSNR of frames hidden from the reconstruction, and seconds by stage. ``comparisons`` has by figure the mean difference, ours minus
theirs, paired over cars, with its standard error, of each drive and of all.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.real_drives.measured import BLUR_PX, FIGURES, Measured, means_of, measure  # noqa: E402
from benchmarks.real_drives.paired import Figures, paired  # noqa: E402
from benchmarks.real_drives.planted import KeptRound, planted_rounds  # noqa: E402
from benchmarks.real_drives.table import RealDrive, named  # noqa: E402
from benchmarks.real_drives.trees import Tree, checked_out, run_once, tree_at, without  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine  # noqa: E402
from unveil_core.pipeline.mechanisms import MECHANISMS  # noqa: E402

RESULTS = ROOT / "benchmarks/results/real.json"
ALL = "all"
"""Name of the comparison over the cars of all drives."""


def measured_of(tree: Tree, rounds: list[KeptRound], quality: str, lpips: Path | None) -> list[Measured]:
    """Run a tree on the rounds of a drive, and measure each."""
    return [measure(kept, run_once(tree, kept.drive, kept.runs, quality, kept.arguments), lpips) for kept in rounds]


def cars_of(measured: list[Measured], drive: str = "") -> dict[str, Figures]:
    """Figures of the cars of all rounds, by key."""
    found: dict[str, Figures] = {}
    for k, one in enumerate(measured, 1):
        found |= one.cars(f"{drive}{k}.")
    return found


def row_of(drive: RealDrive, tree: Tree, quality: str, measured: list[Measured]) -> dict[str, Any]:
    """The row of a drive and a tree."""
    told = {"drive": drive.name, "quality": quality, "tree": tree.name, "digest": tree.digest}
    return {**told, "load_before": [one.load for one in measured], **means_of(measured)}


def recorded(document: dict[str, Any], rows: list[dict[str, Any]], comparisons: list[dict[str, Any]]) -> dict[str, Any]:
    """The document with rows in place of those of the same drive, quality and code, and comparisons likewise."""
    for kind, new, names in (
        ("runs", rows, ("drive", "quality", "digest")),
        ("comparisons", comparisons, ("drive", "quality", "ours_digest", "theirs_digest")),
    ):
        keys = [tuple(row[n] for n in names) for row in new]
        kept = [row for row in document.get(kind, []) if tuple(row[n] for n in names) not in keys]
        document[kind] = [*kept, *new]
    return document


def compared(
    drive: str, quality: str, trees: list[Tree], ours: dict[str, Figures], theirs: dict[str, Figures]
) -> dict[str, Any]:
    """A comparison for the results: ours minus theirs."""
    told = {"drive": drive, "quality": quality, "ours": trees[0].name, "theirs": trees[1].name}
    digests = {"ours_digest": trees[0].digest, "theirs_digest": trees[1].digest}
    return {**told, **digests, "figures": {name: found.to_json() for name, found in paired(ours, theirs).items()}}


def whole_drive(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Figures of the drive as a whole, the first row's minus the second's: one drive has no error."""
    ours, theirs = (row["of_drive"] for row in rows)
    both = [n for n in ours if ours[n] is not None and theirs.get(n) is not None]
    return {name: round(ours[name] - theirs[name], 5) for name in both}


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Rows for the terminal."""
    lines = []
    for row in rows:
        lines.append(f"{row['drive']}, {row['quality']}, {row['tree']} ({row['digest']})")
        for part, methods in row["parts"].items():
            for method in ("ours", "best_opencv", "blurred"):
                if figures := methods[method]:
                    cells = (f"{name} {_cell(figures.get(name))}" for name in FIGURES)
                    lines.append(f"  {part:<15}{method:<13}" + "  ".join(cells))
        lines.append("  " + ", ".join(f"{k} {v}" for k, v in row["of_drive"].items() if v is not None))
    return lines


def comparison_lines(comparison: dict[str, Any], of: str = "cars") -> list[str]:
    """A comparison for the terminal; of: what it is paired over."""
    lines = [f"{comparison['drive']}, {comparison['quality']}: {comparison['ours']} minus {comparison['theirs']}"]
    for name, found in comparison["figures"].items():
        lines.append(f"  {name:<28}{_cell(found):>20}  of {found['count']} {of}")
    for name, difference in comparison.get("of_drive", {}).items():
        lines.append(f"  {name:<28}{difference:>20}")
    return lines


def _cell(found: dict[str, Any] | None) -> str:
    if found is None:
        return "-"
    return f"{found['mean']:.3f}" + ("" if found["se"] is None else f" ±{found['se']:.3f}")


def main() -> None:
    """Measure the drives of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    given = os.environ.get("UNVEIL_REAL_DRIVES")
    parser.add_argument("--data", type=Path, default=given, required=given is None, help="or $UNVEIL_REAL_DRIVES")
    parser.add_argument("--cache", type=Path, required=True, help="planted drives and runs are kept here")
    parser.add_argument("--drives", default="", help="names with commas between, by default all")
    parser.add_argument("--lpips", type=Path, default=None, help="an LPIPS network, TorchScript or ONNX")
    parser.add_argument("--against", default=None, metavar="REV", help="a revision of git to compare with")
    parser.add_argument("--tree", type=Path, default=ROOT, help="a checkout to run in place of this one")
    parser.add_argument("--without", default="", metavar="NAMES", help="mechanisms to do without, compared with all")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--cars", type=int, default=6, help="in all rounds, where there is room")
    parser.add_argument("--each", type=int, default=6, help="most of a round")
    parser.add_argument("--rounds", type=int, default=2, help="most planted drives of a drive")
    parser.add_argument("--plant-only", action="store_true", help="make the planted drives, run nothing on them")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    if arguments.without and arguments.against:
        parser.error("--without compares with this checkout itself: leave --against out")
    if unknown := [n for n in arguments.without.split(",") if n and n not in MECHANISMS]:
        parser.error(f"not a mechanism: {unknown[0]}")
    quality, now = arguments.quality, machine()
    with ExitStack() as stack:
        trees = [] if arguments.plant_only else [tree_at(arguments.tree)]
        if arguments.against is not None:
            trees.append(stack.enter_context(checked_out(arguments.against, ROOT)))
        if arguments.without and trees:
            trees = [without(trees[0], arguments.without.split(",")), trees[0]]
        cars: list[dict[str, Figures]] = [{}, {}]
        for drive in named(arguments.drives):
            rounds = planted_rounds(
                drive,
                arguments.data,
                arguments.cache,
                quality="standard",
                wanted=arguments.cars,
                each=arguments.each,
                rounds=arguments.rounds,
            )
            print(f"{drive.name}: {sum(len(r.cars) for r in rounds)} cars in {len(rounds)} rounds", flush=True)
            try:
                found = [measured_of(tree, rounds, quality, arguments.lpips) for tree in trees]
            except RuntimeError as error:  # one drive that fails says nothing of the others
                print(f"{drive.name}: {error}", file=sys.stderr, flush=True)
                continue
            rows = [row_of(drive, tree, quality, one) for tree, one in zip(trees, found, strict=True)]
            comparisons = []
            for k, one in enumerate(found):
                cars[k] |= cars_of(one, f"{drive.name} ")
            if len(trees) > 1:
                own = compared(drive.name, quality, trees, *(cars_of(one) for one in found))
                comparisons.append({**own, "of_drive": whole_drive(rows)})
                comparisons.append(compared(ALL, quality, trees, *cars))
            print("\n".join([*table(rows), *(line for c in comparisons for line in comparison_lines(c))]), flush=True)
            if trees:
                document = json.loads(arguments.output.read_text()) if arguments.output.is_file() else {}
                arguments.output.parent.mkdir(parents=True, exist_ok=True)
                told = {**recorded(document, rows, comparisons), "machine": now, "blur_px": BLUR_PX}
                told["lpips"] = None if arguments.lpips is None else arguments.lpips.name
                write_json_atomic(arguments.output, told)


if __name__ == "__main__":
    main()

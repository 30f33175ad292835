"""What single mechanisms of the method are worth: each switched off by itself, on streets by seed.

    python benchmarks/streets/special_cases.py --seeds 0-9 [--cases NAMES | all] [--quality standard] [--cache DIR] [--keep DIR]
    python benchmarks/streets/special_cases.py --list

A street is run once with everything on, up to its frames. For each case a copy of that workspace is run again without it
(``RunSettings.without``), from the stage that the case belongs to, be that the reconstruction; what comes out the same is not
made again. In benchmarks/results/special_cases.json, for each seed: figures of the removed region with everything on (``all_on``),
and by case what they are without it, with ``change``, without minus with: a case that pays has a negative change of ``psnr`` and
``line_recall``. The change of ``seconds`` is of the stages from the case's first one up to the frames. ``means`` has the mean
change by case, and on how many streets it changed anything: none where these streets, which have a LiDAR, do not call for it.
Held-out seeds are refused. ``--list`` names all mechanisms with the lines of code that go with each, most first.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.streets.street_figures import FIGURES, may_be_shown  # noqa: E402
from sample_scenes.generators.streets.cache import version  # noqa: E402
from sample_scenes.generators.streets.make_streets import make, seeds_of  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.evaluate import run_evaluation  # noqa: E402
from unveil_core.pipeline.graph import STAGES  # noqa: E402
from unveil_core.pipeline.mechanisms import MECHANISMS, Mechanism  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.runner import run_stages  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402
from unveil_core.workspace.workspace import Workspace  # noqa: E402

RESULTS = ROOT / "benchmarks/results/special_cases.json"
LAST = "deliver"
"""The stage that writes the frames."""
FIRST = next(stage.name for stage in STAGES if any(m.stage == stage.name for m in MECHANISMS.values()))
"""The first stage that a case belongs to."""
ALL_ON = "all_on"


def lines_of(mechanism: Mechanism) -> int:
    """Lines of code that go with a mechanism."""
    total = 0
    for part in mechanism.apply:
        module, _, name = part.partition(":")
        text = (ROOT / "unveil_core" / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")
        if not name:
            total += len(text.splitlines())
            continue
        nodes = ast.parse(text).body
        for piece in name.split("."):
            node = next(n for n in nodes if getattr(n, "name", "") == piece)
            nodes = getattr(node, "body", [])
        total += (node.end_lineno or node.lineno) - node.lineno + 1
    return total


def listed() -> list[str]:
    """The mechanisms, a line each: lines of code, name, stage, what it does."""
    rows = sorted(((lines_of(m), m) for m in MECHANISMS.values()), key=lambda row: -row[0])
    return [f"{lines:5} {m.name:22} {m.stage:12} {m.says}" for lines, m in rows]


def stages_from(first: str) -> list[str]:
    """Names of the stages from one up to the frames."""
    names = [stage.name for stage in STAGES]
    return names[names.index(first) : names.index(LAST) + 1]


def work(drive: Path, workspace: Path, quality: str, case: str) -> None:
    """Run a drive up to its frames, or what of a finished workspace is different without a case."""
    settings = RunSettings(remove=("vehicle", "human"), quality=quality)
    if case == ALL_ON:
        run(drive, workspace, settings, until=LAST)
        return
    names = stages_from(MECHANISMS[case].stage)
    stages = [stage for stage in STAGES if stage.name in names]
    run_stages(Workspace.open(workspace), stages, replace(settings, without=(case,)), drive)


def in_a_process(drive: Path, workspace: Path, quality: str, case: str) -> None:
    """:func:`work` in a process of its own, whose memory and seconds are its own."""
    command = [sys.executable, __file__, "--work", case, str(drive), str(workspace), "--quality", quality]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_WAIT_POLICY": "PASSIVE"}
    subprocess.run(command, check=True, env=environment)


def figures_of(workspace: Path, truth: Path) -> dict[str, Any]:
    """Figures of the removed region, and the seconds of each stage."""
    found = run_evaluation(workspace, truth, baselines=False)
    ours = found["truth"]["regions"]["removed"]["methods"]["ours"]
    stages = json.loads((workspace / "workspace.json").read_text())["stages"]
    return {
        **{name: ours.get(name) for name in FIGURES},
        "seconds": {name: stages[name]["seconds"] for name in stages_from(FIRST)},
    }


def change(of: dict[str, Any], base: dict[str, Any], stages: list[str]) -> dict[str, float | None]:
    """Figures without a case minus those with it; seconds of some stages."""
    found: dict[str, float | None] = {
        name: None if None in (of.get(name), base.get(name)) else round(of[name] - base[name], 4) for name in FIGURES
    }
    found["seconds"] = round(sum(of["seconds"][s] - base["seconds"][s] for s in stages), 1)
    return found


def means(seeds: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """By case, the mean change over seeds, and on how many it changed any figure."""
    found = {}
    for case in dict.fromkeys(case for rows in seeds.values() for case in rows if case != ALL_ON):
        rows = [rows[case]["change"] for rows in seeds.values() if case in rows]
        values = {name: [r[name] for r in rows if r.get(name) is not None] for name in (*FIGURES, "seconds")}
        found[case] = {
            "streets": len(rows),
            "changed": sum(any(r.get(name) for name in FIGURES) for r in rows),
            **{name: round(float(np.mean(v)), 4) if v else None for name, v in values.items()},
        }
    return found


def main() -> None:
    """Measure the cases of the command line on its seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds_of, default=[])
    parser.add_argument("--cases", default="houses,quilting,facades,path_ahead", help="names, or all")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument(
        "--keep", type=Path, default=None, help="keep workspaces here, and take up those of earlier calls"
    )
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    parser.add_argument("--list", action="store_true", help="name all mechanisms, with their lines of code")
    parser.add_argument("--work", nargs=3, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.work:
        case, drive, workspace = arguments.work
        work(Path(drive), Path(workspace), arguments.quality, case)
        return
    if arguments.list:
        print("\n".join(listed()))
        return
    cases = list(MECHANISMS) if arguments.cases == "all" else arguments.cases.split(",")
    if unknown := [c for c in cases if c not in MECHANISMS]:
        parser.error(f"unknown case {unknown[0]}: use {', '.join(MECHANISMS)}")
    if held := [s for s in arguments.seeds if not may_be_shown(s)]:
        parser.error(f"seed {held[0]} is held out: nothing is chosen by it")
    with tempfile.TemporaryDirectory() as temporary:
        for seed in arguments.seeds:
            measure(seed, cases, arguments, arguments.keep or Path(temporary))


def measure(seed: int, cases: list[str], arguments: argparse.Namespace, folder: Path) -> None:
    """Run a seed with everything on and without each case, and record each row as it comes."""
    drive, _ = make(seed, arguments.cache, "usual")
    whole = folder / f"{seed:04d}"
    in_a_process(drive, whole, arguments.quality, ALL_ON)
    base = figures_of(whole, drive / "truth")
    record(arguments, seed, ALL_ON, base)
    for case in cases:
        copy = folder / f"{seed:04d}_without_{case}"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(whole, copy, ignore=shutil.ignore_patterns(".lock"))
        load = round(os.getloadavg()[0], 2)
        in_a_process(drive, copy, arguments.quality, case)
        row = figures_of(copy, drive / "truth")
        row |= {"load_before": load, "change": change(row, base, stages_from(MECHANISMS[case].stage))}
        record(arguments, seed, case, row)
        print(seed, case, row["change"], flush=True)
        if not arguments.keep:
            shutil.rmtree(copy)
    if not arguments.keep:
        shutil.rmtree(whole)


def record(arguments: argparse.Namespace, seed: int, name: str, row: dict[str, Any]) -> None:
    """Write a row beside those that are there; a new one with everything on takes away what was compared with the last."""
    output: Path = arguments.output
    document = json.loads(output.read_text()) if output.is_file() else {"runs": {}}
    seeds = document["runs"].setdefault(arguments.quality, {})
    row = {"generator": version(), "commit": program_commit(ROOT), **row}
    if name == ALL_ON and seeds.get(str(seed), {}).get(ALL_ON) != row:
        seeds[str(seed)] = {}
    seeds.setdefault(str(seed), {})[name] = row
    document["runs"][arguments.quality] = dict(sorted(seeds.items(), key=lambda item: int(item[0])))
    document.setdefault("means", {})[arguments.quality] = means(document["runs"][arguments.quality])
    if name in MECHANISMS:
        document.setdefault("cases", {})[name] = MECHANISMS[name].says
    document["machine"] = machine()
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json_atomic(output, document)


if __name__ == "__main__":
    main()

"""What the special cases of inpainting are worth: each switched off by itself, on streets by seed.

    python benchmarks/streets/special_cases.py --seeds 0-9 [--cases houses,facades] [--quality standard] [--cache DIR] [--keep DIR]

A street is run once with everything on, up to its frames. For each case a copy of that workspace is run again from the first stage
that the case belongs to, in a process in which the case's functions do nothing; what comes out the same is not made again. In
benchmarks/results/special_cases.json, for each seed: figures of the removed region with everything on (``all_on``), and by case
what they are without it, with ``change``, without minus with: a case that pays has a negative change of ``psnr`` and
``line_recall``. The change of ``seconds`` is of the stages from the case's first one up to the frames. ``means`` has the mean
change by case, and on how many streets it changed anything. Held-out seeds are refused.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.streets.street_figures import FIGURES, may_be_shown  # noqa: E402
from sample_scenes.generators.streets.cache import version  # noqa: E402
from sample_scenes.generators.streets.make_streets import make, seeds_of  # noqa: E402
from unveil_core.base.files import write_json_atomic  # noqa: E402
from unveil_core.bench.timing import machine, program_commit  # noqa: E402
from unveil_core.evaluate import run_evaluation  # noqa: E402
from unveil_core.inpaint.facade.facade_chart import InventedFacades  # noqa: E402
from unveil_core.pipeline.graph import STAGES  # noqa: E402
from unveil_core.pipeline.run import run  # noqa: E402
from unveil_core.pipeline.runner import run_stages  # noqa: E402
from unveil_core.pipeline.settings import RunSettings  # noqa: E402
from unveil_core.workspace.workspace import Workspace  # noqa: E402

RESULTS = ROOT / "benchmarks/results/special_cases.json"
LAST = "deliver"
"""The stage that writes the frames, which are measured."""
ALL_ON = "all_on"
INPAINT = "unveil_core.inpaint"


@dataclass(frozen=True)
class Case:
    """A special case, and how it is switched off.

    Attributes:
        says: what it does, in short.
        off: by ``module:function``, as the caller's module knows it, what takes its place.
        stage: the first stage that it belongs to.
    """

    says: str
    off: dict[str, Callable[..., Any]]
    stage: str = "inpaint"


def nothing(*_: Any, **__: Any) -> None:
    """Nothing is found."""


CASES = {
    "houses": Case(
        "houses are solid columns in the shadow map, flush with their facades, and go on beyond the drive's ends",
        {
            f"{INPAINT}.light.scene_light:solid_columns": lambda chart, surfels, *_, **__: surfels.select(
                torch.zeros(len(surfels), dtype=torch.bool)
            ),
            f"{INPAINT}.light.scene_light:flush_with_facades": lambda chart, surfels, *_, **__: np.ones(
                len(surfels), dtype=bool
            ),
        },
    ),
    "barriers": Case(
        "hedges, garden walls and fences go on behind cars", {f"{INPAINT}.upright:read_barriers": nothing}
    ),
    "quilting": Case(
        "invented ground gets the texture of seen ground",
        {
            f"{INPAINT}.fill.texture:quilt": lambda detail, *_, **__: np.zeros_like(detail),
            # Which lays the texture of the neighbours where no patch came from, and would do so everywhere.
            f"{INPAINT}.fill.texture:_beside_what_is_known": lambda quilted, *_, **__: quilted,
        },
    ),
    "facades": Case(
        "facades are completed by other parts of themselves, and the sky over them",
        {
            f"{INPAINT}.upright:invented_facades": lambda chart, **_: InventedFacades(
                None, None, None, np.zeros_like(chart.known)
            )
        },
    ),
    "path_ahead": Case(
        "the street is followed ahead of the last camera by what is seen of it; else it goes on as the camera drove",
        {"unveil_core.pipeline.steps.ground:path_ahead": lambda ground, *_, **__: ground.path},
        stage="ground",
    ),
}


@contextmanager
def switched_off(case: Case) -> Iterator[None]:
    """The functions of a case do nothing."""
    before = []
    try:
        for target, instead in case.off.items():
            name, _, function = target.partition(":")
            module = import_module(name)
            before.append((module, function, getattr(module, function)))
            setattr(module, function, instead)
        yield
    finally:
        for module, function, original in before:
            setattr(module, function, original)


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
    names = stages_from(CASES[case].stage)
    # The variant tells its result from the one with everything on; later stages tell theirs by what they read.
    stages = [
        replace(s, variant=f"without {case}" if s.name == names[0] else s.variant) for s in STAGES if s.name in names
    ]
    with switched_off(CASES[case]):
        run_stages(Workspace.open(workspace), stages, settings, drive)


def in_a_process(drive: Path, workspace: Path, quality: str, case: str) -> None:
    """:func:`work` in a process of its own: what is switched off there is on here."""
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
        "seconds": {name: stages[name]["seconds"] for name in stages_from("ground")},
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
    for case in CASES:
        rows = [rows[case]["change"] for rows in seeds.values() if case in rows]
        if not rows:
            continue
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
    parser.add_argument("--cases", default=",".join(CASES))
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "high"))
    parser.add_argument("--cache", type=Path, default=None)
    parser.add_argument(
        "--keep", type=Path, default=None, help="keep workspaces here, and take up those of earlier calls"
    )
    parser.add_argument("-o", "--output", type=Path, default=RESULTS)
    parser.add_argument("--work", nargs=3, default=None, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.work:
        case, drive, workspace = arguments.work
        work(Path(drive), Path(workspace), arguments.quality, case)
        return
    cases = arguments.cases.split(",")
    if unknown := [c for c in cases if c not in CASES]:
        parser.error(f"unknown case {unknown[0]}: use {', '.join(CASES)}")
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
        row |= {"load_before": load, "change": change(row, base, stages_from(CASES[case].stage))}
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
    document["cases"] = {name: case.says for name, case in CASES.items()}
    document["machine"] = machine()
    output.parent.mkdir(parents=True, exist_ok=True)
    write_json_atomic(output, document)


if __name__ == "__main__":
    main()

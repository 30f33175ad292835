"""One whole run on a drive, stage by stage: seconds, processor seconds, memory, how busy each core was; beside the last such run.

A stage that works on one core leaves the others idle: which one that is tells where a run is serial. The file of results keeps the
runs before, so each stands beside the last one.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import read_own_json
from unveil_core.bench.timing import core_seconds, machine, processor_seconds, program_commit
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Reporter, silent

__all__ = ["bench_run", "rows_in", "run_table"]

KEPT = 50
"""Runs that a file keeps, of all drives: the oldest go."""
LARGEST = 1 << 24
"""Bytes of a file of results."""
FIGURES = ("seconds", "processor_seconds", "peak_memory_mb")


@dataclass
class _Meter:
    """What a run's events tell of its stages.

    Attributes:
        passed_on: receives the events, too; stages: by name, JSON-able, those that have ended.
    """

    passed_on: Reporter
    stages: dict[str, dict[str, Any]] = field(default_factory=dict)
    _begun: dict[str, tuple[float, float, list[float]]] = field(default_factory=dict)

    def __call__(self, event: dict[str, object]) -> None:
        """Take an event in."""
        name, message = str(event.get("stage")), event.get("message")
        if message == "started":
            self._begun[name] = (time.monotonic(), processor_seconds(), core_seconds())
        elif message == "done" and name in self._begun:
            begun, worked, cores = self._begun.pop(name)
            seconds = max(time.monotonic() - begun, 1e-3)
            self.stages[name] = {
                "seconds": round(seconds, 2),
                "processor_seconds": round(processor_seconds() - worked, 2),
                "cores": [round(min((b - a) / seconds, 1.0), 2) for a, b in zip(cores, core_seconds(), strict=True)],
            }
        self.passed_on(event)


def bench_run(
    drive: Path,
    settings: RunSettings,
    *,
    until: str | None = None,
    before: Sequence[Mapping[str, Any]] = (),
    reporter: Reporter = silent,
) -> dict[str, Any]:
    """Run everything on a drive in a workspace that is gone afterwards, and measure it.

    Args:
        drive: any; settings: of the run; until: the last stage, None = all.
        before: rows of earlier runs, see :func:`rows_in`; this one is put behind them.
        reporter: receives the events of the run.
    Returns:
        JSON-able: ``rows``, each with machine, commit of the program, drive, quality, frames, size and stages. Of a stage: seconds;
        processor seconds of all threads; peak memory so far, MB; and ``cores``, the share of its time in which each core was busy,
        whoever kept it so.
    Raises:
        UnveilError: see :func:`unveil_core.pipeline.run.run`.
    """
    meter, here = _Meter(reporter), machine()
    with tempfile.TemporaryDirectory() as folder:
        workspace = run(drive, Path(folder) / "workspace", settings, until=until, yes=True, reporter=meter)
        recorded = workspace.state()["stages"]
        frames = read_imported(workspace.drive_dir, points=False).frames
    for name, stage in meter.stages.items():
        stage["peak_memory_mb"] = recorded[name]["peak_memory_mb"]
    row = {
        "machine": here,
        "commit": program_commit(Path(__file__).parents[2]),
        "drive": (drive.parent if drive.suffix == ".json" else drive).absolute().name,
        "quality": settings.quality,
        "frames": len(frames),
        "size": [frames[0].camera.width, frames[0].camera.height],
        "stages": meter.stages,
    }
    return {"rows": [*before, row][-KEPT:]}


def rows_in(path: Path | None) -> list[dict[str, Any]]:
    """The rows of a file of results; none where there is no file yet.

    Raises:
        SettingsError: the file holds something else.
    """
    if path is None or not path.is_file():
        return []
    try:
        rows = read_own_json(path, LARGEST)["rows"]
        for row in rows:
            for stage in row["stages"].values():
                float(stage["seconds"]), float(stage["processor_seconds"]), float(stage["peak_memory_mb"])
            str(row["drive"]), str(row["quality"]), int(row["frames"]), row["machine"].get("processor")
        return list(rows)
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise SettingsError(
            f"Not results of `unveil bench run`: {error}", path=path, mend="name another file with -o"
        ) from error


def run_table(measured: Mapping[str, Any]) -> str:
    """The last row as text, beside the last one before it of the same drive, quality and frames."""
    *earlier, row = measured["rows"]
    same = ("drive", "quality", "frames")
    last = next((r for r in reversed(earlier) if all(r[k] == row[k] for k in same)), None)
    lines = [f"{row['drive']}, {row['quality']}, {row['frames']} frames of {row['size'][0]}x{row['size'][1]}"]
    if last is not None:
        there = "" if last["machine"].get("processor") == row["machine"].get("processor") else ", on another machine"
        lines[0] += f"; before: {last.get('commit') or 'the last run'}{there}"
    lines.append(
        f"{'stage':<14}{'seconds':>10}{'processor':>12}{'MB':>8}{'before':>10}{'processor':>12}{'MB':>8}  cores"
    )
    stages = {**row["stages"], "all": _whole(row["stages"])}
    old = {} if last is None else {**last["stages"], "all": _whole(last["stages"])}
    for name, stage in stages.items():
        cells = "".join(_cell(stage.get(k), w) for k, w in zip(FIGURES, (10, 12, 8), strict=True))
        cells += "".join(_cell(old.get(name, {}).get(k), w) for k, w in zip(FIGURES, (10, 12, 8), strict=True))
        cores = " ".join(f"{share:.0%}" for share in stage.get("cores", ()))
        lines.append(f"{name:<14}{cells}  {cores}".rstrip())
    return "\n".join(lines)


def _whole(stages: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The sums of all stages, and the highest peak."""
    seconds, processor, peak = ([float(stage[name]) for stage in stages.values()] for name in FIGURES)
    return {"seconds": sum(seconds), "processor_seconds": sum(processor), "peak_memory_mb": max(peak, default=0.0)}


def _cell(value: float | None, width: int) -> str:
    return f"{'' if value is None else format(value, '.1f'):>{width}}"

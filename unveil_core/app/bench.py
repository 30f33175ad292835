"""``unveil bench``: measures, writes JSON and the plot, prints the table."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from unveil_core.app.console import reporting
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.single_files import Receipts, of_user, whole_file
from unveil_core.base.output.written import GENERATOR
from unveil_core.pipeline.output_place import check_file_place
from unveil_core.pipeline.settings import RunSettings

__all__ = ["run_bench"]


def run_bench(arguments: argparse.Namespace) -> int:
    """Run the benchmark that the command line asks for."""
    output, plot = arguments.output, arguments.what in _PLOTS
    receipts = of_user(replace=arguments.replace)
    files = [] if output is None else _checked_output(arguments, receipts, plot)
    measured = _BENCHMARKS[arguments.what](arguments)
    if output is not None:
        with whole_file(output, receipts) as made:
            write_json_atomic(made, {"generator": GENERATOR, "files": files, **measured})
        if plot:
            with whole_file(output.with_suffix(".png"), receipts) as made:
                _PLOTS[arguments.what](measured, made)
    if arguments.json or arguments.what not in _TABLES:
        print(json.dumps(measured, indent=None if arguments.json else 1))
    else:
        print(_TABLES[arguments.what](measured))
    return 0


def _checked_output(arguments: argparse.Namespace, receipts: Receipts, plot: bool) -> list[str]:
    """The names of the files beside the JSON. Before anything is measured it is seen to that where they are to be written there is
    nothing yet, or an older measurement with its plot."""
    output: Path = arguments.output
    if output.is_dir() or output.suffix == ".png":
        raise SettingsError("Not the name of a JSON file", path=output, mend="name one with -o, as bench.json")
    check_file_place(output, [] if arguments.drive is None else [arguments.drive])
    plots = [output.with_suffix(".png")] * plot
    for place in (output, *plots):
        receipts.check(place)
    return [p.name for p in plots]


def _raster(arguments: argparse.Namespace) -> dict[str, Any]:
    from unveil_core.bench.raster import Plan, bench_raster

    plan = Plan(yardstick=_yardstick(arguments))
    if arguments.quick:
        plan = replace(
            plan,
            size=(96, 64),
            count=3000,
            rounds=2,
            counts=(1000, 3000),
            sizes=((48, 32), (96, 64)),
            tiles=4,
            small=(48, 32),
            small_count=300,
        )
    plan = replace(plan, size=arguments.size or plan.size, count=arguments.surfels or plan.count)

    def progress(done: int, total: int, message: str = "", **_: float) -> None:
        print(f"\rsweep {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)

    return bench_raster(plan, progress=progress)


def _step(arguments: argparse.Namespace) -> dict[str, Any]:
    from unveil_core.bench.step import bench_step

    yardstick = _yardstick(arguments)
    if arguments.quick:
        return bench_step(size=(96, 64), count=3000, iterations=3, yardstick=yardstick)
    size, count = arguments.size or (480, 320), arguments.surfels or 100_000
    return bench_step(size=size, count=count, yardstick=yardstick)


def _yardstick(arguments: argparse.Namespace) -> Any:
    from unveil_core.bench.rivals import Yardstick

    return Yardstick(arguments.yardstick) if arguments.yardstick else None


def _reconstruction(arguments: argparse.Namespace) -> dict[str, Any]:
    from unveil_core.bench.reconstruction import bench_reconstruction

    return bench_reconstruction(
        arguments.drive,
        quality=arguments.quality,
        every=arguments.every,
        without=arguments.without,
        variant=arguments.variant,
        salt=arguments.salt,
    )


def _pipeline(arguments: argparse.Namespace) -> dict[str, Any]:
    from unveil_core.bench.pipeline import bench_pipeline

    settings = RunSettings(
        quality=arguments.quality,
        inpainter=arguments.inpainter,
        seed=arguments.seed,
        reference_inpainter=arguments.reference_inpainter,
    )
    with reporting(False) as reporter:  # on standard error; the result is what goes to standard output
        return bench_pipeline(
            arguments.drive,
            settings,
            rows=arguments.rows,
            scene=arguments.scene,
            keep=arguments.keep,
            reporter=reporter,
        )


def _run(arguments: argparse.Namespace) -> dict[str, Any]:
    from unveil_core.bench.whole_run import bench_run, rows_in

    rows = rows_in(arguments.output)
    settings = RunSettings(quality=arguments.quality, seed=arguments.seed)
    with reporting(False) as reporter:
        return bench_run(arguments.drive, settings, until=arguments.until, before=rows, reporter=reporter)


_BENCHMARKS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "raster": _raster,
    "step": _step,
    "reconstruction": _reconstruction,
    "pipeline": _pipeline,
    "run": _run,
}


def _plot_raster(measured: dict[str, Any], path: Path) -> None:
    from unveil_core.bench.raster import write_plot

    write_plot(measured, path)


def _plot_pipeline(measured: dict[str, Any], path: Path) -> None:
    from unveil_core.bench.pipeline import write_pipeline_plot

    write_pipeline_plot(measured, path)


_PLOTS: dict[str, Callable[[dict[str, Any], Path], None]] = {"raster": _plot_raster, "pipeline": _plot_pipeline}


def _raster_table(measured: dict[str, Any]) -> str:
    lines = [
        "forward and backward, {}x{}, {:,} surfels".format(*measured["knobs"]["size"], measured["knobs"]["surfels"])
    ]
    lines += [f"{'':<36}{'ms':>9}{'least':>9}{'ratio':>8}{'rgb':>10}{'planes':>10}{'gradients':>11}"]
    for row in measured["knobs"]["forward_and_backward"]:
        errors = [row.get(name) for name in ("rgb_error", "plane_error", "gradient_error")]
        cells = "".join(
            f"{'' if e is None else format(e, '.1e'):>{w}}" for e, w in zip(errors, (10, 10, 11), strict=True)
        )
        lines.append(f"{row['name']:<36}{row['ms']:>9.1f}{row['least_ms']:>9.1f}{row.get('ratio', 1.0):>8.2f}{cells}")
    lines.append(
        "slow rivals, {}x{}, {:,} surfels".format(*measured["rivals"][0]["size"], measured["rivals"][0]["surfels"])
    )
    lines += [f"{row['name']:<46}{row['ms']:>9.1f} ms{row['ratio']:>9.1f}x" for row in measured["rivals"]]
    return "\n".join(lines)


def _pipeline_table(measured: dict[str, Any]) -> str:
    from unveil_core.evaluate.detail.scores import DETAIL_FIGURES

    lines = [
        f"{measured['drive']}, {measured['quality']}, {measured['frames']} frames of {measured['size'][0]}x{measured['size'][1]}"
    ]
    heads = (
        ("seconds", 9), ("own", 9), ("MB", 7), ("PSNR", 7), ("SSIM", 7), ("unseen", 8), ("elsewhere", 11),
        ("gradient", 10), ("2-4px", 7), ("4-8px", 7), ("8-16px", 8), ("lines", 7), ("false", 7), ("residue", 9),
    )  # fmt: skip
    lines.append(f"{'':<42}" + "".join(f"{head:>{width}}" for head, width in heads))
    for row in measured["rows"]:
        if "regions" not in row:
            lines.append(f"{row['title']:<42}{row['status']:>20}  ({row['mend']})")
            continue
        of = row["regions"]
        values = (
            row["seconds"],
            row["own_seconds"],
            row["peak_memory_mb"],
            *(
                of.get(region, {}).get(figure)
                for region, figure in (
                    ("removed", "psnr"),
                    ("removed", "ssim"),
                    ("unseen", "psnr"),
                    ("seen_elsewhere", "psnr"),
                    *(("removed", figure) for figure in DETAIL_FIGURES),
                )
            ),
        )
        digits = (1, 1, 0, 1, 2, 1, 1, 2, 2, 2, 2, 2, 2, 3)
        cells = "".join(
            f"{'' if v is None else format(v, f'.{d}f'):>{width}}"
            for v, d, (_, width) in zip(values, digits, heads, strict=True)
        )
        lines.append(f"{row['title']:<42}{cells}")
    return "\n".join(lines)


def _run_table(measured: dict[str, Any]) -> str:
    from unveil_core.bench.whole_run import run_table

    return run_table(measured)


_TABLES = {"raster": _raster_table, "pipeline": _pipeline_table, "run": _run_table}
"""How the benchmarks with many rows are printed where no JSON is asked for."""

"""``unveil bench``: measures, writes JSON and the plot, prints the table."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from typing import Any

from unveil_core.base.files import write_json_atomic

__all__ = ["run_bench"]


def run_bench(arguments: argparse.Namespace) -> int:
    """Run the benchmark that the command line asks for."""
    from unveil_core.bench.raster import Plan, bench_raster, write_plot
    from unveil_core.bench.rivals import Yardstick
    from unveil_core.bench.step import bench_step

    yardstick = Yardstick(arguments.yardstick) if arguments.yardstick else None
    if arguments.what == "reconstruction":
        from unveil_core.bench.reconstruction import bench_reconstruction

        told = bench_reconstruction(
            arguments.drive,
            quality=arguments.quality,
            every=arguments.every,
            without=arguments.without,
            variant=arguments.variant,
            salt=arguments.salt,
        )
    elif arguments.what == "pipeline":
        from unveil_core.bench.pipeline import bench_pipeline, write_pipeline_plot
        from unveil_core.pipeline.console import reporting
        from unveil_core.pipeline.settings import RunSettings

        settings = RunSettings(
            quality=arguments.quality, inpainter=arguments.inpainter, seed=arguments.seed,
            reference_inpainter=arguments.reference_inpainter,
        )  # fmt: skip
        with reporting(False) as reporter:  # on standard error; the result is what goes to standard output
            told = bench_pipeline(
                arguments.drive,
                settings,
                rows=arguments.rows,
                scene=arguments.scene,
                keep=arguments.keep,
                reporter=reporter,
            )
    elif arguments.what == "step":
        size, count = arguments.size or (480, 320), arguments.surfels or 100_000
        if arguments.quick:
            told = bench_step(size=(96, 64), count=3000, iterations=3, yardstick=yardstick)
        else:
            told = bench_step(size=size, count=count, yardstick=yardstick)
    else:
        plan = Plan(yardstick=yardstick)
        if arguments.quick:
            plan = replace(
                plan, size=(96, 64), count=3000, rounds=2, counts=(1000, 3000), sizes=((48, 32), (96, 64)), tiles=4,
                small=(48, 32), small_count=300,
            )  # fmt: skip
        plan = replace(plan, size=arguments.size or plan.size, count=arguments.surfels or plan.count)

        def progress(done: int, total: int, message: str = "", **_: float) -> None:
            print(f"\rsweep {done} of {total}", end="\n" if done == total else "", file=sys.stderr, flush=True)

        told = bench_raster(plan, progress=progress)
    if arguments.output:
        write_json_atomic(arguments.output, told)
        if arguments.what == "raster":
            write_plot(told, arguments.output.with_suffix(".png"))
        elif arguments.what == "pipeline":
            write_pipeline_plot(told, arguments.output.with_suffix(".png"))
    tables = {"raster": _table, "pipeline": _pipeline_table}
    if arguments.json or arguments.what not in tables:
        print(json.dumps(told, indent=1))
    else:
        print(tables[arguments.what](told))
    return 0


def _table(told: dict[str, Any]) -> str:
    lines = ["forward and backward, {}x{}, {:,} surfels".format(*told["knobs"]["size"], told["knobs"]["surfels"])]
    lines += [f"{'':<36}{'ms':>9}{'least':>9}{'ratio':>8}{'rgb':>10}{'planes':>10}{'gradients':>11}"]
    for row in told["knobs"]["forward_and_backward"]:
        errors = [row.get(name) for name in ("rgb_error", "plane_error", "gradient_error")]
        cells = "".join(
            f"{'' if e is None else format(e, '.1e'):>{w}}" for e, w in zip(errors, (10, 10, 11), strict=True)
        )
        lines.append(f"{row['name']:<36}{row['ms']:>9.1f}{row['least_ms']:>9.1f}{row.get('ratio', 1.0):>8.2f}{cells}")
    lines.append("slow rivals, {}x{}, {:,} surfels".format(*told["rivals"][0]["size"], told["rivals"][0]["surfels"]))
    lines += [f"{row['name']:<46}{row['ms']:>9.1f} ms{row['ratio']:>9.1f}x" for row in told["rivals"]]
    return "\n".join(lines)


def _pipeline_table(told: dict[str, Any]) -> str:
    lines = [f"{told['drive']}, {told['quality']}, {told['frames']} frames of {told['size'][0]}x{told['size'][1]}"]
    heads = (("seconds", 9), ("own", 9), ("MB", 7), ("PSNR", 7), ("SSIM", 7), ("unseen", 8), ("elsewhere", 11))
    lines.append(f"{'':<42}" + "".join(f"{head:>{width}}" for head, width in heads))
    for row in told["rows"]:
        if "regions" not in row:
            lines.append(f"{row['title']:<42}{row['status']:>20}  ({row['mend']})")
            continue
        of = row["regions"]
        values = (
            row["seconds"], row["own_seconds"], row["peak_memory_mb"],
            *(of.get(region, {}).get(figure) for region, figure in (
                ("removed", "psnr"), ("removed", "ssim"), ("unseen", "psnr"), ("seen_elsewhere", "psnr"),
            )),
        )  # fmt: skip
        digits = (1, 1, 0, 1, 2, 1, 1)
        cells = "".join(
            f"{'' if v is None else format(v, f'.{d}f'):>{width}}"
            for v, d, (_, width) in zip(values, digits, heads, strict=True)
        )
        lines.append(f"{row['title']:<42}{cells}")
    return "\n".join(lines)

"""The plots of cost against error and of cost against quality."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from unveil_core.errors import UnveilError

__all__ = ["Point", "pareto_front", "pareto_plot", "quality_plot"]

Point = tuple[str, float, float]
"""Name, cost, and error or quality."""


def pareto_front(points: Sequence[Point]) -> list[Point]:
    """Those of (name, cost, error) that no other beats in both, by rising cost."""
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (p[1], p[2])):
        if not front or point[2] < front[-1][2]:
            front.append(point)
    return front


def pareto_plot(points: Sequence[Point], path: Path, *, title: str) -> None:
    """Draw (name, milliseconds, relative error) and their Pareto front to a PNG or SVG file."""
    _draw(
        points, pareto_front(points), path, xlabel="milliseconds", yscale="log", title=title,
        ylabel="worst relative gradient error against float64",
    )  # fmt: skip


def quality_plot(points: Sequence[Point], path: Path, *, title: str) -> None:
    """Draw (name, seconds, decibels) and their Pareto front to a PNG or SVG file."""
    front = [(name, cost, -error) for name, cost, error in pareto_front([(n, c, -q) for n, c, q in points])]
    _draw(
        points, front, path, xlabel="seconds", xscale="log", title=title,
        ylabel="PSNR inside the removed region against the true street, dB",
    )  # fmt: skip


def _draw(points: Sequence[Point], front: Sequence[Point], path: Path, **looks: Any) -> None:
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        raise UnveilError("no matplotlib for the plot", path=path, mend="pip install unveil-core[bench]") from None
    figure, axes = pyplot.subplots(figsize=(9, 5.5), layout="constrained")
    axes.plot(
        [p[1] for p in front], [p[2] for p in front], "-", color="#2a7f62", lw=1.5, label="Pareto front", zorder=1
    )
    on_front = {p[0] for p in front}
    for name, cost, error in points:
        axes.plot(cost, error, "o", color="#2a7f62" if name in on_front else "#8a8a8a", ms=6, zorder=2)
        # The front is the left edge of all points: its names have room on the left.
        left = name in on_front or cost > 0.85 * max(p[1] for p in points)
        offset, side = ((-8, -3), "right") if left else ((8, -3), "left")
        axes.annotate(name, (cost, error), textcoords="offset points", xytext=offset, fontsize=8, ha=side)
    axes.set(**looks)
    axes.margins(x=0.3, y=0.08)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)

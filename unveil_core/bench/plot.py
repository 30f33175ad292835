"""The plots of cost against error and of cost against quality."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from unveil_core.base.errors import UnveilError

__all__ = ["Point", "pareto_front", "pareto_plot", "quality_plot", "spread"]

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
        points,
        pareto_front(points),
        path,
        xlabel="milliseconds",
        yscale="log",
        title=title,
        ylabel="worst relative gradient error against float64",
    )


def quality_plot(points: Sequence[Point], path: Path, *, title: str) -> None:
    """Draw (name, seconds, decibels) and their Pareto front to a PNG or SVG file."""
    front = [(name, cost, -error) for name, cost, error in pareto_front([(n, c, -q) for n, c, q in points])]
    _draw(
        points,
        front,
        path,
        xlabel="seconds",
        xscale="log",
        title=title,
        ylabel="PSNR inside the removed region against the true street, dB",
    )


def spread(places: Sequence[float], least: float) -> list[float]:
    """Places moved as little as need be for none to be nearer than ``least`` to another, in the same order."""
    groups: list[list[int]] = []  # indices by rising place; a group stands close together around its mean
    centre: list[float] = []
    for i in sorted(range(len(places)), key=lambda k: places[k]):
        groups.append([i])
        centre.append(places[i])
        while len(groups) > 1 and centre[-1] - centre[-2] < least * (len(groups[-1]) + len(groups[-2])) / 2:
            last = groups.pop()
            centre.pop()
            groups[-1] += last
            centre[-1] = sum(places[k] for k in groups[-1]) / len(groups[-1])
    moved = [0.0] * len(places)
    for group, middle in zip(groups, centre, strict=True):
        for turn, i in enumerate(group):
            moved[i] = middle + least * (turn - (len(group) - 1) / 2)
    return moved


def _draw(points: Sequence[Point], front: Sequence[Point], path: Path, **looks: Any) -> None:
    settings = Path("matplotlibrc")
    if settings.exists() and "matplotlib" not in sys.modules:
        raise UnveilError(
            "matplotlib would obey it", path=settings.absolute(), mend="run this in another folder, with whole paths"
        )
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        raise UnveilError("no matplotlib for the plot", path=path, mend="pip install matplotlib") from None
    figure, axes = pyplot.subplots(figsize=(9, 5.5), layout="constrained")
    axes.plot(
        [p[1] for p in front], [p[2] for p in front], "-", color="#2a7f62", lw=1.5, label="Pareto front", zorder=1
    )
    on_front = {p[0] for p in front}
    for name, cost, error in points:
        axes.plot(cost, error, "o", color="#2a7f62" if name in on_front else "#8a8a8a", ms=6, zorder=2)
    axes.set(**looks)
    axes.margins(x=0.3, y=0.08)
    figure.canvas.draw()  # the layout decides where the points are
    # The front is the left edge of all points: its names have room on the left.
    on_left = [p[0] in on_front or p[1] > 0.85 * max(p[1] for p in points) for p in points]
    heights = [float(axes.transData.transform(p[1:])[1]) * 72 / figure.dpi for p in points]
    for side, offset in (("right", -8), ("left", 8)):
        chosen = [i for i, left in enumerate(on_left) if left == (side == "right")]
        for i, height in zip(chosen, spread([heights[i] for i in chosen], 9.5), strict=True):
            name, cost, error = points[i]
            axes.annotate(
                name,
                (cost, error),
                textcoords="offset points",
                xytext=(offset, height - heights[i] - 3),
                fontsize=8,
                ha=side,
            )
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)

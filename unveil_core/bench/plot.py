"""The plot of cost against error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from unveil_core.errors import UnveilError

__all__ = ["pareto_front", "pareto_plot"]


def pareto_front(points: Sequence[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    """Those of (name, cost, error) that no other beats in both, by rising cost."""
    front: list[tuple[str, float, float]] = []
    for point in sorted(points, key=lambda p: (p[1], p[2])):
        if not front or point[2] < front[-1][2]:
            front.append(point)
    return front


def pareto_plot(points: Sequence[tuple[str, float, float]], path: Path, *, title: str) -> None:
    """Draw (name, milliseconds, relative error) and their Pareto front to a PNG or SVG file."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        raise UnveilError("no matplotlib for the plot", path=path, mend="pip install unveil-core[bench]") from None
    figure, axes = pyplot.subplots(figsize=(9, 5.5), layout="constrained")
    front = pareto_front(points)
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
    axes.set(xlabel="milliseconds", ylabel="worst relative gradient error against float64", yscale="log", title=title)
    axes.margins(x=0.3, y=0.08)
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)

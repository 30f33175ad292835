"""Result files in, Markdown out."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["both", "db", "mean_se", "percent", "results", "seconds", "table"]

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"


@cache
def results(name: str) -> Any:
    """What a file of benchmarks/results/ holds; ``name`` is its stem."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown. None becomes a dash."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join("–" if cell is None else str(cell) for cell in line) + " |" for line in lines)


def db(figures: dict[str, Any]) -> str:
    """PSNR alone, as ``24.2 dB``."""
    return f"{figures['psnr']:.1f} dB"


def both(figures: dict[str, Any]) -> str:
    """PSNR and SSIM, as ``24.2 dB / 0.76``."""
    return f"{db(figures)} / {figures['ssim']:.2f}"


def percent(share: float, digits: int = 0) -> str:
    """A share of 1 as per cent."""
    return f"{100 * share:.{digits}f} %"


def seconds(value: float) -> str:
    """A time, in minutes from 3 minutes on."""
    return f"{value:,.0f} s" if value < 180 else f"{value / 60:.0f} min"


def mean_se(figure: dict[str, float], digits: int = 1, scale: float = 1.0, sign: str = "") -> str:
    """A mean and its standard error."""
    return f"{scale * figure['mean']:{sign}.{digits}f} ± {scale * figure['se']:.{digits}f}"

"""Result files in, Markdown out."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

__all__ = ["both", "dated", "db", "mean_se", "percent", "results", "seconds", "table"]

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks" / "results"
STATE = "state"
"""File that has the commit of the present program: what was measured of another one is *earlier*."""
OF_PACKAGES = {"install"}
"""Files with figures of other packages alone."""
_asked: list[str] = []


def results(name: str) -> Any:
    """What a file of benchmarks/results/ holds; ``name`` is its stem."""
    _asked.append(name)
    return _read(name)


@cache
def _read(name: str) -> Any:
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def dated(make: Callable[[], str]) -> str:
    """A table, or a text, with the word *earlier* in each row where a file that it was made of is of an earlier program."""
    _asked.clear()
    text = make()
    present = _read(STATE)["commit"]
    if all(_commit(name) == present for name in set(_asked) - OF_PACKAGES):
        return text
    lines = text.splitlines()
    if not any(line.startswith("|") for line in lines):
        return f"Earlier program: {text[:1].lower()}{text[1:]}"
    ends = iter(["program", "---"])
    return "\n".join(f"{line} {next(ends, 'earlier')} |" if line.startswith("|") else line for line in lines)


def _commit(name: str) -> str | None:
    """Of the program that a file's figures were taken of; None where it does not say."""
    found = _read(name)
    machine = found.get("machine") if isinstance(found, dict) else None
    return machine.get("commit") if isinstance(machine, dict) else None


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

"""Means, paired differences and their standard errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

__all__ = ["Estimate", "Figures", "clustered", "estimate", "paired"]

Figures = Mapping[str, float | None]
"""Of one car or hole, by name; None where there is nothing to measure."""


@dataclass(frozen=True)
class Estimate:
    """A mean and how sure it is.

    Attributes:
        mean: over what was measured; se: its standard error, NaN of a single one.
        count: how many were measured.
    """

    mean: float
    se: float
    count: int

    def to_json(self) -> dict[str, Any]:
        """For results: 4 digits, None for an error that is not known."""
        return {
            "mean": round(self.mean, 4),
            "se": None if math.isnan(self.se) else round(self.se, 4),
            "count": self.count,
        }

    def __str__(self) -> str:
        return f"{self.mean:.4g}" + ("" if math.isnan(self.se) else f" ± {self.se:.2g}")


def estimate(values: Sequence[float | None]) -> Estimate | None:
    """The mean of those that were measured (not None, finite), None where none was."""
    there = np.array([v for v in values if v is not None and math.isfinite(v)], dtype=np.float64)
    if not len(there):
        return None
    se = float(there.std(ddof=1) / math.sqrt(len(there))) if len(there) > 1 else math.nan
    return Estimate(float(there.mean()), se, len(there))


def clustered(figures: Mapping[str, Figures], cluster_of: Mapping[str, str]) -> dict[str, Figures]:
    """Means of figures by cluster: what lies over each other is one measurement, not several.

    Args:
        figures: by key; cluster_of: the cluster of each key.
    """
    members: dict[str, list[Figures]] = {}
    for key, own in figures.items():
        members.setdefault(cluster_of[key], []).append(own)
    found: dict[str, Figures] = {}
    for name, rows in members.items():
        means = {
            figure: estimate([row.get(figure) for row in rows]) for figure in dict.fromkeys(f for r in rows for f in r)
        }
        found[name] = {figure: None if value is None else value.mean for figure, value in means.items()}
    return found


def paired(ours: Mapping[str, Figures], theirs: Mapping[str, Figures]) -> dict[str, Estimate]:
    """By figure the mean of ours minus theirs over what both have measured.

    Args:
        ours, theirs: figures by key of the car or hole; keys and figures that only one side has are left out.
    """
    shared = [key for key in ours if key in theirs]
    names = list(dict.fromkeys(name for key in shared for name in ours[key]))
    found = {}
    for name in names:
        pairs = [(ours[key].get(name), theirs[key].get(name)) for key in shared]
        difference = estimate([None if a is None or b is None else a - b for a, b in pairs])
        if difference is not None:
            found[name] = difference
    return found

"""Only what the scene needs: choices made by held-out error against cost, while the optimization runs.

Cost is modelled, not taken from the clock: the same drive must give the same scene on a busy machine and on an idle one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from unveil_core.optimize.adaptation.probes import probe_error
from unveil_core.optimize.training.schedule import Phase
from unveil_core.optimize.training.trainer import Optimization
from unveil_core.optimize.training.views import TrainingView

__all__ = ["CHOICES", "AdaptSettings", "Looks", "decibels", "step_cost"]

CHOICES = ("coarse", "iterations", "budget", "sh_degree", "sky")
"""What is chosen while it runs, unless the user has: steps at half resolution, steps at full, surfels, colour, panorama."""
NS_A_PIXEL, NS_A_SURFEL = 150.0, 220.0
"""A step's time on two cores of a server is near to this linear model, 30,000 to a million surfels."""


@dataclass(frozen=True)
class AdaptSettings:
    """Thresholds for going on: the least gain in held-out error per extra cost.

    Attributes:
        least_gain: dB of the held-out error that a tenth more work must buy.
        sh_gain: dB that a higher degree of colour must buy in the few steps of its trial: a tenth of what it buys in the end.
        every: held-out blocks are measured every so many steps; density control runs right after each measurement.
        looks: number of measurements over which the slope is taken.
    """

    least_gain: float = 0.1
    sh_gain: float = 0.05
    every: int = 60
    looks: int = 3


def decibels(error: float) -> float:
    """PSNR of a mean squared error."""
    return float(-10 * np.log10(max(error, 1e-12)))


def step_cost(view: TrainingView, surfels: int) -> float:
    """Modelled seconds of a step."""
    return 1e-9 * (NS_A_PIXEL * view.camera.width * view.camera.height + NS_A_SURFEL * surfels)


@dataclass
class Looks:
    """Held-out error against work done.

    Attributes:
        settings: see there.
        probes: by phase name, the probed views in the resolution of the phase.
        work: modelled seconds up to now.
        seen: of the present phase, (work, PSNR in dB) of each look.
        record: all looks, for the workspace.
    """

    settings: AdaptSettings
    probes: dict[str, Sequence[TrainingView]]
    work: float = 0.0
    seen: list[tuple[float, float]] = field(default_factory=list)
    record: list[dict[str, Any]] = field(default_factory=list)

    def begin(self) -> None:
        """A new phase: its errors do not compare with those before."""
        self.seen = []

    def look(self, state: Optimization, phase: Phase, turn: int) -> bool:
        """Count a step, and measure when it is time; returns whether it was."""
        self.work += step_cost(phase.views[0], len(state))
        if turn % self.settings.every:
            return False
        psnr = decibels(probe_error(state, self.probes[phase.name]))
        self.seen.append((self.work, psnr))
        self.record.append(
            {
                "phase": phase.name,
                "step": turn,
                "surfels": len(state),
                "work": round(self.work, 3),
                "psnr": round(psnr, 3),
                "gain": None if (gain := self.gain()) is None else round(gain, 3),
            }
        )
        return True

    def gain(self, back: int = 0) -> float | None:
        """dB that the next tenth of work is expected to buy: the slope of the last looks, or of those ``back`` looks ago; None if
        they are too few."""
        last = len(self.seen) - back
        if last < self.settings.looks:
            return None
        work, psnr = np.array(self.seen[last - self.settings.looks : last]).T
        x = np.log(work)
        x = x - x.mean()
        return float((x * psnr).sum() / (x * x).sum() * np.log(1.1))

    def pays(self) -> bool:
        """Whether to continue as now: one look that fell short, with new surfels that have not settled, ends nothing."""
        gains = (self.gain(), self.gain(back=1))
        return any(gain is None or gain >= self.settings.least_gain for gain in gains)

"""The course of an optimization: phases of steps of one kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from unveil_core.optimize.training.trainer import Optimization
from unveil_core.optimize.training.views import TrainingView

__all__ = ["Phase", "Watch", "run_phase"]


@dataclass(frozen=True, eq=False)
class Phase:
    """A stretch of steps of one kind.

    Attributes:
        name: for progress and the record.
        views: the targets, in the resolution of this phase.
        steps: at most.
        geometry: whether the terms of the second stage count.
        first, last: how much of the whole schedule is done before and after, 0 to 1; step sizes fall with it.
        grow_every: steps between two turns of density control, 0 = never; prune_every: likewise for opacity pruning.
    """

    name: str
    views: Sequence[TrainingView]
    steps: int
    geometry: bool
    first: float
    last: float
    grow_every: int = 0
    prune_every: int = 0


Watch = Callable[[Optimization, Phase, int], bool]
"""Called after each step with the steps taken in this phase; True ends the phase."""


def run_phase(
    state: Optimization,
    phase: Phase,
    watch: Watch | None = None,
    *,
    begun: int = 0,
    pause: Callable[[int], None] | None = None,
) -> int:
    """Take the steps of a phase; returns how many there were.

    Args:
        begun: steps of the phase that were taken already, before a checkpoint.
        pause: called with the steps taken whenever the state is one to go on from.
    """
    for turn in range(begun + 1, phase.steps + 1):
        done = phase.first + (phase.last - phase.first) * (turn - 1) / phase.steps
        state.step(phase.views, geometry=phase.geometry, done=done)
        # Before the set of surfels changes: what it costs at first is no news.
        if watch is not None and watch(state, phase, turn):
            return turn
        if turn < phase.steps:
            if phase.grow_every and turn % phase.grow_every == 0:
                state.grow()
            if phase.prune_every and turn % phase.prune_every == 0:
                state.prune()
        if pause is not None:
            pause(turn)
    return phase.steps

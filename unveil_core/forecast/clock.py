"""How much longer a run takes: what was expected of each stage, set right by what those before it took."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

__all__ = ["RunClock"]

PRIOR_SHARE = 0.15
"""How much of the whole expected time must be over before what it took counts as much as what was expected."""
LEAST_SHARE = 0.02
"""Share of a stage from which on its own pace tells how long it takes."""


class RunClock:
    """The time left of a run.

    Args:
        expected: seconds of each stage that is to run, in order.
        now: seconds of some clock that never goes back.
    """

    def __init__(self, expected: Mapping[str, float], now: Callable[[], float] = time.monotonic) -> None:
        self.expected, self._now = dict(expected), now
        self._begun: dict[str, float] = {}
        self._over: set[str] = set()
        self._took = self._meant = 0.0

    def begin(self, stage: str) -> None:
        """A stage starts."""
        self._begun[stage] = self._now()

    def end(self, stage: str) -> None:
        """A stage ended, or was up to date, which says nothing of the machine."""
        self._over.add(stage)
        if stage in self._begun:
            self._took += self._now() - self._begun[stage]
            self._meant += self.expected.get(stage, 0.0)

    def left(self, stage: str, done: int, total: int) -> float:
        """Seconds until the run ends, seen from within a stage.

        Args:
            done, total: how far the stage says it is; it may count anew for each of its parts.
        """
        later = sum(s for name, s in self.expected.items() if name != stage and name not in self._over)
        if stage in self._over:
            return later * self._pace()
        elapsed, meant = self._now() - self._begun.get(stage, self._now()), self.expected.get(stage, 0.0)
        pace = self._pace(max(elapsed - meant, 0.0))
        rest = meant * pace - elapsed
        share = done / total if total > 0 else 0.0
        if elapsed > meant and share > LEAST_SHARE:
            # It takes longer than expected: only its own pace is left to go by.
            rest = elapsed * (1 - min(share, 1.0)) / share
        return max(rest, 0.0) + later * pace

    def _pace(self, late: float = 0.0) -> float:
        """Time that stages take as a multiple of what was expected.

        Args:
            late: seconds that the present one has taken too long already.
        """
        prior = PRIOR_SHARE * sum(self.expected.values())
        reference = self._meant + prior
        return (self._took + late + prior) / reference if reference > 0 else 1.0

"""A run that is only planned: which stages would run, why, and what they would take. Nothing is written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from unveil_core.pipeline.forecasting import Expected, expected_of_stages
from unveil_core.pipeline.run import Begun, look_at
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.status import StageState, explained_states, stages_not_begun
from unveil_core.workspace.workspace import Workspace

__all__ = ["Plan", "plan_run"]


@dataclass(frozen=True)
class Plan:
    """What a run would do.

    Attributes:
        begun: the drive, and what is assumed of it.
        states: of the run's stages, by name.
        expected: what those take that would run; None where all are up to date.
    """

    begun: Begun
    states: dict[str, StageState]
    expected: Expected | None

    def lines(self) -> Iterator[str]:
        """For people: what is assumed, then a line for each stage, then the forecast."""
        for notice in self.begun.notices:
            yield notice.message
        for name, found in self.states.items():
            yield f"{name:<12} {'up to date' if found.state == 'done' else f'would run: {found.why or found.state}'}"
        yield "Nothing would run." if self.expected is None else self.expected.forecast.line()

    def to_json(self, settings: RunSettings) -> dict[str, object]:
        """The same for programs."""
        found = None if self.expected is None else self.expected.forecast
        return {
            "notices": [notice.message for notice in self.begun.notices],
            "findings": [{"problem": f.problem, "mend": f.mend, "asks": f.asks} for f in self.begun.findings],
            "stages": {
                n: {"state": s.state, "why": s.why, "would_run": s.state != "done"} for n, s in self.states.items()
            },
            "forecast": None
            if found is None
            else {
                "seconds": {name: round(s, 1) for name, s in found.seconds.items()},
                "memory_mb": round(found.memory_mb),
                "disk_mb": round(found.disk_mb),
            },
            "settings": settings.to_json(),
        }


def plan_run(
    drive: str | Path,
    workspace: str | Path,
    settings: RunSettings,
    *,
    until: str | None = None,
    replace: bool = False,
    tell: Callable[[str], None] = lambda line: None,
) -> Plan:
    """Plan a run. Arguments and errors as :func:`unveil_core.pipeline.run.run`.

    Args:
        tell: gets a line where the machine is measured.
    """
    begun = look_at(drive, workspace, settings, until=until, replace=replace)
    place = Path(drive).absolute()
    states = stages_not_begun() if begun.first else explained_states(Workspace.open(workspace), settings, place)
    states = {stage.name: states[stage.name] for stage in begun.stages}
    names = [name for name, found in states.items() if found.state != "done"]
    expected = expected_of_stages(begun.drive, begun.placed, names, settings, tell, keep=False) if names else None
    return Plan(begun, states, expected)

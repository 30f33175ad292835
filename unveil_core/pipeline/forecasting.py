"""The forecast of a run: said before its first stage, and kept right while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from unveil_core.base.kernels.device import name_of_device
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.drives.scale_and_up import Placement
from unveil_core.forecast.clock import RunClock
from unveil_core.forecast.costs import reference_seconds, seconds_of
from unveil_core.forecast.forecast import Forecast, forecast
from unveil_core.forecast.machine import (
    Machine,
    free_disk_mb,
    free_memory_mb,
    measured_seconds,
    this_machine,
)
from unveil_core.forecast.solving import seconds_by_step
from unveil_core.forecast.workload import Workload
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Notice, Stage
from unveil_core.pipeline.status import stage_states
from unveil_core.pipeline.steps.import_ import work_side_of
from unveil_core.points.of_drive import lacks_points
from unveil_core.workspace.workspace import Workspace

__all__ = ["Expected", "expected_of", "expected_of_stages", "workload_of"]


@dataclass(frozen=True, eq=False)
class Expected:
    """What a run is expected to take, and how it compares as it goes on.

    Attributes:
        forecast: of the stages that are to run; machine: that it was made for; clock: of the run.
    """

    forecast: Forecast
    machine: Machine
    clock: RunClock

    def notices(self, root: Path) -> list[Notice]:
        """The forecast in a line, and a warning for each of memory and disk that is too little.

        Args:
            root: of the workspace.
        """
        found = self.forecast
        details = {
            "seconds": {name: round(s, 1) for name, s in found.seconds.items()},
            "memory_mb": round(found.memory_mb),
            "disk_mb": round(found.disk_mb),
        }
        lines = found.lacking(free_memory_mb(), free_disk_mb(root))
        return [
            Notice("import", found.line(), "notice", {"forecast": details}),
            *(Notice("import", line, "warning") for line in lines),
        ]

    def ended(self, stage: str, seconds: float) -> None:
        """Take in what a stage took that was made whole."""
        work = self.forecast.workload
        self.machine.note(work.quality, stage, seconds, seconds_of(work)[stage])


def workload_of(drive: Drive, settings: RunSettings) -> Workload:
    """The work of a run on a drive in metres."""
    return Workload.of_drive(drive, settings.quality, work_side_of(settings), settings.memory_bytes)


def expected_of(
    drive: Drive,
    placement: Placement,
    workspace: Workspace,
    stages: Sequence[Stage],
    settings: RunSettings,
    tell: Callable[[str], None],
    place: Path | None = None,
) -> Expected | None:
    """The forecast of a run of some stages; None where all of them are up to date.

    A machine that has not run anything yet is measured: seconds, and half a minute where kernels must be compiled first. It is the
    processor that is measured, also where a GPU does a part of the work: the first forecast is then too long.

    Args:
        tell: gets a line before that.
        place: of the drive; the recorded one by default.
    """
    names = [stage.name for stage in stages]
    if workspace.state().get("stages"):
        states = stage_states(workspace, settings, place)
        names = [name for name in names if states[name] != "done"]
    return expected_of_stages(drive, placement, names, settings, tell) if names else None


def expected_of_stages(
    drive: Drive,
    placement: Placement,
    names: Sequence[str],
    settings: RunSettings,
    tell: Callable[[str], None],
    *,
    keep: bool = True,
) -> Expected:
    """The forecast of stages by name, see :func:`expected_of`; ``keep`` the speed of the machine, where it was measured."""
    machine = this_machine(device=name_of_device(settings.device))
    if not machine.known:
        tell("measuring how fast this machine is")
        machine.speed = measured_seconds() / reference_seconds()
        if keep:
            machine.save()
    found = forecast(workload_of(localized(drive, placement), settings), names, machine)
    if "import" in names and lacks_points(drive):
        found = replace(found, seconds={**found.seconds, "import": found.seconds["import"] + _points_s(found, machine)})
    return Expected(found, machine, RunClock(found.seconds))


def _points_s(found: Forecast, machine: Machine) -> float:
    """Seconds in which points are found in the photographs of a drive that lacks them."""
    work = found.workload
    return (machine.speed or 1.0) * seconds_by_step(0, work.frames, work.size, 0, thorough=False)["points"]

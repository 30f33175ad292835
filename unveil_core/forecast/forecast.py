"""What a run will take, in a line before it starts; and where it does not fit, what would."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from unveil_core.base.wording import about_as_long, about_as_much
from unveil_core.forecast.costs import disk_mb, peak_memory_mb, seconds_of
from unveil_core.forecast.machine import Machine
from unveil_core.forecast.workload import Workload

__all__ = ["Forecast", "forecast"]

LEAST_MEMORY_MB = 512.0
"""Room for frames that is proposed at least, MB: less makes them be read again and again."""
SHRINK = 0.8
"""Step in which smaller images are proposed."""
LEAST_SIDE = 320
"""Longer side that is proposed at least, pixels: smaller images are no result that anybody wants."""


@dataclass(frozen=True)
class Forecast:
    """What a run is expected to take.

    Attributes:
        workload: of the run.
        seconds: by stage that is to run, in order.
        memory_mb: peak of the process; disk_mb: of the workspace.
    """

    workload: Workload
    seconds: Mapping[str, float]
    memory_mb: float
    disk_mb: float

    def line(self) -> str:
        """Frames, size, blocks, time, memory and disk, for people."""
        work = self.workload
        width, height = work.size
        reduced = f", worked on at {work.side}" if work.side < max(work.size) else ""
        cameras = f" of {work.cameras} cameras" if work.cameras > 1 else ""
        blocks = f"{work.blocks} blocks" if work.blocks > 1 else "1 block"
        what = f"{work.frames} frames{cameras}, {width}x{height}{reduced}, {work.way_m:.0f} m of way in {blocks}"
        time, memory = about_as_long(sum(self.seconds.values())), about_as_much(self.memory_mb)
        return f"{what}: about {time}, {memory} of memory and {about_as_much(self.disk_mb)} of disk"

    def with_less_memory(self, free_mb: float) -> str | None:
        """The options with which the run fits into so much memory, MB; None where none does, or it should fit as it is."""
        return _smaller_memory(self.workload, free_mb) or None

    def lacking(self, free_memory_mb: float, free_disk_mb: float) -> list[str]:
        """A line for each of memory and disk that will not do, with what would fit; none where both do."""
        lines = []

        def lack(what: str, needed: float, free: float, way_out: str) -> None:
            amounts = f"about {about_as_much(needed)} of {what}, of which {about_as_much(free)} are free"
            lines.append(f"this needs {amounts}; {way_out} would fit")

        if self.memory_mb > free_memory_mb:
            way_out = self.with_less_memory(free_memory_mb) or "a machine with more"
            lack("memory", self.memory_mb, free_memory_mb, way_out)
        if self.disk_mb > free_disk_mb:
            frames = _fewer_frames(self.workload, free_disk_mb)
            fewer = f", or --frames 0:{frames}," if frames > 1 else ""
            lack("disk", self.disk_mb, free_disk_mb, f"a workspace on another disk{fewer}")
        return lines


def forecast(workload: Workload, stages: Sequence[str], machine: Machine) -> Forecast:
    """What running some stages will take on a machine."""
    cost = seconds_of(workload)
    return Forecast(
        workload,
        {name: cost[name] * machine.multiple(workload.quality, name) for name in stages},
        peak_memory_mb(workload),
        disk_mb(workload),
    )


def _fewer_frames(work: Workload, free_mb: float) -> int:
    """How many frames of each camera fit on a disk."""
    frames = work.frames // work.cameras
    while frames > 1 and disk_mb(work.with_frames(frames * work.cameras)) > free_mb:
        frames = min(frames - 1, int(0.95 * frames))
    return frames


def _smaller_memory(work: Workload, free_mb: float) -> str | None:
    """The options with which a run fits into the memory that is free; None where none does."""
    room = max(LEAST_MEMORY_MB, work.memory_mb - (peak_memory_mb(work) - free_mb))
    tight = replace(work, memory_mb=room)
    while peak_memory_mb(tight) > free_mb:
        if room > LEAST_MEMORY_MB:
            room = LEAST_MEMORY_MB
            tight = replace(tight, memory_mb=room)
            continue
        side = int(tight.side * SHRINK)
        if side < LEAST_SIDE:
            return None
        tight = tight.with_side(side)
    options = []
    if room < work.memory_mb:
        options.append(f"--memory {int(room)}M")
    if tight.side < work.side:
        options.append(f"--work-side {tight.side}")
    return " ".join(options)

"""This machine: how fast it is, by a quick measurement or by the runs that it has done, and what memory and disk are free."""

from __future__ import annotations

import json
import platform
import shutil
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

from unveil_core.base.disk.open_safely import LARGEST_STATE, read_bytes
from unveil_core.base.files import parsed_json, write_json_atomic
from unveil_core.base.surroundings.user_cache import user_cache_folder

__all__ = ["Machine", "free_disk_mb", "free_memory_mb", "measured_seconds", "this_machine"]

FILE = "timings.json"

KEPT = 5
"""Runs of a stage whose times are kept: their median does not follow one that shared the machine."""
LEAST_SECONDS = 2.0
"""Shortest expected time of a stage that tells how fast the machine is, seconds."""
RATIOS = (0.02, 50.0)
"""Limits of a stored ratio: what lies beyond is no time of this program."""


@dataclass
class Machine:
    """How much time the work takes here, as a multiple of the machine's on which the costs were measured.

    Attributes:
        name: of the machine, its processors and the program's version.
        path: of the file with the times of all machines that share the folder; None = none is kept.
        speed: multiple by the quick measurement; None = not measured.
        ratios: multiples of the last runs, by ``quality.stage``.
    """

    name: str
    path: Path | None = None
    speed: float | None = None
    ratios: dict[str, list[float]] = field(default_factory=dict)

    @property
    def known(self) -> bool:
        """Whether anything tells how fast it is."""
        return self.speed is not None or bool(self.ratios)

    def multiple(self, quality: str, stage: str) -> float:
        """For a stage: by its own last runs, else by those of other stages, else by the measurement."""
        own = self.ratios.get(f"{quality}.{stage}")
        if own:
            return median(own)
        others = [median(values) for name, values in self.ratios.items() if name.startswith(f"{quality}.")]
        if others:
            return median(others)
        return self.speed if self.speed is not None else 1.0

    def note(self, quality: str, stage: str, seconds: float, expected: float) -> None:
        """Keep what a stage took.

        Args:
            expected: seconds on the machine on which the costs were measured.
        """
        if expected < LEAST_SECONDS or not RATIOS[0] < seconds / expected < RATIOS[1]:
            return
        name = f"{quality}.{stage}"
        self.ratios[name] = [*self.ratios.get(name, []), round(seconds / expected, 4)][-KEPT:]
        self.save()

    def save(self) -> None:
        """Write the file, beside the entries of other machines; where it cannot be written nothing is lost."""
        if self.path is None:
            return
        with suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            entry = {"speed": self.speed, "ratios": self.ratios}
            write_json_atomic(self.path, {**_entries(self.path), self.name: entry})


def this_machine(folder: Path | None = None, device: str = "cpu") -> Machine:
    """What is known of this machine.

    Args:
        device: of the run: with a GPU its stages take other times, which are kept for themselves.
        folder: where times are kept; None = the folder ``UNVEIL_CACHE``, else the user's folder for caches.
    """
    from unveil_core import __version__
    from unveil_core.base.parallel import thread_count

    path = (folder or user_cache_folder()) / FILE
    name = f"{platform.node()} {platform.machine()} {thread_count()} {__version__}"
    if device != "cpu":
        name += f" {device}"
    entry = _entries(path).get(name, {})
    machine = Machine(name, path)
    if isinstance(entry, Mapping):
        machine.speed = _ratio(entry.get("speed"))
        stored = entry.get("ratios")
        for key, values in stored.items() if isinstance(stored, Mapping) else ():
            good = [v for v in map(_ratio, values if isinstance(values, list) else ()) if v is not None]
            if good:
                machine.ratios[str(key)] = good[-KEPT:]
    return machine


def _entries(path: Path) -> dict[str, Any]:
    """What the file holds; nothing where it is not there or damaged."""
    try:
        data = parsed_json(read_bytes(path, LARGEST_STATE))
    except (OSError, ValueError):
        return {}
    if not isinstance(data, dict):
        return {}
    return {name: entry for name, entry in data.items() if _is_json(entry)}


def _is_json(entry: object) -> bool:
    """Whether it can be written again: Python reads NaN and infinity, which JSON does not have."""
    try:
        json.dumps(entry, allow_nan=False)
    except ValueError:
        return False
    return True


def _ratio(value: object) -> float | None:
    good = isinstance(value, int | float) and not isinstance(value, bool) and RATIOS[0] < value < RATIOS[1]
    return float(value) if good else None  # type: ignore[arg-type]


def measured_seconds() -> float:
    """Seconds of a training step's render and gradient on a small scene, the best of a few."""
    import numpy as np
    import torch

    from unveil_core.geometry.camera import Camera
    from unveil_core.raster import render
    from unveil_core.surfels.surfels import Surfels

    rng = np.random.default_rng(0)
    count = 20_000
    means = rng.uniform((-4, -3, 4), (4, 3, 20), (count, 3))
    surfels = Surfels(
        torch.tensor(means, dtype=torch.float32, requires_grad=True),
        torch.tensor(rng.normal(size=(count, 4)), dtype=torch.float32),
        torch.full((count, 2), -2.5),
        torch.full((count,), 1.0),
        torch.tensor(rng.uniform(size=(count, 1, 3)), dtype=torch.float32),
        torch.zeros(count, dtype=torch.int64),
    )
    camera = Camera(384, 256, 300.0, 300.0, 192.0, 128.0, np.eye(4))
    best = float("inf")
    for _ in range(6):  # the first compiles the kernels, or loads them
        begun = time.perf_counter()
        rgb = render(surfels, camera).rgb
        assert rgb is not None
        rgb.square().mean().backward()  # type: ignore[no-untyped-call]
        best = min(best, time.perf_counter() - begun)
    return best


def free_memory_mb() -> float:
    """Memory that a process may take now: what the system has left, or the process's group of them (Linux control groups)."""
    import psutil

    found = [float(psutil.virtual_memory().available)]
    for limit, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ):
        with suppress(OSError, ValueError):  # without a limit the first says "max"
            found.append(float(Path(limit).read_text()) - float(Path(used).read_text()))
    return min(found) / 2**20


def free_disk_mb(folder: Path) -> float:
    """Room on the disk of a folder that may not be there yet."""
    there = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
    return float(shutil.disk_usage(there).free) / 2**20

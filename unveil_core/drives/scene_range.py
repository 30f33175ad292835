"""The lengths of a scene in its own units."""

from __future__ import annotations

from dataclasses import dataclass

from unveil_core.drives.drive import Drive
from unveil_core.drives.scale import units_per_metre

__all__ = ["SceneRange", "scene_range"]


@dataclass(frozen=True)
class SceneRange:
    """Lengths of one scene in its own units: ``unit`` per metre, ``near`` and ``far`` of the distortion's range."""

    unit: float
    near: float
    far: float


def scene_range(drive: Drive) -> SceneRange:
    """0.2 m and 100 m, in the drive's units."""
    unit = units_per_metre(drive)
    return SceneRange(unit, 0.2 * unit, 100.0 * unit)

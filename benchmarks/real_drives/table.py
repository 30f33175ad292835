"""The real drives of the bench, and how each is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.pipeline.settings import RunSettings

__all__ = ["DRIVES", "RealDrive", "named"]


@dataclass(frozen=True)
class RealDrive:
    """A drive.

    Attributes:
        name: in tables and of its folder in the cache.
        path: of the drive, relative to the folder of all drives.
        says: what is on it, in short.
        labels: folder of label pictures, likewise; None = what the drive has.
        remove: classes and groups that go; empty where masks tell.
        scene, cameras, frames, sweeps, work_side: as of ``RunSettings``.
    """

    name: str
    path: str
    says: str
    labels: str | None = None
    remove: tuple[str, ...] = ("vehicle", "human")
    scene: str | None = None
    cameras: tuple[str, ...] = ()
    frames: str | None = None
    sweeps: str = "all"
    work_side: int | None = None

    def settings(self, data: Path, quality: str) -> RunSettings:
        """Settings of the run of the drive itself; data: the folder of all drives."""
        options: dict[str, Any] = {
            name: getattr(self, name) for name in ("remove", "scene", "cameras", "frames", "sweeps", "work_side")
        }
        labels = None if self.labels is None else str(data / self.labels)
        return RunSettings(quality=quality, labels=labels, **options)


DRIVES = (
    RealDrive(
        "kitti_0005",
        "kitti_raw/2011_09_26/2011_09_26_drive_0005_sync",
        "rows of parked cars, fronts of houses, low sun against the camera",
        labels="kitti_raw/labels",
    ),
    RealDrive(
        "nuscenes_0916_front",
        "nuscenes",
        "car park and road between trees, overcast",
        labels="nuscenes/labels",
        scene="scene-0916",
        cameras=("CAM_FRONT",),
        sweeps="key",
    ),
    # The first 26 frames stand at a crossing.
    RealDrive(
        "pandaset_002_front",
        "pandaset/002",
        "crossing with traffic, low sun behind thin cloud",
        cameras=("front_camera",),
        frames="26:80:2",
    ),
    RealDrive(
        "lund",
        "lund",
        "old street walked along, points of photographs, masks, strong sun",
        remove=(),
    ),
    RealDrive(
        "pandaset_002_left",
        "pandaset/002",
        "the same, to the side: sidewalk, wall, windows, hedge",
        cameras=("front_left_camera",),
        frames="26:80:2",
    ),
)


def named(names: str) -> list[RealDrive]:
    """Drives by their names, with commas between; all where there is none.

    Raises:
        SystemExit: a name that no drive has.
    """
    known = {drive.name: drive for drive in DRIVES}
    wanted = [name for name in names.split(",") if name] or list(known)
    if unknown := [name for name in wanted if name not in known]:
        raise SystemExit(f"Unknown drive: {unknown[0]}. Choose from {', '.join(known)}.")
    return [known[name] for name in wanted]

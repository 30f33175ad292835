"""Points of a transforms.json: its PLY or the COLMAP model beside it, and in which coordinates they are.

nerfstudio has changed its mind. Files of 2023 have the points as they were before ``applied_transform`` and ``applied_scale``;
later ones have them transformed as the poses are. Nothing in a file tells, but the cameras do: they see more of the points where
both are in the same coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.checks.points_seen import seen_share
from unveil_core.drives.drive import Frame, PointCloud
from unveil_core.drives.formats.colmap.model import read_model_points
from unveil_core.drives.formats.colmap.models import find_model, model_folders, model_of_pictures
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.drives.formats.on_disk.pictures import NamedFiles
from unveil_core.drives.points import read_points
from unveil_core.geometry.camera import Camera

__all__ = ["NamedPoints", "read_named_points"]

COLMAP_TO_SAVED = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]])
"""What nerfstudio takes for ``applied_transform`` where the file lacks it and a COLMAP model lies beside it."""
CLEARLY = 0.05
"""Another reading of the points is believed if so much larger a share of them is seen."""


@dataclass(frozen=True)
class NamedPoints:
    """Attributes:
    cloud: in the coordinates of the poses; sources: files that it was read from; notice: what a user should know of it, or None.
    """

    cloud: PointCloud
    sources: tuple[Path, ...]
    notice: str | None = None


def read_named_points(keys: Keys, frames: Sequence[Frame]) -> NamedPoints | None:
    """Points that the file names, else those of a COLMAP model beside it, None where there are neither.

    Args:
        keys: of the file; frames: that it has.
    Raises:
        DriveError: points that cannot be read, or an ``applied_transform`` that is none.
    """
    applied = _applied(keys)
    root, cameras = keys.path.parent, [f.camera for f in frames]
    if keys.get("ply_file_path"):
        path = NamedFiles(keys.path).file(keys.get("ply_file_path"), "ply_file_path")
        told: list[str] = []
        found = read_points(path, told)
        if applied is None and find_model(root / "colmap") is not None:
            applied = COLMAP_TO_SAVED
        placed = _placed(found, cameras, applied, (path,), saved=True)
        return replace(placed, notice="; ".join([*told, *([placed.notice] if placed.notice else [])]) or None)
    folders = model_folders(root) or model_folders(root / "colmap")
    model = model_of_pictures(folders, [f.image_path.name for f in frames])
    if model is None:
        return None
    sources = tuple(sorted(p for p in model.iterdir() if p.stem == "points3D"))
    placed = _placed(
        read_model_points(model), cameras, COLMAP_TO_SAVED if applied is None else applied, sources, saved=False
    )
    if len(folders) == 1:
        return placed
    which = f"points are those of {model.relative_to(root).as_posix()}, of {len(folders)} COLMAP models"
    which += "; ply_file_path decides"
    return replace(placed, notice=which if placed.notice is None else f"{placed.notice}; {which}")


def _applied(keys: Keys) -> Float64 | None:
    """(3, 4) from the original coordinates to those of the poses, ``applied_scale`` in it; None where nothing was applied."""
    given, scale = keys.get("applied_transform"), keys.number("applied_scale")
    if given is None and scale is None:
        return None
    try:
        matrix = np.eye(4)[:3] if given is None else np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape not in ((3, 4), (4, 4)) or not np.isfinite(matrix).all():
        raise DriveError("Not a 3x4 matrix: applied_transform", path=keys.path, mend="leave it out or correct it")
    return (1.0 if scale is None else scale) * matrix[:3]


def _placed(
    cloud: PointCloud, cameras: Sequence[Camera], applied: Float64 | None, sources: tuple[Path, ...], *, saved: bool
) -> NamedPoints:
    """The points in the coordinates of the poses.

    Args:
        saved: they are in those already, unless the cameras say otherwise; else they are in the original ones, likewise.
    """
    if applied is None or np.array_equal(applied, np.eye(4)[:3]):
        return NamedPoints(cloud, sources)
    moved = replace(cloud, positions=cloud.positions @ applied[:, :3].T + applied[:, 3])
    seen_as_is, seen_moved = seen_share(cloud.positions, cameras), seen_share(moved.positions, cameras)
    as_is = seen_as_is >= seen_moved - CLEARLY if saved else seen_as_is > seen_moved + CLEARLY
    notice = None
    if as_is != saved:
        shares = f"the cameras see {max(seen_as_is, seen_moved):.0%} of them so, and {min(seen_as_is, seen_moved):.0%} otherwise"
        which = "in the coordinates of the poses" if as_is else "as they were before applied_transform"
        notice = f"points are taken to be {which}: {shares}"
    return NamedPoints(cloud if as_is else moved, sources, notice)

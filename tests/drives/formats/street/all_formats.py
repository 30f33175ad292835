"""The writer of each format that is read, by the name that :mod:`unveil_core.drives.formats.registry` gives it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.drives.formats.street.kitti import write_kitti360, write_kitti_odometry, write_kitti_raw
from tests.drives.formats.street.plain import write_colmap, write_metashape, write_nerfstudio
from tests.drives.formats.street.released import write_argoverse2, write_nuscenes, write_pandaset
from tests.drives.formats.street.street import Street
from tests.drives.formats.street.waymo import write_drivestudio, write_neuralsim, write_street_gaussians, write_waymo

__all__ = ["WRITERS"]

WRITERS: dict[str, Callable[[Path, Street], Path]] = {
    "transforms.json": write_nerfstudio,
    "a shot": write_metashape,
    "PandaSet": write_pandaset,
    "nuScenes": write_nuscenes,
    "neuralsim and StreetUnveiler": write_neuralsim,
    "Street Gaussians": write_street_gaussians,
    "DriveStudio": write_drivestudio,
    "Waymo Open v2": write_waymo,
    "Argoverse 2": write_argoverse2,
    "KITTI raw": write_kitti_raw,
    "KITTI odometry": write_kitti_odometry,
    "KITTI-360": write_kitti360,
    "COLMAP": write_colmap,
}
"""Each is given an empty folder and returns what is opened."""

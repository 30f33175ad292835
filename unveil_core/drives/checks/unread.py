"""What a path holds that is no drive, but known: data of other programs and data sets, and drives of which a part is missing. Names
alone are looked at."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

__all__ = ["Unread", "unread"]

MOST_NAMES = 2000
"""Of a folder's entries, that are looked at."""
ARCHIVES = (".zip", ".tgz", ".tar", ".tar.gz", ".7z", ".rar", ".tar.xz")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".m4v", ".webm", ".mts", ".m2ts", ".mxf", ".3gp", ".insv", ".360")
PICTURES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".heic", ".webp", ".dng", ".exr", ".dpx")
BY_BLENDER = (".abc", ".fbx", ".usd", ".usda", ".usdc", ".usdz", ".blend")
"""Scenes with a camera that Blender opens or imports."""
BY_COLMAP = "make poses and points with COLMAP, or with ns-process-data of nerfstudio, and give that folder"

BY_SOLVE = "make a drive of it: unveil solve CLIP|FOLDER -o DRIVE; unveil run CLIP|FOLDER -o WORKSPACE does both; docs/video.md"


@dataclass(frozen=True)
class Unread:
    """What it is, and what to do about it."""

    problem: str
    mend: str


@dataclass(frozen=True, eq=False)
class _Place:
    """A file or folder, with the names in it in lower case."""

    path: Path
    names: frozenset[str]

    def has(self, *names: str) -> bool:
        """Whether there are files or folders at all of these places, below it."""
        return all((self.path / n).exists() for n in names)

    def any_of(self, *endings: str) -> bool:
        return any(n.endswith(endings) for n in self.names)


def _missing(what: str, part: str, mend: str) -> Unread:
    return Unread(f"Not complete: {what} without {part}", mend)


def _nerfstudio(what: str, verb: str) -> Unread:
    return Unread(f"Not read: {what}", f"ns-process-data {verb} of nerfstudio makes a transforms.json of it")


NUSCENES = ("samples/CAM_FRONT", "samples/LIDAR_TOP", "sweeps/LIDAR_TOP", "sweeps/CAM_FRONT")
KNOWN: tuple[tuple[Callable[[_Place], bool], Unread], ...] = (
    (
        lambda p: p.any_of(".tfrecord") or any(p.path.glob("*/*.tfrecord")),
        Unread(
            "Not read: Waymo Open version 1 (.tfrecord)",
            "download version 2 (Parquet), or prepare it with DriveStudio, Street Gaussians or neuralsim, whose layouts are read",
        ),
    ),
    (
        lambda p: (
            any(p.has(f"keyframes/{n}") for n in ("cameras", "corrected_cameras"))
            or p.has("keyframes", "mesh_info.json")
        ),
        _nerfstudio("Polycam's raw export", "polycam"),
    ),
    (lambda p: p.any_of(".r3d"), _nerfstudio("a capture of Record3D", "record3d")),
    (
        lambda p: p.any_of(".psx", ".psz"),
        Unread(
            "Not read: a project of Metashape",
            "File > Export > Export Cameras writes a cameras.xml, which is read with the photographs beside it",
        ),
    ),
    (
        lambda p: p.any_of(".rcproj", ".rsproj"),
        Unread(
            "Not read: a project of RealityScan",
            "export Internal/External camera parameters as cameras.csv, which is read with the pictures beside it",
        ),
    ),
    (
        lambda p: p.any_of(*BY_BLENDER) and not p.has("sparse"),
        Unread(
            "Not read here: a scene of another program, which Blender reads",
            "import it there, put the plates behind the camera and press Use This Shot, or: blender --background --command "
            "unveil shot FILE --plates PLATE.1001.exr -o DRIVE",
        ),
    ),
    (
        lambda p: p.has("odm_georeferencing") or p.has("opensfm/reconstruction.json"),
        _nerfstudio("a project of OpenDroneMap", "odm"),
    ),
    (
        lambda p: p.has("reconstruction.json"),
        Unread("Not read: a reconstruction of OpenSfM", "opensfm export_colmap makes a COLMAP model of it"),
    ),
    (
        lambda p: p.any_of(".nvm", "bundle.out", "bundle.rd.out"),
        Unread("Not read: a model of VisualSFM or Bundler", "import it into COLMAP and export a model there"),
    ),
    (
        lambda p: p.has("poses_bounds.npy"),
        Unread("has poses of LLFF (poses_bounds.npy), which are not read", BY_COLMAP),
    ),
    (
        lambda p: p.any_of(".bag", ".mcap", ".db3"),
        Unread(
            "Not read: a ROS bag",
            "export its pictures, poses and points, and name them in a transforms.json",
        ),
    ),
    (
        lambda p: any(p.has(n) for n in NUSCENES),
        _missing(
            "nuScenes",
            "its tables",
            "unpack v1.0-trainval_meta.tgz, v1.0-test_meta.tgz or v1.0-mini.tgz into the same folder",
        ),
    ),
    (
        lambda p: p.has("camera") and any((p.path / "camera").glob("*/intrinsics.json")),
        _missing("a sequence of PandaSet", "lidar/poses.json", "unpack the folder lidar of the sequence, too"),
    ),
    (
        lambda p: any(p.has(f"{image}/data") for image in ("image_00", "image_01", "image_02", "image_03")),
        _missing(
            "a drive of KITTI raw",
            "oxts/data",
            "download its synced+rectified data, which has the poses of the vehicle",
        ),
    ),
    (
        lambda p: p.has("velodyne_points/data") or p.has("oxts/data"),
        _missing("a drive of KITTI raw", "photographs", "download its synced+rectified data"),
    ),
    (
        lambda p: any(p.has(image) for image in ("image_0", "image_2")),
        _missing("a sequence of KITTI odometry", "calib.txt", "unpack data_odometry_calib.zip into the same tree"),
    ),
    (
        lambda p: p.has("data_2d_raw") or p.has("data_3d_raw"),
        _missing(
            "KITTI-360", "perspective pictures", "download the perspective images (data_2d_raw with image_00/data_rect)"
        ),
    ),
    (
        lambda p: p.has("images", "intrinsics", "extrinsics"),
        _missing("a scene of DriveStudio", "ego_pose/", "prepare it again with the key pose among --process_keys"),
    ),
    (
        lambda p: p.has("sensors/cameras") or p.has("sensors/lidar"),
        _missing("a log of Argoverse 2", "city_SE3_egovehicle.feather or calibration/", "download the whole log"),
    ),
    (
        lambda p: p.has("database.db") and not p.has("sparse"),
        _missing("a project of COLMAP", "a model", "run its mapper, which writes sparse/0"),
    ),
    (
        lambda p: _mostly(p, ARCHIVES),
        Unread("holds archives alone", "unpack them where they lie, all into one tree"),
    ),
    (
        lambda p: _mostly(p, VIDEOS),
        Unread("Not a drive: a clip has no poses of cameras", BY_SOLVE),
    ),
    (
        lambda p: _mostly(p, PICTURES) or (p.has("images") and len(p.names) == 1),
        Unread("Not a drive: the folder holds pictures alone, without poses", BY_SOLVE),
    ),
)
"""How each is known; the first that fits is told."""


def _mostly(place: _Place, endings: tuple[str, ...]) -> bool:
    """Whether most of what lies there has one of these endings."""
    own = sum(n.endswith(endings) for n in place.names)
    return own > 0 and 2 * own > len(place.names)


def unread(path: Path) -> Unread | None:
    """What a path is known for, None where it is not."""
    with suppress(OSError):
        if path.is_file():
            place = _Place(path.parent / "\0", frozenset((path.name.lower(),)))
        else:
            with os.scandir(path) as entries:
                names = frozenset(
                    e.name.lower() for e, _ in zip(entries, range(MOST_NAMES), strict=False) if e.name[0] != "."
                )
            place = _Place(path, names)
        return next((told for fits, told in KNOWN if _fits(fits, place)), None)
    return None


def _fits(fits: Callable[[_Place], bool], place: _Place) -> bool:
    with suppress(OSError, ValueError):
        return fits(place)
    return False

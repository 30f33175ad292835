"""An imported drive opens as a Drive again: everything after import knows one layout."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from unveil_core.base.checks.names import is_file_name
from unveil_core.base.disk.open_safely import LARGEST_TEXT, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_own_json
from unveil_core.base.plates.colours import PlateColours
from unveil_core.drives.boxes import read_boxes
from unveil_core.drives.drive import LATEST_S, RATES, Distortion, Drive, Footage, Frame, PointCloud, is_frame_rate
from unveil_core.drives.points import read_points
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["CAMERAS", "imported_files", "is_imported", "pose_facts", "read_imported"]


def read_imported(folder: Path, *, points: bool = True) -> Drive:
    """Open the ``drive/`` folder of a workspace.

    Args:
        points: False leaves the cloud empty, for who works on the scene alone: it grows with the drive.
    Raises:
        DriveError: it is not there or was not written by an import.
    """
    path = folder / "cameras.json"
    try:
        data = read_own_json(path, LARGEST_TEXT)
        frames = tuple(
            Frame(
                name=_own_name(e["name"]),
                camera_name=_own_name(e["camera"]),
                camera=_camera(e, e),
                image_path=_inside(folder, e["image"]),
                semantic_path=_inside(folder, e["semantics"]) if "semantics" in e else None,
                instance_path=_inside(folder, e["instances"]) if "instances" in e else None,
                mask_path=_inside(folder, e["mask"]) if "mask" in e else None,
                ego_path=_inside(folder, e["ego"]) if "ego" in e else None,
                footage=_footage(e, folder),
                timestamp=_finite(e.get("timestamp"), "timestamp", LATEST_S),
                boxes=read_boxes(e.get("boxes"), path, e["name"]),
            )
            for e in data["frames"]
        )
        return Drive(
            root=folder,
            frames=frames,
            points=read_points(folder / "points.ply") if points else PointCloud(np.zeros((0, 3))),
            to_world=Similarity.from_json(data["to_world"]),
            scale_source=str(data["scale_source"]),
            up_source=str(data["up_source"]),
            frame_rate=_rate(data.get("frame_rate")),
            front_cameras=tuple(str(n) for n in data.get("front_cameras") or ()),
            semantic_classes=data["semantic_classes"],
            truth_root=None if data["truth_root"] is None else Path(data["truth_root"]),
            sources=(path, folder / "points.ply"),
        )
    except FileNotFoundError as error:
        raise DriveError("Not found", path=Path(error.filename or path), mend="run `unveil import` again") from error
    except (OSError, KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise DriveError(f"Not an imported drive: {error}", path=path, mend="run `unveil import` again") from error


def pose_facts(folder: Path) -> dict[str, Any]:
    """What an import told of the poses, see ``drives.importing.refined_poses.Refinement.facts``."""
    found = read_own_json(folder / CAMERAS, LARGEST_TEXT).get("poses")
    return found if isinstance(found, dict) else {}


def is_imported(folder: Path) -> bool:
    """Whether a folder is the ``drive/`` of a workspace, by the beginning of its cameras.json: others have such files, too."""
    try:
        with open_file(folder / CAMERAS) as stream:
            return b'"to_world"' in stream.read(MARKED_WITHIN)
    except OSError:
        return False


def imported_files(folder: Path) -> frozenset[str] | None:
    """Names of the files of an imported drive, relative to its folder, as its cameras.json lists them; None where it has none."""
    if (folder / CAMERAS).is_symlink() or not is_imported(folder):
        return None
    try:
        entries = read_own_json(folder / CAMERAS, LARGEST_TEXT)["frames"]
        own = [*entries, *(e["footage"] for e in entries if isinstance(e.get("footage"), dict))]
        named = {e[key] for e in own for key in ("image", *LABELS) if isinstance(e.get(key), str)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return frozenset({CAMERAS, "points.ply", *named})


CAMERAS = "cameras.json"
"""File of an imported drive that is written last."""
LABELS = ("semantics", "instances", "mask", "ego")
"""Keys of a frame's further files there."""
MARKED_WITHIN = 1 << 16
"""Bytes of cameras.json in which the keys of an import come, before the frames."""
SUFFIX = re.compile(r"[A-Za-z0-9]{1,5}")
"""Of a file's name."""


def _own_name(text: object) -> str:
    """A name that import gives: others would lead out of the workspace's folders."""
    if not is_file_name(text):
        raise ValueError(f"not the name of a file: {str(text)[:40]!r}")
    return str(text)


def _inside(folder: Path, name: object) -> Path:
    """The path of a file in the folder."""
    parts = PurePosixPath(str(name)).parts
    # Import names files after frames, whose names may be as long as names can be, and adds a suffix.
    stem, _, suffix = parts[-1].rpartition(".") if parts else ("", "", "")
    last = is_file_name(parts[-1]) or (is_file_name(stem) and SUFFIX.fullmatch(suffix)) if parts else False
    if not last or not all(is_file_name(part) for part in parts[:-1]):
        raise ValueError(f"not a file in this folder: {str(name)[:40]!r}")
    return folder.joinpath(*parts)


def _finite(value: object, key: str, most: float) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
        raise ValueError(f"not a number up to {most:g}: {key}")
    return value


def _rate(value: object) -> float | None:
    rate = _finite(value, "frame_rate", RATES[1])
    return rate if rate is not None and is_frame_rate(rate) else None


def _camera(numbers: dict[str, Any], entry: dict[str, Any]) -> Camera:
    """A camera of size and focal length in ``numbers``, with the pose in ``entry``."""
    width, height = (int(numbers[key]) for key in ("width", "height"))
    fx, fy, cx, cy = (float(numbers[key]) for key in ("fx", "fy", "cx", "cy"))
    pose = np.array(entry["world_to_camera"], dtype=np.float64)
    if not 1 <= min(width, height) <= max(width, height) < 1 << 20:
        raise ValueError(f"a camera of {width}x{height} pixels")
    if not np.isfinite((fx, fy, cx, cy)).all() or min(fx, fy) <= 0:
        raise ValueError("a camera without a focal length or centre")
    if pose.shape != (4, 4) or not np.isfinite(pose).all() or nearest_rotation(pose[:3, :3])[1] > 1e-3:
        raise ValueError("a pose that is none")
    return Camera(width, height, fx, fy, cx, cy, pose)


def _footage(entry: dict[str, Any], folder: Path) -> Footage | None:
    found = entry.get("footage")
    if found is None:
        return None
    lens = found["distortion"]
    distortion = None if lens is None else Distortion(str(lens["model"]), tuple(float(k) for k in lens["coefficients"]))
    if distortion is not None and not np.isfinite(distortion.coefficients).all():
        raise ValueError("a lens that is not finite")
    plate = PlateColours.from_json(found["plate"]) if "plate" in found else None
    return Footage(_inside(folder, found["image"]), _camera(found, entry), distortion, plate)

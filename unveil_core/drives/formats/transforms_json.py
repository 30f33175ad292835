"""Drives as nerfstudio / Instant-NGP ``transforms.json``, with Unveil's additions (all optional).

Poses in the file are camera-to-world with OpenGL axes, unless the user says otherwise; they are turned to OpenCV here and
nowhere else. Principal points count from the outer edge of the first pixel, as nerfstudio's rays do (pixel centres at + 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.checks.conventions import OPENGL
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep
from unveil_core.drives.formats.nerfstudio.depth import assumed_unit, coarse_points, depth_sweeps
from unveil_core.drives.formats.nerfstudio.frames import read_frames
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.drives.formats.nerfstudio.lens import crop_notice, degrees_notice
from unveil_core.drives.formats.nerfstudio.parts import parts_of
from unveil_core.drives.formats.nerfstudio.points import read_named_points
from unveil_core.drives.formats.nerfstudio.shift import shift_told
from unveil_core.drives.formats.nerfstudio.transposed import turned_upright

__all__ = ["read_transforms_json"]


def _is_scale(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf


def _scale_told(keys: Keys, frames: Sequence[Frame], points: PointCloud) -> tuple[float | None, str]:
    """Units per metre and what tells them, see :func:`read_transforms_json`."""
    if keys.get("metric"):
        return 1.0, "metric"
    if keys.get("metric") is not None:
        return None, ""
    scale = keys.number("applied_scale")
    if scale is not None:
        return scale, "applied_scale"
    if keys.get("depth_unit_scale_factor") is not None and any(f.depth_path is not None for f in frames):
        return 1.0, "depth unit"
    return (1.0, "measured points") if points.measured else (None, "")


def _up_told(keys: Keys) -> Float64 | None:
    if keys.get("up") is None:
        return None
    try:
        up = np.asarray(keys.get("up"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise DriveError("Not a direction: up", path=keys.path, mend="three numbers, as [0, 0, 1]")
    up = up / np.abs(up).max()  # squares of the largest and smallest numbers are none
    return np.asarray(up / np.linalg.norm(up))


def _depth_unit(keys: Keys, frames: Sequence[Frame], notices: list[str]) -> float:
    """Units of the drive a step of the depth images: Instant-NGP counts them in units of the poses, nerfstudio in metres."""
    own = keys.number("integer_depth_scale") if keys.get("depth_unit_scale_factor") is None else None
    if own is not None:
        if own <= 0:
            raise DriveError(f"Not above 0: integer_depth_scale {own:g}", path=keys.path, mend="0.001 is usual")
        return own
    first = next(f.depth_path for f in frames if f.depth_path is not None and f.depth_path.is_file())
    unit = keys.number("depth_unit_scale_factor")
    if unit is None:
        unit = assumed_unit(first)
        notices.append(f"depth images are taken to count {unit:g} m; depth_unit_scale_factor decides")
    if unit <= 0:
        raise DriveError(f"Not above 0: depth_unit_scale_factor {unit:g}", path=keys.path, mend="0.001 is usual")
    return unit * (keys.number("applied_scale") or 1.0)


def _points_beside(root: Path) -> str:
    """What to do about points that are not named, by what lies beside the file."""
    held = sorted((p.name for p in root.iterdir() if p.suffix.lower() == ".ply"), key=natural_key)
    if held:
        named = f'set "ply_file_path": "{held[0]}" if its points are measured or of SfM'
        return f"{held[0]} lies beside it: {named}, or give depth images"
    return "set ply_file_path to a PLY of LiDAR or SfM points, or give depth images"


def read_transforms_json(path: Path, pose_convention: str | None = None) -> Drive:
    """Read a drive.

    Scale: ``metric`` decides, where it is given: true, coordinates are metres; false, the scale is unknown. Without it the scale
    is known where the file has ``applied_scale``, which brings what was measured in metres to the poses; where it states the unit
    of its depth images by ``depth_unit_scale_factor``, which brings them to metres and to the poses alike; and where its PLY has
    properties that only laser scanners write, as intensity. ``place_drive`` believes these three only where the cameras are then
    at a height that cameras have. Nothing else tells: depth images alone may be of any unit, and structure from motion has none.

    Up: ``up`` as Instant-NGP writes it, a direction; else it is unknown here.

    Place: ``shift``, three numbers, is what the file leaves out of its coordinates.

    Points: of the PLY that the file names; else of its depth images, as sweeps; else of a COLMAP model beside it; else none.

    Of a folder with ``transforms_train.json``, as those of synthetic NeRFs, the frames of all its parts are read.

    Args:
        path: the JSON file, or the folder that holds it.
        pose_convention: one of ``base.drive_options.POSE_CONVENTIONS``; None = "opengl".
    Raises:
        DriveError: with the file and the mend.
    """
    parts, notices = parts_of(path)
    path, top = parts[0]
    keys = Keys({}, top, path)
    if "applied_scale" in top and not _is_scale(top["applied_scale"]):
        raise DriveError(
            f"Not a scale: applied_scale is {str(top['applied_scale'])[:40]!r}", path=path, mend="correct it"
        )
    pose_convention = pose_convention or OPENGL
    turned = [(file, *turned_upright(held["frames"])) for file, held in parts]
    notices += [line for *_, line in turned if line is not None][:1]
    frames, told = read_frames(
        [(file, {**held, "frames": upright}) for (file, held), (_, upright, _) in zip(parts, turned, strict=True)],
        pose_convention,
    )
    notices += told
    cropped = crop_notice(keys.number("fisheye_crop_radius"), [(f.camera, f.distortion) for f in frames])
    notices += [] if cropped is None else [cropped]
    angles = [e.get(k) for e in (top, *top["frames"]) for k in ("camera_angle_x", "camera_angle_y")]
    degrees = degrees_notice(angles)
    notices += [] if degrees is None or keys.get("fl_x") is not None else [degrees]
    points = PointCloud(np.zeros((0, 3)))
    sources: tuple[Path, ...] = tuple(p for p, _ in parts)
    sweeps: tuple[Sweep, ...] = ()
    with_depth = [f.depth_path for f in frames if f.depth_path is not None]
    missing = [p for p in with_depth if not p.is_file()]
    if keys.get("ply_file_path") or len(missing) == len(with_depth):
        named = read_named_points(keys, frames)
        held = sorted(path.parent.glob("*.ply"))
        if named is None and (missing or held):
            problem = "names no points"
            if missing:
                problem += f", and none of its {len(missing)} depth images is there, the first {missing[0]}"
            raise DriveError(problem, path=path, mend=_points_beside(path.parent))
        if named is not None:
            points, sources = named.cloud, (*sources, *named.sources)
            notices += [] if named.notice is None else [named.notice]
    else:
        sweeps = depth_sweeps(frames, _depth_unit(keys, frames, notices))
        if missing:
            notices.append(f"{len(missing)} of {len(with_depth)} depth images are not there, the first {missing[0]}")
    units_per_metre, scale_source = _scale_told(keys, frames, points)
    up = _up_told(keys)
    if sweeps and (up is None or scale_source != "metric"):
        points = coarse_points(sweeps)
    truth = path.parent / "truth"
    return Drive(
        root=path,
        frames=tuple(frames),
        points=points,
        to_world=shift_told(keys),
        units_per_metre=units_per_metre,
        scale_source=scale_source,
        up=up,
        semantic_classes=keys.get("semantic_classes"),
        truth_root=truth if truth.is_dir() else None,
        sources=sources,
        sweeps=sweeps,
        notices=tuple(notices),
        pose_convention=pose_convention,
        keeps_origin=keys.get("keep_origin") is True,
    )

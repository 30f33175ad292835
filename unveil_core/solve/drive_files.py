"""The drive that a solve writes: transforms.json with all that an import asks for, and a COLMAP text model of the same cameras."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.output.written import GENERATOR
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points
from unveil_core.geometry.lens import FISHEYE
from unveil_core.geometry.transforms import rigid_inverse, rotation_to_quat
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.mapping.model import Lens, Model

__all__ = ["write_drive"]

TO_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def write_drive(
    folder: Path,
    model: Model,
    reels: Sequence[Reel],
    points: PointCloud,
    *,
    sure_of_metres: bool,
    labels: dict[FootageFrame, str],
    masks: dict[FootageFrame, str],
) -> None:
    """Write ``transforms.json``, ``points.ply`` and ``sparse/0`` of a model in metres with z up.

    Args:
        folder: of the drive; photographs are in its ``images/`` already.
        points: that the scene starts from; the model's own go to ``sparse/0``.
        sure_of_metres: they are known, not assumed.
        labels, masks: files of frames that have such, relative to ``folder``.
    """
    number = {n: i for i, n in enumerate(model.names)}
    frames: list[dict[str, Any]] = []
    for reel in reels:
        for frame in reel.frames:
            if frame.file not in number:
                continue
            i = number[frame.file]
            entry: dict[str, Any] = {
                "file_path": f"images/{frame.file}",
                "transform_matrix": (rigid_inverse(model.poses[i]) @ TO_OPENGL).tolist(),
                "camera": frame.camera,
                **_lens_keys(model.lenses[int(model.lens[i])]),
            }
            if frame.time_s is not None:
                entry["timestamp"] = frame.time_s + (reel.begun or 0.0)
            if frame in labels:
                entry["semantic_path"] = labels[frame]
            if frame in masks:
                entry["mask_path"] = masks[frame]
            frames.append(entry)
    write_points(points, folder / "points.ply")
    _write_colmap(folder / "sparse/0", model)
    content: dict[str, Any] = {"generator": GENERATOR, "metric": sure_of_metres, "up": [0.0, 0.0, 1.0]}
    content |= {"ply_file_path": "points.ply", **({"semantic_classes": "cityscapes"} if labels else {})}
    write_json_atomic(folder / "transforms.json", {**content, "frames": frames})


def _lens_keys(lens: Lens) -> dict[str, Any]:
    fx, fy, cx, cy = lens.pinhole
    keys: dict[str, Any] = {"w": lens.width, "h": lens.height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
    found = lens.distortion
    if found is None:
        return {"camera_model": "PINHOLE", **keys}
    if found.model == FISHEYE:
        names: tuple[str, ...] = ("k1", "k2", "k3", "k4")
        return {"camera_model": FISHEYE, **keys, **dict(zip(names, found.coefficients, strict=False))}
    names = ("k1", "k2", "p1", "p2")
    return {"camera_model": "OPENCV", **keys, **dict(zip(names, found.coefficients, strict=False))}


def _write_colmap(folder: Path, model: Model) -> None:
    """``cameras.txt``, ``images.txt`` and ``points3D.txt`` as COLMAP's documentation describes them."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"]
    for k, lens in enumerate(model.lenses, start=1):
        lines.append(f"{k} {lens.model} {lens.width} {lens.height} {' '.join(map(repr, lens.parameters))}")
    _put(folder / "cameras.txt", lines)
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[] as X Y POINT3D_ID"]
    quats = rotation_to_quat(model.poses[:, :3, :3])
    order = np.argsort(model.seen_by, kind="stable")
    ends = np.searchsorted(model.seen_by[order], np.arange(len(model.names) + 1))
    place_in_image = np.zeros(len(order), np.int64)
    for i, name in enumerate(model.names):
        pose = [*quats[i].tolist(), *model.poses[i, :3, 3].tolist()]
        lines.append(f"{i + 1} {' '.join(map(repr, pose))} {int(model.lens[i]) + 1} {name}")
        own = order[ends[i] : ends[i + 1]]
        place_in_image[own] = np.arange(len(own))
        lines.append(
            " ".join(f"{x:.3f} {y:.3f} {p + 1}" for (x, y), p in zip(model.pixels[own], model.seen[own], strict=True))
        )
    _put(folder / "images.txt", lines)
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX"]
    order = np.argsort(model.seen, kind="stable")
    ends = np.searchsorted(model.seen[order], np.arange(len(model.points) + 1))
    for p, place in enumerate(model.points.tolist()):
        own = order[ends[p] : ends[p + 1]]
        track = " ".join(f"{int(model.seen_by[k]) + 1} {place_in_image[k]}" for k in own)
        lines.append(f"{p + 1} {' '.join(map(repr, place))} 128 128 128 {model.errors[p]:.4f} {track}")
    _put(folder / "points3D.txt", lines)


def _put(path: Path, lines: list[str]) -> None:
    text = io.StringIO()
    text.writelines(f"{line}\n" for line in lines)
    write_bytes_atomic(path, text.getvalue().encode())

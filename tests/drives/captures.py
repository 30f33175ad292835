"""Captures of a street that bends, as people's tools write them: pictures of a few pixels, but true poses, points and names."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from unveil_core.drives.drive import Drive, PointCloud, tracks
from unveil_core.drives.points import write_points
from unveil_core.geometry.transforms import opengl_to_opencv, rigid_inverse, rotation_to_quat

SIZE = (16, 12)
FOCAL = 12.0
STEP_M = 1.2
RADIUS_M = 60.0


def pose(at: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0), yaw_deg: float = 0.0) -> np.ndarray:
    """OpenGL camera-to-world so many metres along the street, 1.6 m above it.

    Args:
        offset: of the camera in the vehicle, metres to the right, up and ahead; yaw_deg: to the left of ahead.
    """
    turn = at / RADIUS_M
    ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
    right, up = np.array([ahead[1], -ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
    middle = RADIUS_M * np.array([np.sin(turn), 1 - np.cos(turn), 0.0]) + 1.6 * up
    yaw = np.radians(yaw_deg)
    looks = np.cos(yaw) * ahead - np.sin(yaw) * right
    found = np.eye(4)
    found[:3, 0], found[:3, 1], found[:3, 2] = np.cross(looks, up), up, -looks
    found[:3, 3] = middle + offset[0] * right + offset[1] * up + offset[2] * ahead
    return found


def street_points() -> PointCloud:
    """Of the ground along the street."""
    generator = np.random.default_rng(0)
    at, across = generator.uniform(0, 40, 500), generator.uniform(-5, 5, 500)
    turn, radius = at / RADIUS_M, RADIUS_M + across
    places = np.stack([radius * np.sin(turn), RADIUS_M - radius * np.cos(turn), np.zeros(500)], axis=1)
    return PointCloud(places, np.full((500, 3), 128, np.uint8))


def write_picture(path: Path, level: int = 90, size: tuple[int, int] = SIZE) -> None:
    """A grey picture with a black corner, in the format of its suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    picture = np.full((size[1], size[0]), level, np.uint8)
    picture[: size[1] // 3, : size[0] // 3] = 0
    done, content = cv2.imencode({".jpeg": ".jpg"}.get(path.suffix.lower(), path.suffix.lower()), picture)
    assert done
    path.write_bytes(content.tobytes())


def frame(name: str, at: float, *, mount: dict[str, Any] | None = None, **keys: Any) -> dict[str, Any]:
    """An entry of a transforms.json, with its true place along the street."""
    return {"file_path": name, "transform_matrix": pose(at, **(mount or {})).tolist(), **keys}


def frames(names: Sequence[str], order: Sequence[int] | None = None, **keys: Sequence[Any]) -> list[dict[str, Any]]:
    """Entries of pictures that were taken one after the other, in the order in which the file has them."""
    found = [
        frame(name, STEP_M * i, **{key: values[i] for key, values in keys.items()}) for i, name in enumerate(names)
    ]
    return found if order is None else [found[i] for i in order]


def write_transforms(
    folder: Path, entries: Sequence[dict[str, Any]], *, pictures: Sequence[str] | None = None, **top: Any
) -> Path:
    """A transforms.json with its pictures and points.

    Args:
        pictures: that lie there; None = those that the entries name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in [e["file_path"] for e in entries] if pictures is None else pictures:
        write_picture(folder / name)
    write_points(street_points(), folder / "points.ply")
    lens = {"w": SIZE[0], "h": SIZE[1], "fl_x": FOCAL, "fl_y": FOCAL, "metric": True, "ply_file_path": "points.ply"}
    path = folder / "transforms.json"
    path.write_text(json.dumps({**lens, **top, "frames": list(entries)}))
    return path


def write_model(
    folder: Path,
    images: Sequence[tuple[str, float]] | Sequence[tuple[str, np.ndarray]],
    *,
    cameras: Sequence[int] | None = None,
    focal: Sequence[float] = (FOCAL,),
    observations: bool = True,
    tracks: int = 3,
    place: tuple[float, np.ndarray, np.ndarray] | None = None,
) -> Path:
    """A COLMAP text model of pictures at places along the street, or with OpenGL poses.

    Args:
        cameras: ids of their lenses, all 1 by default; focal: of the lenses.
        observations: whether each image has its second line; tracks: images that see a point.
        place: scale, rotation and shift of its coordinates.
    """
    scale, rotation, shift = place or (1.0, np.eye(3), np.zeros(3))
    folder.mkdir(parents=True, exist_ok=True)
    lenses = [f"{k} SIMPLE_PINHOLE {SIZE[0]} {SIZE[1]} {f} {SIZE[0] / 2} {SIZE[1] / 2}" for k, f in enumerate(focal, 1)]
    (folder / "cameras.txt").write_text("\n".join(lenses) + "\n")
    lines = ["# Image list with two lines of data per image:"]
    for k, (name, at) in enumerate(images, 1):
        to_world = opengl_to_opencv(at if isinstance(at, np.ndarray) else pose(at))
        to_world[:3, :3], to_world[:3, 3] = rotation @ to_world[:3, :3], scale * rotation @ to_world[:3, 3] + shift
        own = rigid_inverse(to_world)
        numbers = [*rotation_to_quat(own[:3, :3]).tolist(), *own[:3, 3].tolist()]
        lines.append(f"{k} {' '.join(map(repr, numbers))} {cameras[k - 1] if cameras else 1} {name}")
        lines += ["1.5 2.5 1 3.5 4.5 -1"] * observations
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    places = street_points().positions * scale @ rotation.T + shift
    (folder / "points3D.txt").write_text(
        "".join(f"{k} {x!r} {y!r} {z!r} 9 9 9 0.5{' 1 0' * tracks}\n" for k, (x, y, z) in enumerate(places.tolist(), 1))
    )
    return folder


def write_pictures(folder: Path, names: Sequence[str]) -> None:
    """Grey pictures of these names."""
    for name in names:
        write_picture(folder / name)


def way(drive: Drive) -> dict[str, float]:
    """Metres that each camera goes from frame to frame, in the drive's own units."""
    found = {}
    for track in tracks(drive):
        centres = np.stack([drive.frames[i].camera.centre for i in track])
        found[drive.frames[track[0]].camera_name] = float(np.linalg.norm(np.diff(centres, axis=0), axis=1).sum())
    return found


def move(source: Path, target: Path) -> None:
    """Rename a file, making the folders for it."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.move(source, target)

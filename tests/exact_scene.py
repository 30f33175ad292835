"""A workspace of the small street whose scene is made of the truth itself, a surfel a pixel: known without a reconstruction."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.small_street import BUILDING, CAR, HIGH, LOW, SKY, cast, make_small_street
from unveil_core.base.files import write_json_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.labels import SceneLabels, choose_labels
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.sky import fit_sky, save_sky
from unveil_core.surfels.surfels import Surfels, concatenate


def true_planes(camera: Camera, offset: np.ndarray, crowded: bool) -> tuple[np.ndarray, np.ndarray]:
    """Depth along the optical axis (H, W), inf for the sky, and classes (H, W) that a camera of the drive sees."""
    depth, kind = cast(camera.centre + offset, camera.rays().reshape(-1, 3), crowded)
    shape = (camera.height, camera.width)
    return depth.reshape(shape), kind.reshape(shape)


def true_normals(points: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """(N, 3) of places of the street in the world: ground, walls, and the sides of the car."""
    normal = np.zeros_like(points)
    normal[:, 2] = 1
    wall = kind == BUILDING
    normal[wall] = np.stack([0 * points[wall, 0], -np.sign(points[wall, 1]), 0 * points[wall, 0]], axis=1)
    car = np.flatnonzero(kind == CAR)
    gap = np.concatenate([points[car] - LOW, HIGH - points[car]], axis=1)
    side = np.abs(gap).argmin(axis=1)
    normal[car] = np.concatenate([-np.eye(3), np.eye(3)])[side]
    return normal


def exact_surfels(drive: Drive, labels: SceneLabels, empty: Path | None) -> Surfels:
    """Surfels of every pixel that the recorded cameras see: of the photographs, or of true pictures in a folder."""
    parts = []
    for frame in drive.frames:
        camera = frame.camera
        depth, kind = true_planes(camera, drive.to_world.translation, crowded=empty is None)
        image = read_image(frame.image_path if empty is None else empty / f"{frame.name}.png")
        hit = np.isfinite(depth)
        points = camera.unproject(np.where(hit, depth, 0))[hit]
        label = labels.labels.compact(kind.astype(np.uint8))[hit]
        normal = true_normals(points + drive.to_world.translation, kind[hit])
        size = depth[hit] / camera.fx
        parts.append(
            surfels_from_points(points, image[hit], label, normal, size, sh_degree=0, opacity=0.95, scale_factor=0.8)
        )
    return concatenate(parts)


def build_exact_workspace(root: Path) -> Path:
    """``street/`` and beside it a workspace as ``drive`` with ``surfels/``; returns the workspace."""
    street = make_small_street(root / "street")
    workspace = root / "workspace"
    drive = import_drive(open_drive(street), workspace / "drive")
    labels = choose_labels(drive, ("car",))
    write_json_atomic(workspace / "labels.json", labels.to_json())
    for state, empty in (("full", None), ("empty", street.parent / "truth/images")):
        write_surfels(exact_surfels(drive, labels, empty), workspace / f"surfels/{state}.ply", to_world=drive.to_world)
    samples = []
    for frame in drive.frames:
        _, kind = true_planes(frame.camera, drive.to_world.translation, crowded=True)
        samples.append((frame.camera, read_image(frame.image_path), kind == SKY))
    save_sky(fit_sky(samples, UP), workspace / "surfels/sky.npz")
    state = {"format": 1, "generator": "unveil", "drive": str(street), "settings": {}, "stages": {}}
    write_json_atomic(workspace / "workspace.json", state)
    return workspace

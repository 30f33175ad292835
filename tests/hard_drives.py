"""Small drives with one thing wrong each: the street of :mod:`tests.small_street` in thumbnails, spoilt on disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch

from tests.small_street import CAR, FOCAL, HEIGHT, WIDTH, lidar, picture, pose_at
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.drives.points import read_points, write_points
from unveil_core.evaluate.held_out import evaluate_views
from unveil_core.optimize.exposure import fit_exposures
from unveil_core.optimize.presets import ReconstructSettings
from unveil_core.optimize.reconstruct import reconstruct
from unveil_core.optimize.start import StartSettings
from unveil_core.pipeline.settings import RunSettings
from unveil_core.semantics.labels import choose_labels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.workspace import Workspace

SHRINK = 2
DRAFT = RunSettings(quality="draft", iterations=60, splats=6000)
"""A run of seconds, for drives in thumbnails."""
LONGER = RunSettings(quality="draft", iterations=150, splats=8000)
"""Where frames are judged."""
SETTINGS = ReconstructSettings(iterations=60, sh_degree=0, start=StartSettings(budget=6000), budget=8000)
LINE = [float(i) for i in range(8)]


def make_tiny_street(folder: Path, places: Sequence[float], *, rays: int = 1500, shrink: int = SHRINK) -> Path:
    """A drive with frames at the given metres down the street; returns the path of transforms.json."""
    return make_tiny_drive(folder, [pose_at(x) for x in places], rays=rays, shrink=shrink)


def make_tiny_drive(folder: Path, poses: Sequence[np.ndarray], *, rays: int = 1500, shrink: int = SHRINK) -> Path:
    """A drive with frames of the given OpenGL poses (4, 4) on the street; returns the path of transforms.json."""
    (folder / "images").mkdir(parents=True)
    (folder / "semantics").mkdir()
    generator = np.random.default_rng(0)
    frames, cloud = [], []
    drawn: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    for i, pose in enumerate(poses):
        if pose.tobytes() not in drawn:
            drawn[pose.tobytes()] = picture(pose, True, shrink)
        image, kind = drawn[pose.tobytes()]
        cv2.imwrite(str(folder / f"images/{i:03d}.png"), image)
        cv2.imwrite(str(folder / f"semantics/{i:03d}.png"), kind)
        frames.append(
            {
                "file_path": f"images/{i:03d}.png",
                "semantic_path": f"semantics/{i:03d}.png",
                "transform_matrix": pose.tolist(),
            }
        )
        cloud.append(lidar(pose, rays, generator))
    write_points(PointCloud(np.concatenate(cloud)), folder / "points.ply")
    width, height = WIDTH // shrink, HEIGHT // shrink
    document = {
        "w": width,
        "h": height,
        "fl_x": FOCAL / shrink,
        "fl_y": FOCAL / shrink,
        "cx": width / 2,
        "cy": height / 2,
        "metric": True,
        "ply_file_path": "points.ply",
        "semantic_classes": "cityscapes",
        "frames": frames,
    }
    path = folder / "transforms.json"
    path.write_text(json.dumps(document))
    return path


def move(path: Path, offset: np.ndarray) -> None:
    """Shift the whole drive."""
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        for axis in range(3):
            frame["transform_matrix"][axis][3] += float(offset[axis])
    path.write_text(json.dumps(document))
    replace_points(path, lambda points: points + offset)


def replace_points(path: Path, change: Callable[[np.ndarray], np.ndarray]) -> None:
    """Put other points into the drive."""
    file = path.parent / "points.ply"
    write_points(PointCloud(change(read_points(file).positions)), file)


def replace_images(path: Path, folder: str, change: Callable[[np.ndarray, int], np.ndarray]) -> None:
    """Change the pictures of a folder; ``change`` gets each and its number."""
    for i, file in enumerate(sorted((path.parent / folder).iterdir())):
        cv2.imwrite(str(file), change(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), i))


def salted(labels: np.ndarray, share: float, seed: int) -> np.ndarray:
    """Labels of which a share, pixel by pixel, is another one that occurs."""
    generator = np.random.default_rng(seed)
    known = np.unique(labels)
    wrong = generator.random(labels.shape) < share
    return np.where(wrong, generator.choice(known, labels.shape), labels).astype(np.uint8)


def with_blob(labels: np.ndarray, share: float, seed: int) -> np.ndarray:
    """Labels in which one square of that share of the image is a car."""
    generator = np.random.default_rng(seed)
    side = max(1, round((share * labels.size) ** 0.5))
    row, column = (int(generator.integers(0, n - side)) for n in labels.shape)
    spoilt = labels.copy()
    spoilt[row : row + side, column : column + side] = CAR
    return spoilt


def unchanged_outside(root: Path, drive: Path) -> bool:
    """Whether all frames of a workspace are there, and equal the photographs where nothing was removed."""
    images = drive.parent / "images"
    for photograph in sorted(images.rglob("*.png")):
        name = photograph.relative_to(images)
        name = name if len(name.parts) > 1 else Path("camera") / name
        changed = [read_label_image(root / "masks" / kind / name) > 0 for kind in ("removed", "shadows")]
        delivered = read_image(root / "frames" / name)
        if not (delivered == read_image(photograph))[~(changed[0] | changed[1])].all():
            return False
    return True


@dataclass
class Outcome:
    surfels: Surfels
    psnr: float
    miou: float


def reconstructed(path: Path, *, judges: Path | None = None) -> Outcome:
    """The scene of a drive, judged by (at most ten of) the frames that it was fitted to, or the same ones of another drive."""
    drive = open_drive(path)
    check_drive(drive)
    drive = localized(drive)
    scene = choose_labels(drive)
    exposures = fit_exposures(drive)
    done = reconstruct(drive, scene, SETTINGS, exposures=exposures)
    surfels, sky = done.surfels, done.sky
    for values in (surfels.means, surfels.quats, surfels.log_scales, surfels.opacity_logits, surfels.sh, sky.texture):
        assert bool(torch.isfinite(values).all())
    frames = list((drive if judges is None else localized(open_drive(judges))).frames)
    frames = frames[:: max(1, len(frames) // 10)]
    scores = evaluate_views(
        surfels, sky, frames, scene, near=NEAR_M, far=FAR_M, align_exposure=not exposures.is_identity
    )
    return Outcome(surfels, scores["psnr"], scores["miou"])


def photographs(path: Path) -> list[np.ndarray]:
    return [cv2.imread(str(p)) for p in sorted((path.parent / "images").iterdir())]


def check_frames(workspace: Workspace, path: Path, least_psnr: float) -> None:
    """Delivered frames are the photographs outside the masks; renders are like them there."""
    errors = []
    for i, photograph in enumerate(photographs(path)):
        changed = np.zeros(photograph.shape[:2], bool)
        for kind in ("removed", "shadows"):
            changed |= cv2.imread(str(workspace.root / f"masks/{kind}/camera/{i:03d}.png"), 0) > 0
        delivered, render = (
            cv2.imread(str(workspace.root / f"{n}/camera/{i:03d}.png")).astype(int) for n in ("frames", "renders")
        )
        assert (delivered == photograph)[~changed].all() and not changed.all()
        errors.append(float(((render - photograph)[~changed] ** 2).mean()))
    assert 10 * np.log10(255**2 / np.mean(errors)) > least_psnr

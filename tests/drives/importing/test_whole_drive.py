"""Images that are reduced on import: labels, instances and masks stay in register with the photograph."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.small_rig import FRONT, LEFT, RIGHT, make_small_rig
from unveil_core.base.files import read_image, read_instance_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.drive import PointCloud, tracks
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.points import write_points
from unveil_core.semantics.classes import CITYSCAPES

SAMPLE = Path(__file__).parents[3] / "sample_scenes/parked_street"
SIZE = (1920, 1280)
CAR = CITYSCAPES.index("car")


def enlarged(plane: np.ndarray) -> np.ndarray:
    """A mask of the sample at the size of real footage, turned a little: its edges lie anywhere between the reduced pixels."""
    place = cv2.getRotationMatrix2D((960, 640), 4.0, 1.0) @ np.diag([5.0, 5.0, 1.0])
    return cv2.warpAffine(plane.astype(np.float32), place, SIZE, flags=cv2.INTER_LINEAR) > 0.5


def shift(photograph: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(2,) how far, in pixels, ``labels`` (H, W) bool lie to the right of and below the same edges in a photograph (H, W).

    By least squares over all edges: what is shifted by d differs by -d times the slope.
    """
    smooth, found = (cv2.GaussianBlur(p.astype(np.float64), (0, 0), 2.0) for p in (photograph, labels))
    down, right = np.gradient(smooth)
    slopes = np.stack([right.ravel(), down.ravel()], axis=1)
    return np.linalg.lstsq(slopes, (smooth - found).ravel(), rcond=None)[0]


@pytest.mark.parametrize(("width", "model"), [(768, "PINHOLE"), (960, "PINHOLE"), (1024, "PINHOLE"), (768, "OPENCV")])
def test_reduced_labels_are_not_shifted_against_the_photograph(tmp_path: Path, width: int, model: str) -> None:
    """A frame of the sample as if rendered at 1920x1280; the photograph shows cars white, their outline is the labels'."""
    car = enlarged(cv2.imread(str(SAMPLE / "semantics/0000.png"), cv2.IMREAD_UNCHANGED) == CAR)
    assert 0.02 < car.mean() < 0.5
    pictures = {
        "image": np.repeat(np.where(car, 255, 0).astype(np.uint8)[..., None], 3, axis=2),
        "semantics": np.where(car, CAR, 0).astype(np.uint8),
        "instances": np.where(car, 4321, 0).astype(np.uint16),
        # Masks drawn by hand have soft borders; 0 means remove, whatever is more means keep.
        "mask": np.where(car, 0, 200 + np.arange(SIZE[0]) % 50).astype(np.uint8),
    }
    frame: dict[str, object] = {"file_path": "image.png", "transform_matrix": np.eye(4).tolist()}
    frame |= {"semantic_path": "semantics.png", "instance_path": "instances.png", "mask_path": "mask.png"}
    for name, picture in pictures.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), picture)
    write_points(PointCloud(np.random.default_rng(0).normal(size=(50, 3)), None), tmp_path / "points.ply")
    lens = {"k1": -0.05, "k2": 0.01, "p1": 0.0, "p2": 0.0} if model == "OPENCV" else {}
    document = {
        "w": SIZE[0],
        "h": SIZE[1],
        "fl_x": 1370.0,
        "fl_y": 1370.0,
        "cx": 960.0,
        "cy": 640.0,
        "camera_model": model,
        **lens,
        "semantic_classes": "cityscapes",
        "metric": True,
        "ply_file_path": "points.ply",
        "frames": [frame],
    }
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    done = import_drive(open_drive(tmp_path), tmp_path / "ws" / "drive", work_side=width).frames[0]
    assert done.semantic_path is not None and done.instance_path is not None and done.mask_path is not None
    photograph = read_image(done.image_path)[..., 0] / 255
    assert photograph.shape == (round(1280 * width / 1920), width)
    for name, found in {
        "semantics": read_label_image(done.semantic_path) == CAR,
        "instances": read_instance_image(done.instance_path) == 4321,
        "mask": read_label_image(done.mask_path) == 0,
    }.items():
        assert found.shape == photograph.shape
        assert np.abs(shift(photograph, found)).max() < 0.1, name
        assert abs(found.sum() / photograph.sum() - 1) < 0.01, name


def test_a_rig_keeps_its_rate_its_sizes_and_its_front_camera(tmp_path: Path) -> None:
    path = make_small_rig(tmp_path / "rig", [replace(LEFT, every=3), RIGHT, FRONT], np.arange(7.0))
    drive = import_drive(replace(open_drive(path), front_cameras=("front",)), tmp_path / "drive", work_side=60)
    # The left camera takes every third: the rate is that of the others.
    assert drive.frame_rate == 10.0 and drive.front_cameras == ("front",)
    sizes = {f.camera_name: read_image(f.image_path).shape[1::-1] for f in drive.frames}
    assert sizes["front"] == sizes["left"] == (60, 38) and sizes["right"] == (56, 30)
    assert [len(track) for track in tracks(drive)] == [3, 7, 7]
    # Read as a drive again it has all its cameras.
    assert len(open_drive(drive.root).frames) == 17 and open_drive(drive.root).front_cameras == ()
    bare = read_imported(drive.root, points=False)
    assert len(drive.points.positions) and not len(bare.points.positions)
    assert [f.image_path for f in bare.frames] == [f.image_path for f in drive.frames]

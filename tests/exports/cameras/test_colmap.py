"""The COLMAP model as pycolmap reads it, in a process of its own, for its libraries and torch's do not always agree; and by the
rules of 3D Gaussian Splatting, which trains on it in single precision."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.readers.gaussian_splatting import read_as_3dgs
from tests.exports.street import FRAMES, HEIGHT, LARGER, LENS, WIDTH, WORLD
from tests.exports.variants import BROWN, FISHEYE, RATIONAL, Entry, variant
from unveil_core.app.cli import main
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Distortion, Frame
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.geometry.lens import distorted

READ = """
import json, sys, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
def pose(image):
    found = image.cam_from_world
    return (found() if callable(found) else found).matrix().tolist()
cameras = {k: [c.model.name, c.width, c.height, list(c.params)] for k, c in model.cameras.items()}
images = {i.name: [i.camera_id, pose(i)] for i in model.images.values()}
points = [[list(p.xyz), list(map(int, p.color))] for _, p in sorted(model.points3D.items())]
json.dump({"cameras": cameras, "images": images, "points": points}, sys.stdout)
"""


def test_unveil_opens_it_again(street: Street, tmp_path: Path) -> None:
    assert main(["export", str(street.root), "--to", "colmap", "-o", str(tmp_path / "out")]) == 0
    drive = open_drive(tmp_path / "out/colmap")
    assert [f.name for f in drive.frames] == [f.name for f in street.job.drive.frames]
    there = np.array([WORLD.camera_to_world(f.camera).centre for f in street.job.drive.frames])
    found = np.array([f.camera.centre for f in drive.frames])
    np.testing.assert_allclose(found - found[0], there - there[0], atol=1e-2)
    assert len(drive.points.positions) == len(street_points(street.job).cloud.positions) and drive.points.measured


def read_by_pycolmap(folder: Path) -> dict[str, Any]:
    if find_spec("pycolmap") is None:
        pytest.skip("pycolmap is not installed")
    done = subprocess.run([sys.executable, "-c", READ, str(folder / "sparse/0")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout[done.stdout.index("{") :])
    return found


def exported(job: Job, out: Path, *options: str) -> Path:
    assert main(["export", str(job.workspace.root), "--to", "colmap", "-o", str(out), *options]) == 0
    return out / "colmap"


def pixels_of(frame: Frame, points: np.ndarray) -> np.ndarray:
    """(N, 2) where the footage of a frame shows local points (N, 3)."""
    assert frame.footage is not None
    camera, lens = frame.footage.camera, frame.footage.distortion
    local = points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    flat = local[:, :2] / local[:, 2:]
    flat = flat if lens is None else distorted(lens.model, lens.coefficients, flat)
    return flat * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def shown_points(job: Job) -> np.ndarray:
    """(N, 3) local points that are before all cameras."""
    points = street_points(job).cloud.positions
    depths = [points @ f.camera.world_to_camera[2, :3] + f.camera.world_to_camera[2, 3] for f in job.drive.frames]
    return points[np.min(depths, axis=0) > 2][::20]


def test_pycolmap_reads_the_same_cameras_and_points(street: Street) -> None:
    folder = street.exported("colmap")
    found = read_by_pycolmap(folder)
    ((model, width, height, numbers),) = found["cameras"].values()
    frame = street.job.drive.frames[0]
    assert frame.footage is not None
    c = frame.footage.camera
    assert (model, width, height) == ("OPENCV", WIDTH * LARGER, HEIGHT * LARGER)
    np.testing.assert_allclose(numbers, [c.fx, c.fy, c.cx, c.cy, *LENS["coefficients"][:4]], rtol=1e-12)
    assert sorted(found["images"]) == [f"{i:04d}.png" for i in range(FRAMES)]
    told = json.loads((folder / "export.json").read_text())
    shift = np.array(told["coordinates"]["shift"])
    for own in street.job.drive.frames:
        assert told["images"][f"{own.name}.png"] == {"camera": "front", "source": own.name, "timestamp": own.timestamp}
        pose = np.array(found["images"][f"{own.name}.png"][1])
        expected = WORLD.camera_to_world(own.camera)
        np.testing.assert_allclose(pose[:, :3], expected.world_to_camera[:3, :3], atol=1e-9)
        np.testing.assert_allclose(-pose[:, :3].T @ pose[:, 3] + shift, expected.centre, atol=1e-7)
    cloud = street_points(street.job).cloud
    np.testing.assert_allclose(
        np.array([p[0] for p in found["points"]]) + shift, WORLD.to_world(cloud.positions), atol=1e-6
    )
    np.testing.assert_array_equal([p[1] for p in found["points"]], cloud.colors)
    # The text tells the shift, too, where readers see a comment.
    assert f"these + {' '.join(map(repr, shift.tolist()))}\n" in (folder / "sparse/0/images.txt").read_text()


def rig(number: int, entry: Entry) -> None:
    """Two cameras whose frames are called alike."""
    entry["camera"], entry["name"] = ("front", "rear")[number % 2], f"{number // 2:04d}"


def odd(number: int, entry: Entry) -> None:
    """Names that systems and programs take for others."""
    entry["camera"], entry["name"] = "Straße 1", ("a b.1", "A_b.2", "a_b 1")[number]


@pytest.mark.parametrize(
    ("edit", "names"),
    [
        (lambda number, entry: None, ["0000", "0001", "0002"]),
        (rig, ["front_0000", "front_0001", "rear_0000"]),
        (odd, ["A_b_2", "a_b_1", "a_b_1_2"]),
    ],
    ids=["one camera", "a rig", "odd names"],
)
@pytest.mark.parametrize("lens", [BROWN, RATIONAL, FISHEYE, None], ids=["brown", "rational", "fisheye", "none"])
def test_3dgs_finds_each_picture_and_draws_the_points_where_they_are(
    edit: Any, names: list[str], lens: dict[str, Any] | None, street: Street, tmp_path: Path
) -> None:
    def changed(number: int, entry: Entry) -> None:
        edit(number, entry)
        entry["footage"]["distortion"] = lens
        entry["footage"]["cx"] += 9.3  # 3DGS takes the middle of the picture

    job = variant(street, tmp_path / "workspace", changed)
    folder = exported(job, tmp_path, "--undistorted")
    views, points = read_as_3dgs(folder)
    assert [v.name for v in views] == names
    cloud = street_points(job).cloud
    assert len(points) == len(cloud.positions) and np.abs(points).max() < 100  # single precision is fine there
    told = json.loads((folder / "export.json").read_text())
    place, some = job.drive.to_world, shown_points(job)
    there = place.to_world(some) - np.array(told["coordinates"]["shift"])
    frames = {(f.camera_name, f.name): f for f in job.drive.frames}
    for view in views:
        source = told["images"][view.picture.name]
        frame = frames[source["camera"], source["source"]]
        picture = cv2.imread(str(view.picture), cv2.IMREAD_UNCHANGED)
        assert picture.shape[:2] == (view.height, view.width) and picture.dtype == np.uint16
        camera = frame.camera
        local = some @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        expected = local[:, :2] / local[:, 2:] * view.focal + np.array([view.width, view.height]) / 2
        # A lens is taken out such that the middle is exact; without one, pictures are cropped by whole pixels.
        np.testing.assert_allclose(view.pixels(there), expected, atol=0.01)
        footage = pixels_of(frame, some)
        inside = ((expected > 3) & (expected < np.array([view.width, view.height]) - 3)).all(axis=1)
        assert inside.sum() > 20
        whole = cv2.imread(str(job.delivered(frame)), cv2.IMREAD_UNCHANGED).astype(np.float64)
        _check_same_content(whole, picture.astype(np.float64), footage[inside], expected[inside], exact=lens is None)


def _check_same_content(
    whole: np.ndarray, picture: np.ndarray, at_whole: np.ndarray, at_picture: np.ndarray, *, exact: bool
) -> None:
    """A picture shows at its positions what the delivered one shows at its own."""
    if exact:
        # Whole pixels were cut off: the noise of the picture tells by how many, and the pixels are the same, bit for bit.
        rows, columns = len(whole) - len(picture), whole.shape[1] - picture.shape[1]
        cuts = [(r, c) for r in {0, rows} for c in {0, columns}]
        matches = [np.array_equal(whole[r : r + len(picture), c : c + picture.shape[1]], picture) for r, c in cuts]
        assert sum(matches) == 1
        cut = np.array(cuts[matches.index(True)][::-1])
        assert np.abs(at_whole - cut - at_picture).max() <= 0.26
        return
    values = [
        cv2.remap(p, (at - 0.5).astype(np.float32)[:, None], None, cv2.INTER_LINEAR)[:, 0]
        for p, at in (
            (cv2.GaussianBlur(whole, (0, 0), 2), at_whole),
            (cv2.GaussianBlur(picture, (0, 0), 2), at_picture),
        )
    ]
    assert np.corrcoef(values[0].ravel(), values[1].ravel())[0, 1] > 0.9


def test_3dgs_refuses_a_lens_that_stays(street: Street) -> None:
    with pytest.raises(ValueError, match="camera model OPENCV is not handled"):
        read_as_3dgs(street.exported("colmap"))


@pytest.mark.parametrize(
    ("lens", "model", "count"),
    [(BROWN, "FULL_OPENCV", 12), (RATIONAL, "FULL_OPENCV", 12), (FISHEYE, "OPENCV_FISHEYE", 8)],
)
def test_lenses_and_rigs_as_colmap_has_them(
    lens: dict[str, Any], model: str, count: int, street: Street, tmp_path: Path
) -> None:
    def changed(number: int, entry: Entry) -> None:
        rig(number, entry)
        entry["camera"] += " camera"  # a space in a name
        entry["footage"]["distortion"] = lens

    job = variant(street, tmp_path / "workspace", changed)
    folder = exported(job, tmp_path)
    found = read_by_pycolmap(folder)
    assert [c[0] for c in found["cameras"].values()] == [model] * 2
    assert {len(c[3]) for c in found["cameras"].values()} == {count}
    names = ["front_camera_0000.png", "front_camera_0001.png", "rear_camera_0000.png"]
    assert sorted(found["images"]) == names == sorted(p.name for p in (folder / "images").iterdir())
    assert found["images"][names[0]][0] == found["images"][names[1]][0] != found["images"][names[2]][0]
    first = job.drive.frames[0].footage
    assert first is not None and first.distortion == Distortion(lens["model"], tuple(lens["coefficients"]))

"""Images that are reduced on import: labels, instances and masks stay in register with the photograph."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from tests.small_rig import FRONT, LEFT, RIGHT, make_small_rig
from unveil_core.base.errors import DriveError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, FrameLabels, PointCloud, Sweep, SweepPoints, tracks
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive, write_labels
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


@pytest.mark.parametrize("step", [1e300, 1e-308, 1e-5])
def test_time_stamps_of_no_clock_give_no_rate(tmp_path: Path, step: float) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    edit(path, lambda d: [f.update(timestamp=i * step) for i, f in enumerate(d["frames"])])
    if step > 1:
        with pytest.raises(DriveError, match=r"Not a time stamp: 1e\+300 \(frame 01\)"):
            import_drive(open_drive(path), tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return
    assert import_drive(open_drive(path), tmp_path / "out").frame_rate is None
    edit(tmp_path / "out/cameras.json", lambda d: d.update(frame_rate=1e-308))  # as a stranger says
    assert read_imported(tmp_path / "out").frame_rate is None
    for spoilt in (lambda d: d.update(frame_rate=1e308), lambda d: d["frames"][0].update(timestamp=1e300)):
        edit(tmp_path / "out/cameras.json", spoilt)
        with pytest.raises(DriveError, match="not a number up to"):
            read_imported(tmp_path / "out")


class Killed(BaseException):
    pass


def stop_at(call: int, message: str):  # type: ignore[no-untyped-def]
    """A progress that ends the work at a call with a message, as a kill does."""
    calls: list[str] = []

    def progress(done: int, total: int, said: str = "", **_: float) -> None:
        calls.append(said)
        if calls.count(message) == call:
            raise Killed

    return progress


def with_sweeps(drive: Drive) -> tuple[Drive, list[int]]:
    """A drive whose points are in six sweeps, and which of them were read."""
    read: list[int] = []

    def sweep(k: int) -> Sweep:
        def points() -> SweepPoints:
            read.append(k)
            return SweepPoints(np.random.default_rng(k).uniform(-20, 20, (300, 3)))

        return Sweep(drive.root, points)

    return replace(drive, points=PointCloud(np.zeros((0, 3)), None), sweeps=tuple(map(sweep, range(6)))), read


def test_an_import_goes_on_where_it_was_killed(tmp_path: Path) -> None:
    path = make_small_rig(tmp_path / "rig", [LEFT, FRONT], np.arange(6.0))
    drive, read = with_sweeps(open_drive(path))
    bare = {"semantic_path": None, "instance_path": None, "mask_path": None}
    drive = replace(drive, frames=tuple(replace(f, **bare) for f in drive.frames))
    labelled: list[int] = []

    def labels(i: int) -> FrameLabels:
        labelled.append(i)
        camera = done.frames[i].camera
        some = np.full((camera.height, camera.width), i, np.uint8)
        return FrameLabels(some, some.astype(np.uint16) if i % 2 else None, some > 3)

    def files(folder: Path) -> dict[str, bytes]:
        return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}

    done = import_drive(drive, tmp_path / "whole", work_side=60)
    write_labels(tmp_path / "whole", Frames(len(drive.frames), labels))
    parts, kept = tmp_path / "parts", Kept(tmp_path / "kept", every_s=0.0)
    for call, message in ((3, "checking files"), (5, "importing"), (4, "reading sweeps")):
        with pytest.raises(Killed):
            import_drive(drive, parts, work_side=60, kept=kept, progress=stop_at(call, message))
    made = {p: p.stat().st_ino for p in parts.with_name(".parts.partial").rglob("*.png")}
    assert made
    read.clear()
    imported = import_drive(drive, parts, work_side=60, kept=kept)
    assert read == [4, 5], "sweeps are not read twice"
    moved = {p.relative_to(parts): p.stat().st_ino for p in parts.rglob("*.png")}
    assert all(moved[p.relative_to(parts.with_name(".parts.partial"))] == inode for p, inode in made.items())
    labelled.clear()
    with pytest.raises(Killed):
        write_labels(parts, Frames(len(drive.frames), labels), stop_at(4, "labelling"))
    again = import_drive(drive, parts, work_side=60, kept=kept)
    assert [f.image_path for f in again.frames] == [f.image_path for f in imported.frames]
    write_labels(parts, Frames(len(drive.frames), labels))
    assert labelled == list(range(len(drive.frames)))
    assert files(parts) == files(tmp_path / "whole")
    # Nobody is to go on: nothing stays.
    with pytest.raises(Killed):
        import_drive(drive, tmp_path / "other", work_side=60, progress=stop_at(2, "importing"))
    assert not list(tmp_path.glob("*other*"))


def test_sweeps_are_gathered_from_the_last_checkpoint_on(tmp_path: Path) -> None:
    drive, read = with_sweeps(open_drive(make_small_rig(tmp_path / "rig", [FRONT], np.arange(3.0))))
    kept = Kept(tmp_path / "kept", every_s=0.0)
    with pytest.raises(Killed):
        import_drive(drive, tmp_path / "parts", kept=kept, progress=stop_at(4, "reading sweeps"))
    read.clear()
    import_drive(drive, tmp_path / "parts", kept=kept)
    assert read == [4, 5]
    import_drive(drive, tmp_path / "whole")
    assert (tmp_path / "parts/points.ply").read_bytes() == (tmp_path / "whole/points.ply").read_bytes()


def test_nothing_but_an_imported_drive_is_replaced(tmp_path: Path) -> None:
    drive = open_drive(make_small_rig(tmp_path / "rig", [FRONT], np.arange(2.0)))
    for name in ("rig", "notes", "file"):
        before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
        if name == "notes":
            (tmp_path / "notes").mkdir()
            (tmp_path / "notes/cameras.json").write_text('{"frames": []}')
        elif name == "file":
            (tmp_path / "file").write_text("mine")
        before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
        with pytest.raises(DriveError, match="and so not replaced"):
            import_drive(drive, tmp_path / name)
        assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before
    done = import_drive(drive, tmp_path / "done")
    import_drive(drive, tmp_path / "done", work_side=60)
    (done.root / "images/notes.txt").write_text("mine")
    with pytest.raises(DriveError, match="images/notes.txt: Not written by Unveil, and so not replaced"):
        import_drive(drive, tmp_path / "done")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["done", "file", "notes", "rig"]


def test_imported_pictures_share_nothing_with_the_originals(tmp_path: Path) -> None:
    path = make_small_rig(tmp_path / "rig", [FRONT], np.arange(2.0))
    originals = {p: p.read_bytes() for p in path.parent.rglob("*") if p.is_file()}
    done = import_drive(open_drive(path), tmp_path / "done")
    for file in (p for p in done.root.rglob("*") if p.is_file()):
        assert file.stat().st_nlink == 1
        file.write_bytes(b"painted")
    assert {p: p.read_bytes() for p in originals} == originals

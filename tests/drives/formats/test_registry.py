"""Every format is recognized by its own reader first, and gives back the street that was written in it."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.plain import COLMAP_SCALE
from tests.drives.formats.street.street import Street, tiny_street
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.registry import FORMATS

STREET = tiny_street()
WITHOUT_BOXES = ("transforms.json", "a shot", "COLMAP", "KITTI odometry")
POINT_ERROR_M = {"Waymo Open v2": 0.12, "Argoverse 2": 0.05, "KITTI raw": 0.01, "KITTI-360": 0.01}
"""Range images have beams, half floats 8 mm at 16 m; a sweep is freed from motion up to the change of its velocity."""
SEVERAL = [f for f in FORMATS if f.scenes is not None]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("formats")
    found = {}
    for name, write in WRITERS.items():
        (folder / name).mkdir()
        found[name] = write(folder / name, STREET)
    return found


def test_all_formats_have_a_writer() -> None:
    assert {f.name for f in FORMATS} - {"workspace"} == set(WRITERS)


@pytest.mark.parametrize("name", WRITERS)
def test_no_other_format_takes_a_folder(written: dict[str, Path], name: str) -> None:
    found = [f.name for f in FORMATS if f.recognizes(written[name])]
    # Street Gaussians' folders are those of DriveStudio and an archive, so they are asked for first.
    assert found == [name] + ["DriveStudio"] * (name == "Street Gaussians")


def placed(drive: Drive, name: str) -> tuple[np.ndarray, float]:
    """Poses of the cameras relative to the first, in metres, and the scale that a model had."""
    scale = COLMAP_SCALE if name == "COLMAP" else 1.0
    poses = np.stack([np.linalg.inv(f.camera.world_to_camera) for f in drive.frames])
    poses[:, :3, 3] /= scale
    return np.linalg.inv(poses[0]) @ poses, scale


def local_points(drive: Drive, scale: float) -> np.ndarray:
    found = [s.read().positions for s in drive.sweeps] or [drive.points.positions]
    camera = drive.frames[0].camera
    points = np.concatenate(found) @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    return points / scale


def of_first_camera(street: Street, points: np.ndarray) -> np.ndarray:
    back = np.linalg.inv(street.poses[0])
    return points @ back[:3, :3].T + back[:3, 3]


@pytest.mark.parametrize("name", WRITERS)
def test_the_street_comes_back(written: dict[str, Path], name: str) -> None:
    drive = open_drive(written[name])
    assert len(drive.frames) == STREET.count
    poses, scale = placed(drive, name)
    assert np.abs(poses - np.linalg.inv(STREET.poses[0]) @ STREET.poses).max() < 1e-5
    for i, frame in enumerate(drive.frames):
        camera = frame.camera
        assert (camera.width, camera.height) == STREET.size
        found = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        assert np.abs(found - (STREET.focal, STREET.focal, *STREET.centre)).max() < 1e-6
        assert frame.distortion is None and frame.ego_rows < STREET.size[1] / 4  # a small picture is no vehicle
        data = frame.image_bytes() if frame.image_bytes else frame.image_path.read_bytes()
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert np.abs(image.astype(int) - STREET.images[i]).mean() < 4
    apart = cKDTree(of_first_camera(STREET, STREET.points)).query(local_points(drive, scale))[0]
    assert len(apart) > 0.9 * len(STREET.points) and apart.max() < POINT_ERROR_M.get(name, 1e-4)


@pytest.mark.parametrize("name", [n for n in WRITERS if n not in WITHOUT_BOXES])
def test_boxes_come_back_in_frames_and_sweeps(written: dict[str, Path], name: str) -> None:
    drive = open_drive(written[name])
    back = drive.frames[0].camera.world_to_camera
    wanted = of_first_camera(STREET, np.array([b.centre for b in STREET.boxes]))
    for boxes in (*(f.boxes for f in drive.frames), *(s.boxes for s in drive.sweeps)):
        found = sorted(boxes, key=lambda b: b.class_name)
        assert [b.class_name for b in found] == ["car", "person"]
        centres = np.array([b.centre for b in found]) @ back[:3, :3].T + back[:3, 3]
        assert np.abs(centres - wanted).max() < 1e-3
        assert np.abs(np.array([b.size for b in found]) - [b.size for b in STREET.boxes]).max() < 1e-5
        ahead = drive.frames[0].camera.camera_to_world[:3, 2]
        turn = (found[0].yaw - np.arctan2(ahead[1], ahead[0])) % np.pi
        assert min(turn, np.pi - turn) < 1e-3


def test_labelled_points_keep_their_classes(written: dict[str, Path]) -> None:
    tree = cKDTree(of_first_camera(STREET, STREET.points))
    for name in ("PandaSet", "nuScenes", "KITTI odometry"):
        drive = open_drive(written[name])
        classes = np.concatenate([s.read().classes for s in drive.sweeps])  # type: ignore[arg-type]
        assert (classes == STREET.kinds[tree.query(local_points(drive, 1.0))[1]]).all(), name


def test_labelled_pictures_keep_their_classes(written: dict[str, Path]) -> None:
    for name in ("KITTI-360", "neuralsim and StreetUnveiler"):
        for i, frame in enumerate(open_drive(written[name]).frames):
            assert frame.labels is not None
            labels = frame.labels()
            assert (labels.semantic == STREET.semantics[i]).all(), name
            if name == "KITTI-360":
                assert labels.instance is not None
                assert ((labels.instance > 0) == (STREET.instances[i] > 0)).all()
                assert set(np.unique(labels.instance)) - {0} <= {b.id for b in frame.boxes}


def test_an_unknown_folder_gives_one_line_with_what_was_looked_for(tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures/0.jpg").write_bytes(b"")
    with pytest.raises(DriveError) as error:
        open_drive(tmp_path)
    said = str(error.value)
    assert "\n" not in said and "Not a drive" in said
    assert all(f.looked_for in said for f in FORMATS)


@pytest.mark.parametrize("kind", SEVERAL, ids=lambda f: f.name)
def test_of_two_drives_one_is_asked_for(written: dict[str, Path], tmp_path: Path, kind) -> None:  # type: ignore[no-untyped-def]
    shutil.copytree(written[kind.name], tmp_path / "drives")
    first, second = _twice(tmp_path / "drives", kind.name)
    with pytest.raises(DriveError, match=rf"holds 2 drives of {kind.name} \(choose one by --scene: "):
        open_drive(tmp_path / "drives")
    for scene in (first, second):
        assert open_drive(tmp_path / "drives", DriveOptions(scene=scene)).frames
    with pytest.raises(SettingsError, match=f"has no scene nowhere .it has .*{first}"):
        open_drive(tmp_path / "drives", DriveOptions(scene="nowhere"))


def _twice(root: Path, name: str) -> tuple[str, str]:
    """Make a second drive of the one that a folder holds; the names of both."""
    if name == "nuScenes":
        # A copy of the tables, renamed, is another release with another scene.
        shutil.copytree(root / "v1.0-mini", root / "v1.0-trainval")
        table = root / "v1.0-trainval/scene.json"
        table.write_text(table.read_text().replace("scene-0061", "scene-0103"))
        return "scene-0061", "scene-0103"
    (kind,) = (f for f in FORMATS if f.name == name)
    assert kind.scenes is not None
    (scene,) = kind.scenes(root)
    other = scene[:-1] + ("1" if scene[-1] != "1" else "2")
    for path in sorted(root.rglob("*"), key=lambda p: len(p.parts)):
        if path.name.split(".")[0] == scene:
            copy = path.with_name(path.name.replace(scene, other))
            shutil.copytree(path, copy) if path.is_dir() else shutil.copy(path, copy)
    return scene, other

"""neuralsim's segments: pictures, rays and objects lie where an independent computation puts them; hostile pickles do nothing."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive

WIDTH, HEIGHT, FRAMES = 48, 32, 4
FOCAL, CENTRE = (40.0, 41.0), (23.7, 16.2)
LENS = np.array([0.05, -0.02, 0.001, -0.0005, 0.003])
OPENCV_AXES = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
STREET = np.random.default_rng(1).uniform((8, -5, -1), (30, 5, 3), (30, 3))
DELAY_S = 0.04
"""Cameras take their photograph so long after the time of the frame."""


def at(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = (x, y, z)
    return pose


def vehicle(time: float) -> np.ndarray:
    return at(5.0 * time, 0.2 * time, 0.0, 0.05 * time)


def camera_pose(time: float) -> np.ndarray:
    return vehicle(time) @ at(1.5, 0.0, 1.9) @ OPENCV_AXES


LASERS = {"lidar_TOP": at(1.4, 0.0, 2.1, 2.6), "lidar_REAR": at(-1.1, 0.0, 0.5, 3.1)}


def scenario() -> dict[str, Any]:
    times = 0.1 * np.arange(FRAMES) + 1_557_843_345.0
    relative = times - times[0]
    stack = np.stack
    observers: dict[str, Any] = {
        "ego_car": {
            "class_name": "EgoVehicle",
            "n_frames": FRAMES,
            "data": {
                "v2w": stack([vehicle(t) for t in relative]),
                "timestamp": times,
                "global_frame_ind": np.arange(FRAMES),
            },
        }
    }
    for name in ("camera_FRONT", "camera_FRONT_LEFT"):
        k = np.array([[FOCAL[0], 0, CENTRE[0]], [0, FOCAL[1], CENTRE[1]], [0, 0, 1]])
        observers[name] = {
            "class_name": "Camera",
            "n_frames": FRAMES,
            "data": {
                "hw": np.tile([HEIGHT, WIDTH], (FRAMES, 1)),
                "intr": np.tile(k, (FRAMES, 1, 1)),
                "distortion": np.tile(LENS, (FRAMES, 1)),
                "c2w": stack([camera_pose(t + DELAY_S) for t in relative]),
                "timestamp": times + DELAY_S,
                "global_frame_ind": np.arange(FRAMES),
            },
        }
    for name, mounted in LASERS.items():
        observers[name] = {
            "class_name": "RaysLidar",
            "n_frames": FRAMES,
            "data": {
                "l2w": stack([vehicle(t) @ mounted for t in relative]),
                "timestamp": times,
                "global_frame_ind": np.arange(FRAMES),
            },
        }
    moving = {
        "transform": stack([at(12 + 10 * t, 2.0, 0.8, 3.1 + t) for t in relative[1:]]),
        "scale": np.tile([4.5, 1.9, 1.6], (FRAMES - 1, 1)),
        "timestamp": times[1:],
        "global_frame_ind": np.arange(1, FRAMES),
    }
    sign = {**moving, "transform": moving["transform"][:1], "scale": moving["scale"][:1]}
    objects = {
        "a1": {
            "id": "a1",
            "class_name": "Vehicle",
            "segments": [{"start_frame": 1, "n_frames": FRAMES - 1, "data": moving}],
        },
        "b2": {"id": "b2", "class_name": "Sign", "segments": [{"start_frame": 0, "n_frames": 1, "data": sign}]},
    }
    metas = {
        "world_offset": np.array([1e4, 2e4, 5.0]),
        "n_frames": FRAMES,
        "dynamic_stats": {"Vehicle": {"is_dynamic": ["a1"]}},
    }
    return {"scene_id": "segment-1", "metas": metas, "objects": objects, "observers": observers}


def write_segment(folder: Path, content: Any = None) -> Path:
    content = scenario() if content is None else content
    folder.mkdir(parents=True)
    (folder / "scenario.pt").write_bytes(pickle.dumps(content, protocol=4))
    generator = np.random.default_rng(0)
    for i in range(FRAMES):
        for name in ("camera_FRONT", "camera_FRONT_LEFT"):
            image = folder / "images" / name / f"{i:08d}.jpg"
            image.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(image), np.full((HEIGHT, WIDTH, 3), 60, np.uint8))
        mask = folder / "masks" / "camera_FRONT" / f"{i:08d}.npz"
        mask.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(mask, np.tile(np.array([0, 13, 18, 19, 255], np.uint8).repeat(10)[:WIDTH], (HEIGHT, 1)))
        for name, mounted in LASERS.items():
            half = STREET[:20] if name == "lidar_TOP" else STREET[20:]
            back = np.linalg.inv(vehicle(0.1 * i) @ mounted)
            local = half @ back[:3, :3].T + back[:3, 3]
            origins = generator.normal(0, 0.1, local.shape)
            ranges = np.linalg.norm(local - origins, axis=1)
            arrays = {"rays_o": origins, "rays_d": (local - origins) / ranges[:, None], "ranges": ranges}
            arrays = {k: np.concatenate([v, v[:2]]).astype(np.float32) for k, v in arrays.items()}
            arrays["ranges"][-2:] = (0.0, -1.0)
            if name == "lidar_REAR":  # an image of rays, the first laser's are flat
                arrays = {k: v.reshape(2, -1, *v.shape[1:]) for k, v in arrays.items()}
            file = folder / "lidars" / name / f"{i:08d}.npz"
            file.parent.mkdir(parents=True, exist_ok=True)
            np.savez_compressed(file, **arrays, dpose=np.eye(4))
    return folder


def test_points_project_through_the_lens_as_opencv_does(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment"))
    points = drive.sweeps[0].read().positions
    for i, frame in enumerate(drive.frames):
        world_to_camera = np.linalg.inv(camera_pose(0.1 * i + DELAY_S))
        local = STREET @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]
        # As Waymo writes its model down: the principal point counts from the edge of the first pixel.
        u, v = local[:, 0] / local[:, 2], local[:, 1] / local[:, 2]
        k1, k2, p1, p2, k3 = LENS
        r2 = u * u + v * v
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        x = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u)
        y = v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v
        waymo = np.stack([x * FOCAL[0] + CENTRE[0], y * FOCAL[1] + CENTRE[1]], axis=1)
        camera, distortion = frame.camera, frame.distortion
        assert distortion is not None
        assert (distortion.model, len(distortion.coefficients)) == ("OPENCV", 8)
        k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        rotation, _ = cv2.Rodrigues(camera.world_to_camera[:3, :3])
        found, _ = cv2.projectPoints(
            points, rotation, camera.world_to_camera[:3, 3], k, np.array(distortion.coefficients)
        )
        assert np.allclose(found[:, 0], waymo, atol=0.01)


def test_lasers_of_a_frame_are_one_sweep_without_empty_rays(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment"))
    assert len(drive.sweeps) == FRAMES
    for sweep in drive.sweeps:
        assert np.allclose(sweep.read().positions, STREET, atol=1e-4)
    assert [round((s.timestamp or 0) - 1_557_843_345.0, 3) for s in drive.sweeps] == [0.0, 0.1, 0.2, 0.3]


def test_all_files_of_lasers_and_masks_count_as_sources(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    named = set(open_drive(root).sources)
    assert {p for p in root.rglob("*") if p.suffix in (".npz", ".pt")} == named


def test_a_missing_laser_leaves_the_others(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    (root / "lidars/lidar_TOP/00000002.npz").unlink()
    for name in LASERS:
        (root / f"lidars/{name}/00000003.npz").unlink()
    drive = open_drive(root)
    assert [len(s.read().positions) for s in drive.sweeps] == [30, 30, 10]
    assert any("3 of 4 LiDAR sweeps" in n for n in drive.notices)


def test_boxes_are_at_the_time_of_photograph_and_sweep(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment"))
    assert drive.sweeps[0].boxes == ()
    for i in (1, 2, 3):
        (box,) = drive.sweeps[i].boxes
        assert np.allclose(box.centre, (12 + i, 2.0, 0.8))
        assert (box.class_name, box.size, box.id) == ("car", (4.5, 1.9, 1.6), 1)
    for i in (1, 2):
        (box,) = drive.frames[i].boxes
        assert np.allclose(box.centre, (12 + 10 * (0.1 * i + DELAY_S), 2.0, 0.8), atol=1e-5)
        assert np.cos(box.yaw - (3.1 + 0.1 * i + DELAY_S)) == pytest.approx(1.0)


def test_masks_are_labels_of_trainids(tmp_path: Path) -> None:
    frame = open_drive(write_segment(tmp_path / "segment")).frames[0]
    assert frame.labels is not None
    labels = frame.labels().semantic
    assert labels.shape == (HEIGHT, WIDTH)
    assert labels[0, [5, 15, 25, 35, 45]].tolist() == [0, 13, 18, 255, 255]


def test_cameras_and_segments_are_chosen_by_name(tmp_path: Path) -> None:
    write_segment(tmp_path / "segment-1")
    write_segment(tmp_path / "segment-2")
    with pytest.raises(DriveError, match="segment-1, segment-2"):
        open_drive(tmp_path)
    drive = open_drive(tmp_path, DriveOptions(scene="segment-2"))
    assert {f.camera_name for f in drive.frames} == {"camera_FRONT"}
    both = open_drive(tmp_path, DriveOptions(scene="segment-2", cameras=("all",)))
    assert len(both.frames) == 2 * FRAMES
    assert both.frames[-1].labels is None


def test_missing_photographs_are_skipped_and_told(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    (root / "images/camera_FRONT/00000001.jpg").unlink()
    drive = open_drive(root)
    assert [f.name for f in drive.frames] == ["00000000", "00000002", "00000003"]
    assert any("1 of 4 photographs of camera_FRONT" in n for n in drive.notices)


def test_photographs_may_be_png(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    path = root / "images/camera_FRONT/00000001.jpg"
    path.rename(path.with_suffix(".png"))
    assert [f.image_path.suffix for f in open_drive(root).frames] == [".jpg", ".png", ".jpg", ".jpg"]


class Hostile:
    """Would write a file when it is unpickled."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.target,)


def test_a_hostile_pickle_runs_nothing(tmp_path: Path) -> None:
    target = tmp_path / "written"
    root = write_segment(tmp_path / "segment", {**scenario(), "extra": Hostile(target)})
    with pytest.raises(DriveError, match=r"scenario\.pt: Not a readable pickle"):
        open_drive(root)
    assert not target.exists()


def test_a_hostile_array_of_objects_runs_nothing(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    target = tmp_path / "written"
    path = root / "lidars/lidar_TOP/00000000.npz"
    hostile = np.array([Hostile(target)], dtype=object)
    np.savez(path, rays_o=hostile, rays_d=hostile, ranges=hostile)
    drive = open_drive(root)
    with pytest.raises(DriveError, match="Not an archive of arrays"):
        drive.sweeps[0].read()
    assert not target.exists()


@pytest.mark.parametrize("part", [0.0, 0.3, 0.95])
def test_truncated_archives_are_one_error(tmp_path: Path, part: float) -> None:
    root = write_segment(tmp_path / "segment")
    drive = open_drive(root)
    for path in (root / "lidars/lidar_TOP/00000000.npz", root / "masks/camera_FRONT/00000000.npz"):
        path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    with pytest.raises(DriveError, match=r"00000000\.npz"):
        drive.sweeps[0].read()
    assert drive.frames[0].labels is not None
    with pytest.raises(DriveError, match=r"00000000\.npz"):
        drive.frames[0].labels()


def test_arrays_of_other_shapes_are_one_error(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    drive = open_drive(root)
    np.savez(
        root / "lidars/lidar_TOP/00000000.npz", rays_o=np.zeros((5, 3)), rays_d=np.zeros((4, 3)), ranges=np.ones(5)
    )
    with pytest.raises(DriveError, match="has rays of"):
        drive.sweeps[0].read()
    np.savez(root / "lidars/lidar_TOP/00000001.npz", rays_o=np.zeros((5, 3)), ranges=np.ones(5))
    with pytest.raises(DriveError, match="lacks an array"):
        drive.sweeps[1].read()
    np.savez(root / "masks/camera_FRONT/00000000.npz", np.zeros((HEIGHT, WIDTH + 1), np.uint8))
    assert drive.frames[0].labels is not None
    with pytest.raises(DriveError, match="no labels of 48x32"):
        drive.frames[0].labels()


def damaged(which: str) -> Any:
    content = scenario()
    camera, car = content["observers"]["camera_FRONT"], content["objects"]["a1"]
    if which == "list":
        return [1, 2]
    if which == "no observers":
        del content["observers"]
    elif which == "no data":
        del camera["data"]
    elif which == "no poses":
        del camera["data"]["c2w"]
    elif which == "poses of another number":
        camera["data"]["c2w"] = camera["data"]["c2w"][:2]
    elif which == "poses of text":
        camera["data"]["c2w"] = "poses"
    elif which == "no rotation":
        camera["data"]["c2w"] = 3 * camera["data"]["c2w"]
    elif which == "NaN":
        camera["data"]["c2w"][0, 0, 0] = np.nan
    elif which == "flat object":
        car["segments"][0]["data"]["transform"] = np.zeros(3)
    elif which == "object without class":
        del car["class_name"]
    return content


@pytest.mark.parametrize(
    "which",
    ["list", "no observers", "no data", "no poses", "poses of another number", "poses of text", "no rotation", "NaN",
     "flat object", "object without class"],
)  # fmt: skip
def test_damaged_scenarios_are_one_error(tmp_path: Path, which: str) -> None:
    with pytest.raises(DriveError, match=r"scenario\.pt"):
        open_drive(write_segment(tmp_path / "segment", damaged(which)))


def test_a_truncated_scenario_is_one_error(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    path = root / "scenario.pt"
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DriveError, match=r"scenario\.pt"):
        open_drive(root)

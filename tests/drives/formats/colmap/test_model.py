"""COLMAP models: text and binary say the same; damaged ones say what is wrong."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.geometry.transforms import quat_to_rotation, rotation_to_quat

UP = np.array([0.1, -0.98, 0.17]) / np.linalg.norm([0.1, -0.98, 0.17])


def poses() -> list[np.ndarray]:
    """Five cameras that walk along a level street whose up is ``UP``, 0.4 units above the ground."""
    forward = np.cross(UP, [1.0, 0.0, 0.0])
    forward /= np.linalg.norm(forward)
    right = np.cross(-UP, forward)
    found = []
    for i in range(5):
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, -UP, forward])
        pose[:3, 3] = -pose[:3, :3] @ (0.3 * i * forward + 0.4 * UP)
        found.append(pose)
    return found


def points() -> np.ndarray:
    generator = np.random.default_rng(0)
    basis = np.linalg.svd(UP[None])[2][1:]
    return generator.uniform(-3, 3, (400, 2)) @ basis


def write_model(root: Path, binary: bool, model: str = "SIMPLE_RADIAL") -> None:
    (root / "images").mkdir(parents=True)
    (root / "masks").mkdir()
    folder = root / "sparse" / "0"
    folder.mkdir(parents=True)
    ids = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "OPENCV": 4}
    parameters = {
        "SIMPLE_PINHOLE": (50.0, 32.0, 24.0),
        "PINHOLE": (50.0, 51.0, 32.0, 24.0),
        "SIMPLE_RADIAL": (50.0, 32.0, 24.0, 0.01),
        "OPENCV": (50.0, 51.0, 32.0, 24.0, 0.01, 0.0, 0.001, 0.0),
    }[model]
    rows = []
    for i, pose in reversed(list(enumerate(poses()))):
        name = f"{i:02d}.png"
        cv2.imwrite(str(root / "images" / name), np.full((48, 64, 3), 40 * i, np.uint8))
        mask = np.full((48, 64), 255, np.uint8)
        mask[30:40, 20:40] = 0
        cv2.imwrite(str(root / "masks" / name), mask)
        rows.append((i + 1, *rotation_to_quat(pose[:3, :3]), *pose[:3, 3], 1, name))
    cloud = points()
    if binary:
        (folder / "cameras.bin").write_bytes(
            struct.pack("<QiiQQ", 1, 1, ids[model], 64, 48) + struct.pack(f"<{len(parameters)}d", *parameters)
        )
        data = struct.pack("<Q", len(rows))
        for row in rows:
            data += struct.pack("<i7di", *row[:9]) + row[9].encode() + b"\0"
            data += struct.pack("<Q", 2) + struct.pack("<ddq", 1.0, 2.0, 5) * 2
        (folder / "images.bin").write_bytes(data)
        data = struct.pack("<Q", len(cloud))
        for k, p in enumerate(cloud):
            track = 2 if k == 0 else 3
            data += (
                struct.pack("<QdddBBBd", k, *p, 10, 20, 30, 0.5)
                + struct.pack("<Q", track)
                + struct.pack("<ii", 1, 0) * track
            )
        (folder / "points3D.bin").write_bytes(data)
    else:
        (folder / "cameras.txt").write_text("# cameras\n1 " + model + " 64 48 " + " ".join(map(str, parameters)) + "\n")
        lines = ["# images"]
        for row in rows:
            lines += [" ".join(str(v) for v in row), "1.0 2.0 5 3.0 4.0 -1"]
        (folder / "images.txt").write_text("\n".join(lines) + "\n")
        lines = []
        for k, p in enumerate(cloud):
            track = 2 if k == 0 else 3
            lines.append(f"{k} {p[0]!r} {p[1]!r} {p[2]!r} 10 20 30 0.5" + " 1 0" * track)
        (folder / "points3D.txt").write_text("\n".join(lines).replace("np.float64(", "").replace(")", "") + "\n")


@pytest.mark.parametrize("model", ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "OPENCV"])
def test_binary_and_text_agree(tmp_path: Path, model: str) -> None:
    write_model(tmp_path / "b", True, model)
    write_model(tmp_path / "t", False, model)
    binary, text = open_drive(tmp_path / "b"), open_drive(tmp_path / "t")
    assert [f.name for f in binary.frames] == ["00", "01", "02", "03", "04"]
    for a, b, pose in zip(binary.frames, text.frames, poses(), strict=True):
        assert np.abs(a.camera.world_to_camera - pose).max() < 1e-12
        assert np.abs(a.camera.world_to_camera - b.camera.world_to_camera).max() < 1e-12
        assert a.distortion == b.distortion
        assert a.mask_path is not None and a.mask_path.name == a.image_path.name
    assert (binary.frames[0].distortion is None) == ("PINHOLE" in model)
    assert len(binary.points.positions) == 399  # one track of two is too short
    assert np.allclose(binary.points.positions, text.points.positions)
    assert binary.units_per_metre is None and binary.up is None


def test_up_and_scale_are_found(tmp_path: Path) -> None:
    write_model(tmp_path, True)
    drive = open_drive(tmp_path)
    placed = place_drive(drive)
    assert float(placed.to_world.up @ UP) > 0.99999 and placed.up_source == "ground"
    assert placed.height == pytest.approx(0.4, rel=0.01)
    assert placed.to_world.scale == pytest.approx(0.25, rel=0.01) and placed.scale_source == "camera height"


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_cut_files_say_so(tmp_path: Path, name: str) -> None:
    write_model(tmp_path, True)
    path = tmp_path / "sparse/0" / name
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DriveError, match="Cut short"):
        open_drive(tmp_path)


def test_quaternions_round_trip() -> None:
    generator = np.random.default_rng(1)
    for quat in [*generator.normal(size=(50, 4)), np.array([0, 1.0, 0, 0]), np.array([1e-9, 0, 0, 1.0])]:
        rotation = quat_to_rotation(quat)
        assert np.abs(quat_to_rotation(rotation_to_quat(rotation)) - rotation).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "line", "says"),
    [
        ("cameras.txt", "1", "line 1: expected width and height, the line ends after 1 of 4 words"),
        ("cameras.txt", "one PINHOLE 64 48 50 51 32 24", "line 1: expected numbers for a camera's id, found 'one'"),
        ("cameras.txt", "1 PINHOLE 64 48 50 fifty 32 24", "line 1: expected numbers for a camera's parameters"),
        ("cameras.txt", "1 PINHOLE 64 48 50", "camera model PINHOLE has 1 parameters"),
        ("images.txt", "1 1 0 0 0 0 0", "line 1: expected qw qx qy qz tx ty tz, the line ends after 7 of 8 words"),
        ("images.txt", "1 1 0 0 0 0 0 x 1 00.png", "line 1: expected numbers for qw qx qy qz tx ty tz, found"),
        ("images.txt", "1 1 0 0 0 0 0 0 1", "line 1: the image's name is missing"),
        ("points3D.txt", "1 0 0 0 10 20", "line 1: expected x y z r g b error"),
        ("points3D.txt", "1 0 0 nothing 10 20 30 0.5", "line 1: expected numbers for x y z r g b error"),
        ("points3D.txt", "\udcff", "Not UTF-8 text"),
    ],
)
def test_a_text_model_with_a_wrong_line_names_it(name: str, line: str, says: str, tmp_path: Path) -> None:
    write_model(tmp_path, binary=False)
    (tmp_path / "sparse/0" / name).write_text(line + "\n", encoding="utf-8", errors="surrogateescape")
    with pytest.raises(DriveError, match=f"{name}: .*({says})"):
        open_drive(tmp_path)


def test_text_is_utf_8_whatever_the_system_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_model(tmp_path, binary=False)
    path = tmp_path / "sparse/0/images.txt"
    path.write_text("\ufeff" + path.read_text("utf-8").replace("00.png", "straße ä.png"), encoding="utf-8")
    (tmp_path / "images/00.png").rename(tmp_path / "images/straße ä.png")
    monkeypatch.setattr("locale.getpreferredencoding", lambda *_: "ascii")
    monkeypatch.setenv("PYTHONUTF8", "0")
    assert "straße ä.png" in {frame.image_path.name for frame in open_drive(tmp_path).frames}

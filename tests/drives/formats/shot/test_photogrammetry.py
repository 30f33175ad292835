"""Cameras of Metashape and RealityScan beside their pictures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.formats.shot.shots import COUNT, SIZE, plates, rotation
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.formats.registry import open_drive
from unveil_core.geometry.transforms import rigid_inverse

TURN = rotation("z", 25) @ rotation("x", 10)
SCALE, SHIFT = 2.5, np.array([10.0, -20.0, 3.0])
CALIBRATION = "<f>80</f><cx>1.5</cx><cy>-0.5</cy><b1>0.8</b1><k1>-0.1</k1><k2>0.02</k2><p1>0.001</p1><p2>-0.002</p2>"


def pose_in_chunk(k: int) -> Float64:
    """(4, 4) OpenCV camera to chunk."""
    found = np.eye(4)
    found[:3, :3] = rotation("z", 3 * k) @ rotation("x", -90)
    found[:3, 3] = 0.1 * k, 0.8 * k, 0.6
    return found


def metashape(path: Path, *, calibration: str = CALIBRATION, kind: str = "frame", placed: bool = True) -> Path:
    cameras = "".join(
        f'<camera id="{k}" sensor_id="0" label="plate.{1001 + k}">'
        f"<transform>{' '.join(f'{v:.12g}' for v in pose_in_chunk(k).ravel())}</transform></camera>"
        for k in range(COUNT)
    )
    place = (
        f'<transform><rotation locked="0">{" ".join(f"{v:.12g}" for v in TURN.ravel())}</rotation>'
        f"<translation>{' '.join(map(str, SHIFT))}</translation><scale>{SCALE}</scale></transform>"
    )
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="Chunk 1" enabled="true">'
        f'<sensors next_id="1"><sensor id="0" label="cam" type="{kind}">'
        f'<resolution width="{SIZE[0]}" height="{SIZE[1]}"/><calibration type="{kind}" class="initial"><f>1</f></calibration>'
        f'<calibration type="{kind}" class="adjusted"><resolution width="{SIZE[0]}" height="{SIZE[1]}"/>{calibration}'
        "</calibration></sensor></sensors>"
        f'<cameras next_id="6">{cameras}<camera id="9" sensor_id="0" label="lost"/></cameras>{place * placed}'
        "</chunk></document>"
    )
    return path


def test_metashapes_cameras(tmp_path: Path) -> None:
    plates(tmp_path / "images")
    drive = open_drive(metashape(tmp_path / "cameras.xml"))
    assert [f.name for f in drive.frames] == [f"plate.{1001 + k}" for k in range(COUNT)]
    for k, frame in enumerate(drive.frames):
        inside = pose_in_chunk(k)
        expected = np.eye(4)
        expected[:3, :3] = TURN @ inside[:3, :3]
        expected[:3, 3] = SCALE * TURN @ inside[:3, 3] + SHIFT
        np.testing.assert_allclose(frame.camera.world_to_camera, rigid_inverse(expected), atol=1e-9)
    camera, bent = drive.frames[0].camera, drive.frames[0].distortion
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (80.8, 80, SIZE[0] / 2 + 1.5, SIZE[1] / 2 - 0.5)
    assert bent is not None and bent.coefficients == (-0.1, 0.02, -0.002, 0.001, 0, 0, 0, 0)
    assert drive.units_per_metre == 1 and drive.up is not None and drive.up.tolist() == [0, 0, 1]
    assert "1 cameras of Metashape have no pose" in drive.notices[0]


def test_metashapes_lens_bends_as_its_manual_says(tmp_path: Path) -> None:
    plates(tmp_path / "images")
    frame = open_drive(metashape(tmp_path / "cameras.xml")).frames[0]
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.3, 0.3, 5))
    r2 = x * x + y * y
    bend = 1 - 0.1 * r2 + 0.02 * r2 * r2
    p1, p2 = 0.001, -0.002
    xd = x * bend + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y
    yd = y * bend + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y
    u, v = SIZE[0] * 0.5 + 1.5 + xd * 80 + xd * 0.8, SIZE[1] * 0.5 - 0.5 + yd * 80
    camera, bent = frame.camera, frame.distortion
    assert bent is not None
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    rays = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    found, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(bent.coefficients))
    np.testing.assert_allclose(found[:, 0], np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-9)


def test_a_chunk_without_a_place_has_no_scale(tmp_path: Path) -> None:
    plates(tmp_path / "images")
    drive = open_drive(metashape(tmp_path / "cameras.xml", placed=False))
    assert drive.units_per_metre is None and drive.up is None


@pytest.mark.parametrize(
    ("extra", "kind", "line"),
    [
        ("<k4>0.1</k4>", "frame", "b2, k4, p3 or p4"),
        ("<b2>1.0</b2>", "frame", "b2, k4, p3 or p4"),
        ("", "fisheye", "a fisheye has p1 or p2"),
        ("", "spherical", "sensor of type spherical"),
    ],
)
def test_lenses_that_opencv_lacks(tmp_path: Path, extra: str, kind: str, line: str) -> None:
    plates(tmp_path / "images")
    with pytest.raises(DriveError, match=line):
        open_drive(metashape(tmp_path / "cameras.xml", calibration=CALIBRATION + extra, kind=kind))


def test_another_xml_is_told(tmp_path: Path) -> None:
    plates(tmp_path / "images")
    (tmp_path / "cameras.xml").write_text("<boost_serialization><tracklets/></boost_serialization>")
    with pytest.raises(DriveError, match="Not a file of Metashape's cameras"):
        open_drive(tmp_path / "cameras.xml")


HEADING = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2"


def test_realityscans_cameras(tmp_path: Path) -> None:
    """The first looks to the north, level; the second to the east, 10 degrees down; the third straight down."""
    plates(tmp_path / "images")
    rows = ["plate.1001.png,1,2,3,0,90,0", "plate.1002.png,1,2,3,90,80,0", "plate.1003.png,1,2,3,0,0,0"]
    lens = "24,0.36,-0.18,-0.1,0.02,0.003,0,0.001,0.002"
    (tmp_path / "cameras.csv").write_text("\n".join([HEADING, *(f"{r},{lens}" for r in rows)]) + "\n")
    drive = open_drive(tmp_path)
    down = np.radians(10)
    ways = [(0, 1, 0), (np.cos(down), 0, -np.sin(down)), (0, 0, -1)]
    for frame, way in zip(drive.frames, ways, strict=True):
        np.testing.assert_allclose(frame.camera.forward, way, atol=1e-9)
        np.testing.assert_allclose(frame.camera.centre, [1, 2, 3], atol=1e-9)
    np.testing.assert_allclose(-drive.frames[0].camera.world_to_camera[1, :3], [0, 0, 1], atol=1e-9)
    camera, bent = drive.frames[0].camera, drive.frames[0].distortion
    assert camera.fx == camera.fy == pytest.approx(24 / 36 * SIZE[0])
    assert (camera.cx, camera.cy) == pytest.approx((SIZE[0] / 2 + 0.96, SIZE[1] / 2 - 0.48))
    assert bent is not None and bent.coefficients[:5] == (-0.1, 0.02, 0.001, 0.002, 0.003)
    assert drive.units_per_metre is None
    assert any("holds" in n or "5" in n for n in drive.notices) or len(drive.frames) == 3


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a,b\n1,2\n", "has no column name, as RealityScan's cameras have"),
        (f"{HEADING}\n", "holds no cameras"),
        (f"{HEADING}\nplate.1001.png,1,2,3,0,90,0,24,0,0,0,0,0,0.1,0,0\n", "has a k4"),
        (f"{HEADING}\nplate.1001.png,1,x,3,0,90,0,24\n", "Not a number in line 2"),
        (f"{HEADING}\nother.png,1,2,3,0,90,0,24\n", "none of its 1 pictures is there, the first other.png"),
    ],
)
def test_tables_that_are_none(tmp_path: Path, text: str, line: str) -> None:
    plates(tmp_path / "images")
    (tmp_path / "cameras.csv").write_text(text)
    with pytest.raises(DriveError, match=line):
        open_drive(tmp_path / "cameras.csv")

"""Metres and up of a model, by each thing that may be known."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import PointCloud
from unveil_core.geometry.similarity import Similarity
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.gpx import level_metres, read_gpx
from unveil_core.solve.mapping.model import Lens, Model
from unveil_core.solve.placing import Placed, placed, up_and_height
from unveil_core.solve.settings import SolveSettings

HEIGHT, UNITS = 1.5, 0.37
"""Metres of the cameras over the road, and units of the model in a metre."""
COUNT, STEP_M = 30, 1.0
BEGUN = datetime(2026, 11, 28, 10, tzinfo=UTC).timestamp()


def street(*, noted: bool = False) -> tuple[Model, list[Reel], PointCloud]:
    """Cameras along a bend over a road with kerbs, in a turned frame of another unit."""
    rng = np.random.default_rng(0)
    x = STEP_M * np.arange(COUNT)
    places = np.stack([x, 0.004 * x**2, np.full(COUNT, HEIGHT)], axis=1)
    poses = []
    for k, place in enumerate(places):
        yaw = 0.008 * x[k]
        forward = np.array([np.cos(yaw), np.sin(yaw), -0.05]) / np.hypot(1, 0.05)
        right = np.cross(forward, [0, 0, 1.0]) / np.linalg.norm(np.cross(forward, [0, 0, 1.0]))
        turn = np.stack([right, np.cross(forward, right), forward])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = turn, -turn @ place
        poses.append(pose)
    along, aside = rng.uniform(0, 40, 6000), rng.uniform(-6, 6, 6000)
    ground = np.stack([along, 0.004 * along**2 + aside, np.where(np.abs(aside) > 2, 0.12, 0.0)], axis=1)
    ground[:, 2] += rng.normal(0, 0.01, len(ground))
    other = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    to_model = Similarity(UNITS, other, np.array([3.0, -2.0, 1.0]))
    lens = Lens("SIMPLE_RADIAL", 640, 360, (500.0, 320.0, 180.0, 0.0))
    names = tuple(f"{k:04d}.png" for k in range(COUNT))
    empty = np.zeros(0, np.int64)
    metres = Model(
        names,
        np.zeros(COUNT, np.int64),
        (lens,),
        np.stack(poses),
        ground,
        np.zeros(6000),
        empty,
        empty,
        np.zeros((0, 2)),
    )
    model = metres.moved(to_model.inverse)
    north = 52.0 + np.degrees(places[:, 1] / 6_378_137.0)
    east = 13.0 + np.degrees(places[:, 0] / 6_378_137.0 / np.cos(np.radians(52.0)))
    frames = tuple(
        FootageFrame(
            "camera",
            f"{k:04d}",
            k,
            names[k],
            0.1 * k,
            float(north[k]) if noted else None,
            float(east[k]) if noted else None,
        )
        for k in range(COUNT)
    )
    return model, [Reel("camera", "clip.mp4", (640, 360), 8, frames, begun=BEGUN)], PointCloud(model.points)


def found(settings: SolveSettings, *, noted: bool = False) -> tuple[Placed, Model]:
    model, reels, points = street(noted=noted)
    up, source, height = up_and_height(model, ["camera"] * COUNT, points)
    where = placed(model, reels, up, source, height, settings)
    return where, model.moved(where.to_model)


def track(path: Path, *, later_s: float = 0.0) -> Path:
    """The way as a receiver has it, a point a second."""
    rows = []
    for second in range(-1, 5):
        x = 10.0 * second
        north = 52.0 + np.degrees(0.004 * x * abs(x) / 6_378_137.0)
        east = 13.0 + np.degrees(x / 6_378_137.0 / np.cos(np.radians(52.0)))
        stamp = datetime.fromtimestamp(BEGUN + second + later_s, UTC).isoformat().replace("+00:00", "Z")
        rows.append(f'<trkpt lat="{north:.9f}" lon="{east:.9f}"><time>{stamp}</time></trkpt>')
    path.write_text(
        '<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>' + "".join(rows) + "</trkseg></trk></gpx>"
    )
    return path


@pytest.mark.parametrize("what", ["camera_height", "speed", "known_length", "gpx", "exif"])
def test_each_tells_the_scale(what: str, tmp_path: Path) -> None:
    length = float(np.hypot(1, 0.008 * np.arange(COUNT))[:-1].sum())
    given = {
        "camera_height": SolveSettings(camera_height=HEIGHT),
        "speed": SolveSettings(speed=length / 2.9 * 3.6),
        "known_length": SolveSettings(known_length=length),
        "gpx": SolveSettings(gpx=track(tmp_path / "a.gpx") if what == "gpx" else None),
        "exif": SolveSettings(),
    }[what]
    where, model = found(given, noted=what == "exif")
    assert where.known
    assert where.to_model.scale == pytest.approx(UNITS, rel=0.02)
    assert where.height_m == pytest.approx(HEIGHT, rel=0.02)  # the road's, not the sidewalks'
    level = model.centres[:, 2]
    assert np.ptp(level) < 0.4  # of 29 m of way: up is right to a degree


def test_without_anything_the_height_is_assumed_and_said() -> None:
    where, _ = found(SolveSettings())
    assert not where.known and "assumed to be 1.6 m" in where.told and "--camera-height" in where.told


def test_a_track_of_another_day_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match="covers .* and not the footage"):
        found(SolveSettings(gpx=track(tmp_path / "a.gpx", later_s=86_400)))


@pytest.mark.parametrize(
    "content", ["", "<gpx></gpx>", '<!DOCTYPE a [<!ENTITY b "c">]><gpx/>', "<gpx><trkpt lat='a' lon='b'/></gpx>"]
)
def test_what_is_no_track_is_one_line(content: str, tmp_path: Path) -> None:
    (tmp_path / "a.gpx").write_text(content)
    with pytest.raises(DriveError, match=r"a\.gpx: "):
        read_gpx(tmp_path / "a.gpx")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-le", "utf-16-be"])
def test_entities_of_a_track_are_refused_in_every_encoding(encoding: str, tmp_path: Path) -> None:
    text = track(tmp_path / "a.gpx").read_text()
    head = '<?xml version="1.0" encoding="UTF-16"?>' if "16" in encoding else ""
    hostile = f'{head}<!DOCTYPE gpx [<!ENTITY year "2026">]>{text.replace("2026", "&year;", 1)}'
    (tmp_path / "a.gpx").write_bytes(hostile.encode(encoding))
    with pytest.raises(DriveError, match=r"a\.gpx: Not a GPX track: declares entities"):
        read_gpx(tmp_path / "a.gpx")
    (tmp_path / "a.gpx").write_bytes(f"{head}{text}".encode(encoding))
    assert len(read_gpx(tmp_path / "a.gpx")[0]) > 2


def test_degrees_are_metres_to_the_east_and_north() -> None:
    found_m = level_metres([(60.0, 10.0), (60.001, 10.001)])
    assert found_m[1] - found_m[0] == pytest.approx([55.66, 111.32], rel=1e-3)

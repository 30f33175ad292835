"""The imported drive as the add-on reads it: the same cameras and places as the rest of the project reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from blender_addon.formats.boxes import SceneBox
from blender_addon.formats.drive_files import read_drive
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.drives import open_drive
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.geometry.axes import up_frame, upright
from unveil_core.geometry.similarity import Similarity
from unveil_core.pipeline.run import run
from unveil_core.semantics.objects import marked_box


def blender_projection(frame, point: np.ndarray) -> np.ndarray:
    """(2,) pixel, from the upper left corner, where Blender's camera model shows a point of the scene."""
    x, y, z = (np.linalg.inv(frame.camera_to_scene) @ [*point, 1.0])[:3]
    lens = frame.lens
    scale = lens.focal_mm / lens.sensor_mm * frame.width
    # The sensor is as wide as the picture; shifts count in widths; a pixel may be oblong.
    ratio = lens.aspect[1] / lens.aspect[0]
    u = frame.width / 2 + scale * x / -z - lens.shift_x * frame.width
    v = frame.height / 2 - (scale * y / -z - lens.shift_y * frame.width) / ratio
    return np.array([u, v])


@pytest.mark.parametrize("turned", [False, True])
def test_cameras_agree_whatever_is_up_and_however_long_a_unit(turned: bool, tmp_path: Path) -> None:
    """A drive as COLMAP leaves it: any direction is up, a unit is any length; the scene has z up and metres."""
    workspace = run(
        make_tiny_drive(tmp_path / "drive", offset=(352155, 5812961, 36)), tmp_path / "ws", until="objects"
    ).root
    up = np.array([0.48, -0.64, 0.6])
    if turned:
        known = Similarity(2.5, upright(up), np.array([352155.0, 5812961, 36]))
        edit(workspace / "drive/cameras.json", lambda d: d.update(to_world=known.to_json()))
    drive, real = read_drive(workspace), read_imported(workspace / "drive")
    generator = np.random.default_rng(1)
    local = generator.uniform((4, -2, -1), (20, 2, 1), (50, 3))
    assert np.allclose(drive.to_drive(local), real.to_world.to_world(local), atol=1e-6)
    assert np.allclose(drive.from_drive(drive.to_drive(local)), local, atol=1e-6)
    (frames,) = drive.tracks.values()
    for frame, own in zip(frames, real.frames, strict=True):
        pixels, depth = own.camera.project(local)
        assert (depth > 0).all()
        assert np.allclose([blender_projection(frame, p) for p in local], pixels, atol=1e-6)
    if turned:
        assert np.allclose(drive.to_drive(np.array([0, 0, 1.0])) - drive.to_drive(np.zeros(3)), 2.5 * up)
        # A box that the artist draws is the same box for the command.
        box = SceneBox((3.0, 1.0, 0.5), (4.0, 2.0, 1.5), 0.3)
        size = tuple(2.5 * v for v in box.size)
        tracked = TrackedBox(7, "car", tuple(drive.to_drive(np.array(box.centre))), size, box.yaw)
        corners = marked_box(tracked, real).corners(up_frame(real.up))
        found = sorted(map(tuple, np.round(corners, 6)))
        assert np.allclose(found, sorted(map(tuple, np.round(box.corners, 6))), atol=1e-5)


def test_a_missing_or_damaged_drive_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="No imported drive"):
        read_drive(tmp_path)
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive/cameras.json").write_text('{"up": [0, 0, 1]}')
    with pytest.raises(ValueError, match="cameras.json: Not an imported drive"):
        read_drive(tmp_path)
    (tmp_path / "drive/cameras.json").write_text("{")
    with pytest.raises(ValueError, match="cameras.json: Not readable"):
        read_drive(tmp_path)
    (tmp_path / "drive/cameras.json").write_text('{"frames": [' + "[]," * (1 << 21) + "[]]}")
    with pytest.raises(ValueError, match=r"cameras.json: Not readable: it holds 4,\d+,\d+ values"):
        read_drive(tmp_path)
    (tmp_path / "drive/cameras.json").write_text("[" * 200_000)
    with pytest.raises(ValueError, match="cameras.json: Not readable"):
        read_drive(tmp_path)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("camera", "../../../home/x/Pictures"),
        ("name", ".."),
        ("image", "../../x.png"),
        ("image", "/etc/passwd"),
        ("width", 0),
        ("fx", float("nan")),
        ("fy", -1.0),
        ("timestamp", 1e300),
        ("name", "COM\u00b9"),
        ("camera", "a\u202eb"),
    ],
)
def test_a_drive_that_leads_out_of_its_workspace_is_one_line(tmp_path: Path, field: str, value: object) -> None:
    folder = tmp_path / "ws/drive"
    import_drive(open_drive(make_tiny_drive(tmp_path / "drive")), folder)
    assert read_drive(tmp_path / "ws").tracks
    edit(folder / "cameras.json", lambda d: d["frames"][0].update({field: value}))
    with pytest.raises(ValueError, match="cameras.json: Not an imported drive"):
        read_drive(tmp_path / "ws")


@pytest.mark.parametrize("rate", [1e308, 0.0, -1.0, 1e-9])
def test_a_rate_that_no_camera_has_is_one_line(tmp_path: Path, rate: float) -> None:
    import_drive(open_drive(make_tiny_drive(tmp_path / "drive")), tmp_path / "ws/drive")
    edit(tmp_path / "ws/drive/cameras.json", lambda d: d.update(frame_rate=rate))
    with pytest.raises(ValueError, match="frames a second"):
        read_drive(tmp_path / "ws")

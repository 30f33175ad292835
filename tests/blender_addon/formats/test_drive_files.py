"""What the add-on reads from a workspace, without Blender: the same as the rest of the project reads from it."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from blender_addon.formats.boxes import SceneBox, box_around, pick
from blender_addon.formats.classes import CITYSCAPES, color_table
from blender_addon.formats.drive_files import read_drive
from blender_addon.formats.ply_file import read_ply
from blender_addon.formats.sequences import REGION_COLORS, numbered, with_palette
from blender_addon.formats.splats import SIGMAS, discs, surfel_discs, tetrahedra
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.files import write_json_atomic
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.imported import read_imported
from unveil_core.drives.points import write_points
from unveil_core.geometry.axes import up_frame
from unveil_core.mesh import Mesh, write_ply
from unveil_core.pipeline.run import run
from unveil_core.semantics import classes
from unveil_core.semantics.objects import marked_box
from unveil_core.surfels.ply import read_surfels, write_surfels


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
    if turned:
        listed = json.loads((workspace / "objects.json").read_text())
        write_json_atomic(workspace / "objects.json", {**listed, "units_per_metre": 2.5})
        edit(workspace / "drive/cameras.json", lambda d: d.update(up=[0.48, -0.64, 0.6], metric=False))
    drive, real = read_drive(workspace), read_imported(workspace / "drive")
    generator = np.random.default_rng(1)
    local = generator.uniform((4, -2, -1), (20, 2, 1), (50, 3))
    placed = drive.to_scene(local)
    assert np.allclose(drive.to_drive(placed), local + real.offset, atol=1e-6)
    (frames,) = drive.tracks.values()
    for frame, own in zip(frames, real.frames, strict=True):
        pixels, depth = own.camera.project(local)
        assert (depth > 0).all()
        assert np.allclose([blender_projection(frame, p) for p in placed], pixels, atol=1e-6)
    if turned:
        assert np.allclose(drive.to_scene(real.up * 2.5), (0, 0, 1))
        # A box that the artist draws is the same box for the command.
        box = SceneBox((3.0, 1.0, 0.5), (4.0, 2.0, 1.5), 0.3)
        size = tuple(2.5 * v for v in box.size)
        tracked = TrackedBox(7, "car", tuple(drive.to_drive(np.array(box.centre))), size, box.yaw)
        corners = marked_box(tracked, real).corners(up_frame(real.up))
        found = sorted(map(tuple, np.round(drive.to_scene(corners), 6)))
        assert np.allclose(found, sorted(map(tuple, np.round(box.corners, 6))), atol=1e-5)
    else:
        assert np.array_equal(placed, local)


def test_files_are_read_as_they_were_written(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    points = PointCloud(generator.normal(size=(50, 3)) + 6e6, generator.integers(0, 256, (50, 3), dtype=np.uint8))
    write_points(points, tmp_path / "points.ply")
    ply = read_ply(tmp_path / "points.ply")
    assert np.array_equal(ply.positions, points.positions) and np.array_equal(ply.colors, points.colors)
    vertices, faces = generator.normal(size=(30, 3)), generator.integers(0, 30, (12, 3))
    colors = generator.integers(0, 256, (30, 3), dtype=np.uint8)
    write_ply(Mesh(vertices, faces, colors), tmp_path / "mesh.ply", offset=np.array([1e6, 0, 0.5]))
    ply = read_ply(tmp_path / "mesh.ply")
    assert np.array_equal(ply.triangles, faces) and np.array_equal(ply.colors, colors)
    assert [float(v) for v in ply.comment("offset").split()] == [1e6, 0.0, 0.5]
    assert np.allclose(ply.positions - (1e6, 0, 0.5), vertices, atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not a ply", "does not begin"),
        (b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n", "format is ascii"),
        (b"ply\nformat binary_little_endian 1.0\n", "no end"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nend_header\n1234", "cut short"),
        (b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty half x\nend_header\n1234", "half"),
    ],
)
def test_damaged_files_are_named(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(ValueError, match=f"a.ply: is no PLY that can be read here: .*{message}"):
        read_ply(tmp_path / "a.ply")


def test_a_missing_or_damaged_drive_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no imported drive"):
        read_drive(tmp_path)
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive/cameras.json").write_text('{"up": [0, 0, 1]}')
    with pytest.raises(ValueError, match="cameras.json: is no imported drive"):
        read_drive(tmp_path)
    (tmp_path / "drive/cameras.json").write_text("{")
    with pytest.raises(ValueError, match="cameras.json: cannot be read"):
        read_drive(tmp_path)


def test_discs_lie_as_the_surfels_do(tmp_path: Path) -> None:
    import torch

    from unveil_core.surfels.surfels import Surfels

    generator = torch.Generator().manual_seed(0)
    surfels = Surfels(
        means=torch.randn(20, 3, generator=generator), quats=torch.randn(20, 4, generator=generator),
        log_scales=torch.randn(20, 2, generator=generator), opacity_logits=torch.zeros(20),
        sh=torch.rand(20, 1, 3, generator=generator) - 0.5, labels=torch.arange(20) % 3,
    )  # fmt: skip
    write_surfels(surfels, tmp_path / "full.ply")
    centres, first, second, colors = surfel_discs(read_ply(tmp_path / "full.ply"))
    known = read_surfels(tmp_path / "full.ply")
    assert np.allclose(centres, known.means.numpy(), atol=1e-6)
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(np.abs((normals * known.normals().numpy()).sum(axis=1)), 1, atol=1e-5)
    lengths = np.stack([np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)], axis=1)
    assert np.allclose(lengths, SIGMAS * known.log_scales.exp().numpy(), rtol=1e-5)
    assert np.abs(colors / 255 - (known.sh[:, 0].numpy() * 0.28209479177387814 + 0.5)).max() < 0.003
    vertices, quads = discs(centres, first, second)
    assert np.allclose(vertices[quads].mean(axis=1), centres, atol=1e-5)


def test_points_are_closed_and_face_outwards() -> None:
    centres = np.array([[0.0, 0, 0], [5, 5, 5]])
    vertices, faces = tetrahedra(centres, np.array([1.0, 0.5]))
    middle = vertices[faces].mean(axis=1)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    assert ((middle - np.repeat(centres, 4, axis=0)) * normals).sum(axis=1).min() > 0
    assert np.allclose(np.linalg.norm(vertices[4:] - centres[1], axis=1), 0.5, atol=1e-6)


def test_class_colours_are_the_projects() -> None:
    assert tuple(CITYSCAPES) == classes.CITYSCAPES and tuple(CITYSCAPES.values()) == classes.COLORS
    assert tuple(color_table("semantics")[13]) == (0, 0, 142)


# ----------------------------------------------------------------------------------------------------------------- sequences


def test_numbered_files_are_taken_as_they_are(tmp_path: Path) -> None:
    files = [tmp_path / f"{i:04d}.png" for i in range(7, 12)]
    for f in files:
        f.write_bytes(b"x")
    found = numbered(files, tmp_path / "links")
    assert list(found.files) == files and found.first == 7 and not (tmp_path / "links").exists()


@pytest.mark.parametrize("names", [("3", "5"), ("9", "10"), ("a", "b"), ("1533.1", "1533.2"), ("1", "2.jpg")])
def test_other_files_get_numbered_links(names: tuple[str, ...], tmp_path: Path) -> None:
    files = [tmp_path / (n if "." in n[-4:-3] else f"{n}.png") for n in names]
    for f in files:
        f.write_text(f.name)
    found = numbered(files, tmp_path / "links")
    assert found.first == 0 and [f.stem for f in found.files] == ["000000", "000001"]
    assert [f.read_text() for f in found.files] == [f.name for f in files]
    files[0].unlink()
    files[0].write_text("new")  # as a stage replaces its results
    (tmp_path / "links/000007.png").write_text("left over")
    again = numbered(files, tmp_path / "links")
    assert again.files[0].read_text() == "new" and len(list((tmp_path / "links").iterdir())) == 2


def test_regions_get_colours_and_keep_their_pixels(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).integers(0, 4, (30, 41), dtype=np.uint8)
    png = cv2.imencode(".png", numbers)[1].tobytes()
    shown = cv2.imdecode(np.frombuffer(with_palette(png, REGION_COLORS), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(shown, np.array(REGION_COLORS, np.uint8)[numbers])
    for bad in (b"", b"GIF89a", cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()):
        with pytest.raises(ValueError, match="no grey 8-bit PNG"):
            with_palette(bad, REGION_COLORS)


# --------------------------------------------------------------------------------------------------------------------- boxes


def test_the_nearest_box_under_the_pointer_is_picked() -> None:
    """Seen along -z, as Blender's views are, with z up in the picture's y."""
    focal, width, height = 500.0, 640, 480
    perspective = np.array(
        [[2 * focal / width, 0, 0, 0], [0, 2 * focal / height, 0, 0], [0, 0, -1, -0.2], [0, 0, -1, 0]], np.float64
    )
    boxes = (
        SceneBox((0, 0, -10), (2, 2, 2), 0.4), SceneBox((1.2, 0, -20), (4, 4, 4), 0.0), SceneBox((0, 0, 0), (3, 3, 3), 0.0),
    )  # fmt: skip
    corners = np.stack([b.corners for b in boxes])

    def pixel(x: float, y: float, z: float) -> tuple[float, float]:
        return width / 2 + focal * x / -z, height / 2 + focal * y / -z

    def picked(*place: float) -> int | None:
        return pick(pixel(*place), corners, perspective, (width, height))

    # Where the first and the second overlap the nearer one is meant; the third, around the viewer, has no outline.
    assert picked(0, 0, -10) == 0 and picked(3.0, 0, -20) == 1 and picked(3.7, 1.9, -20) is None
    # Within the rectangle around the turned box, -73 to 73 pixels, but beside its outline; only that box is asked about.
    beside = (width / 2 - 70, height / 2 - 70)
    assert pick(beside, corners[:1], perspective, (width, height)) is None
    assert pick((width / 2 - 60, height / 2), corners[:1], perspective, (width, height)) == 0
    assert pick((5.0, 5.0), corners[:0], perspective, (width, height)) is None


def test_a_box_around_its_own_corners_is_itself() -> None:
    box = SceneBox((3.0, -2.0, 0.7), (4.2, 1.8, 1.5), 0.7)
    again = box_around(box.corners, 0.7)
    assert np.allclose(again.centre, box.centre) and np.allclose(again.size, box.size)

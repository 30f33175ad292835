"""A whole run at half the size of its footage, which is in a lens and has 16 bits: what is delivered is in both."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.base.pictures.test_metadata import in_file
from tests.small_street import make_small_street
from unveil_core.base.errors import Cancelled
from unveil_core.base.pictures.decoding import read_label_image, read_metadata
from unveil_core.base.pictures.metadata import metadata_of
from unveil_core.delivery.lens import footage_positions
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.pipeline.run import run, run_verb, stage_named
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

SETTINGS = RunSettings(quality="draft", iterations=60, splats=6_000, work_side=96)
K = {"k1": -0.06, "k2": 0.01, "p1": 0.001, "p2": -0.001}
FOCAL, WIDTH, HEIGHT = 85.0, 128, 80
NOTED = metadata_of(in_file("JPEG"))
"""Of a phone: Display P3, camera, place and notes."""


def in_lens(picture: np.ndarray, mode: int) -> np.ndarray:
    """A pinhole's picture (H, W…) as the lens shows it: where each of its pixels looks, found by iterating the formula."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    bent = np.stack([(x - WIDTH / 2) / FOCAL, (y - HEIGHT / 2) / FOCAL])
    flat = bent.copy()
    for _ in range(30):
        a, b = flat
        r = a * a + b * b
        radial = 1 + K["k1"] * r + K["k2"] * r * r
        more = np.stack(
            [2 * K["p1"] * a * b + K["p2"] * (r + 2 * a * a), K["p1"] * (r + 2 * b * b) + 2 * K["p2"] * a * b]
        )
        flat = (bent - more) / radial
    at = (flat * FOCAL + np.array([WIDTH / 2, HEIGHT / 2])[:, None, None]).astype(np.float32) - 0.5
    return cv2.remap(picture, at[0], at[1], mode, borderMode=cv2.BORDER_REPLICATE)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small street through a lens; its photographs have 16 bits, whose lower eight are their own."""
    path = make_small_street(tmp_path_factory.mktemp("street"))
    generator = np.random.default_rng(0)
    for file in sorted((path.parent / "images").glob("*.png")):
        bent = in_lens(cv2.imread(str(file)), cv2.INTER_CUBIC).astype(np.uint16)
        cv2.imwrite(str(file), bent * 256 + generator.integers(0, 256, bent.shape).astype(np.uint16))
        file.write_bytes(NOTED.in_png(file.read_bytes()))
    for folder in ("semantics", "instances"):
        for file in sorted((path.parent / folder).glob("*.png")):
            cv2.imwrite(str(file), in_lens(cv2.imread(str(file), cv2.IMREAD_UNCHANGED), cv2.INTER_NEAREST))
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "camera_model": "OPENCV", **K}))
    return path


@pytest.fixture(scope="module")
def done(street: Path, tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return run(street, tmp_path_factory.mktemp("runs") / "ws", SETTINGS, until="deliver")


def test_outside_of_what_went_each_pixel_is_the_file_s(street: Path, done: Workspace) -> None:
    drive = read_imported(done.drive_dir)
    assert (drive.frames[0].camera.width, drive.frames[0].camera.height) == (96, 60)
    changed = 0
    for frame in drive.frames:
        own = cv2.imread(str(street.parent / f"images/{frame.name}.png"), cv2.IMREAD_UNCHANGED)
        delivered = cv2.imread(str(done.root / f"frames/camera/{frame.name}.png"), cv2.IMREAD_UNCHANGED)
        assert delivered.dtype == np.uint16 and delivered.shape == own.shape == (HEIGHT, WIDTH, 3)
        masks = [done.root / f"masks/{n}/camera/{frame.name}.png" for n in ("removed", "shadows")]
        goes = np.maximum(*(read_label_image(m) for m in masks))
        wide = cv2.resize(goes, (WIDTH, HEIGHT), interpolation=cv2.INTER_LINEAR)
        touched = cv2.dilate(in_lens(wide, cv2.INTER_LINEAR), np.ones((5, 5))) > 0
        assert np.array_equal(delivered[~touched], own[~touched]) and touched.mean() < 0.5
        changed += int((delivered != own).any(axis=2).sum())
        assert read_metadata(done.root / f"frames/camera/{frame.name}.png") == NOTED
    assert changed > 1000
    assert sorted(p.name for p in (done.root / "frames/camera").iterdir()) == [f"{f.name}.png" for f in drive.frames]


def test_the_car_is_gone_in_the_lens_of_the_footage(street: Path, done: Workspace) -> None:
    errors = {"before": 0.0, "after": 0.0}
    for i in range(8):
        truth = in_lens(cv2.imread(str(street.parent / f"truth/images/{i:02d}.png")), cv2.INTER_CUBIC).astype(float)
        inside = in_lens(cv2.imread(str(street.parent / f"truth/removed/{i:02d}.png"), 0), cv2.INTER_NEAREST) > 0
        for name, path in (("before", street.parent / "images"), ("after", done.root / "frames/camera")):
            picture = cv2.imread(str(path / f"{i:02d}.png"), cv2.IMREAD_UNCHANGED) / 257
            errors[name] += float(((picture - truth)[inside] ** 2).sum())
    assert errors["after"] < 0.1 * errors["before"]


def test_what_is_compared_is_the_delivered_frame_as_imported(done: Workspace) -> None:
    for frame in read_imported(done.drive_dir).frames[:2]:
        seen = read_delivered(done.root, frame)
        clean = cv2.cvtColor(cv2.imread(str(done.root / f"clean/camera/{frame.name}.png")), cv2.COLOR_BGR2RGB)
        assert seen.shape == clean.shape
        assert np.abs(seen.astype(float) - clean).mean() < 3


def test_a_lens_has_st_maps_of_the_footage_s_size(done: Workspace) -> None:
    import OpenEXR

    assert sorted(p.relative_to(done.root).as_posix() for p in (done.root / "st_maps").rglob("*.exr")) == [
        "st_maps/camera/redistort.exr",
        "st_maps/camera/undistort.exr",
    ]
    with OpenEXR.File(str(done.root / "st_maps/camera/undistort.exr"), separate_channels=True) as file:
        red, green = (file.channels()[n].pixels for n in "RG")
    assert red.shape == (HEIGHT, WIDTH)
    # The map says where the footage shows what the pinhole's pixel does.
    frame = read_imported(done.drive_dir).frames[0]
    assert frame.footage is not None
    camera = frame.footage.camera
    rows, columns = np.array([10, 40, 70]), np.array([5, 64, 120])
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    found, _ = footage_positions(frame.footage, camera.centre + 5 * camera.rays_at(pixels))
    at = np.stack([red[rows, columns] * WIDTH, (1 - green[rows, columns]) * HEIGHT], axis=1)
    assert np.abs(found - at).max() < 1e-3


def test_delivering_again_does_nothing(done: Workspace) -> None:
    assert not run_verb("deliver", done.root)


def test_an_attempt_that_was_interrupted_goes_on(street: Path, done: Workspace, tmp_path: Path) -> None:
    again = Workspace.open(shutil.copytree(done.root, tmp_path / "ws", ignore=shutil.ignore_patterns(".lock")))

    def stop(event: dict[str, object]) -> None:
        if event["message"] == "delivering":
            raise Cancelled

    with pytest.raises(Cancelled):
        run_stages(again, [stage_named("deliver")], SETTINGS, street, force=True, reporter=stop)
    assert (again.root / ".partial-deliver/st_maps").is_dir()
    assert run_stages(again, [stage_named("deliver")], SETTINGS, street, force=True) == ["deliver"]
    for folder in ("frames", "st_maps"):
        files = sorted((done.root / folder).rglob("*.*"))
        assert files and all(f.read_bytes() == (again.root / f.relative_to(done.root)).read_bytes() for f in files)

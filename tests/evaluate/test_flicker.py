"""Flicker: none where nothing changes, the known amount where it does, and only where both frames see the same place."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import Cancelled
from unveil_core.base.files import write_image_atomic
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.flicker import (
    DepthGrid,
    differences,
    match_pixels,
    measure_flicker,
    read_depth,
)
from unveil_core.geometry.camera import Camera

WIDTH, HEIGHT, FOCAL, DISTANCE = 64, 48, 60.0, 6.0


def camera_at(x: float) -> Camera:
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def wall(camera: Camera, seed: int = 3) -> np.ndarray:
    """(H, W, 3) uint8: a smooth random texture on the plane z = DISTANCE."""
    generator = np.random.default_rng(seed)
    points = camera.centre + DISTANCE * camera.rays()
    waves = generator.normal(size=(6, 2)) * 1.5
    value = sum(np.sin(points[..., :2] @ w + 2 * k) for k, w in enumerate(waves))
    color = 128 + 12 * np.stack([value, np.roll(value, 1, 0), -value], axis=-1)
    return np.clip(np.round(color), 0, 255).astype(np.uint8)


def frames_at(positions: list[float]) -> list[Frame]:
    return [Frame(f"{i:02d}", "camera", camera_at(x), Path("none.png")) for i, x in enumerate(positions)]


def plane_depth(frame: Frame) -> DepthGrid:
    return DepthGrid(frame.camera, np.full((HEIGHT, WIDTH), DISTANCE))


def everywhere(frame: Frame) -> np.ndarray:
    return np.ones((HEIGHT, WIDTH), dtype=bool)


def test_a_static_view_of_a_static_scene_does_not_flicker() -> None:
    frames = frames_at([0.0, 0.0, 0.0])
    found = measure_flicker(frames, plane_depth, everywhere, lambda f: {"ours": wall(f.camera)})
    assert found["pairs"] == 2 and found["pixels"] == 4 * WIDTH * HEIGHT
    assert found["methods"]["ours"] == pytest.approx({"absolute": 0.0, "squared": 0.0, "pairs": 2}, abs=1e-12)


def test_a_moving_view_of_a_static_scene_hardly_flickers_and_the_wrong_motion_shows() -> None:
    frames = frames_at([0.0, 0.33, 0.71])
    pictures = lambda f: {"ours": wall(f.camera)}  # noqa: E731
    right = measure_flicker(frames, plane_depth, everywhere, pictures)["methods"]["ours"]["absolute"]
    still = measure_flicker(
        [replace(f, camera=camera_at(0)) for f in frames],
        plane_depth,
        everywhere,
        lambda f: {"ours": wall(frames[int(f.name)].camera)},
    )["methods"]["ours"]["absolute"]
    assert right < 0.6  # rounding to levels, twice
    assert still > 8 * right


def test_a_gain_per_frame_raises_it_by_the_known_amount() -> None:
    frames = frames_at([0.0] * 6)
    gains = np.random.default_rng(5).uniform(0.9, 1.0, len(frames))
    base = wall(camera_at(0.0)).astype(np.float64)
    shown = [np.round(g * base).astype(np.uint8) for g in gains]
    found = measure_flicker(frames, plane_depth, everywhere, lambda f: {"ours": shown[int(f.name)]})
    steps = np.abs(np.diff(gains))
    assert found["methods"]["ours"]["absolute"] == pytest.approx(steps.mean() * base.mean(), abs=0.1)
    assert found["methods"]["ours"]["squared"] == pytest.approx((steps**2).mean() * (base**2).mean(), rel=0.05)


def test_only_the_region_counts() -> None:
    frames = frames_at([0.0, 0.0])
    region = np.zeros((HEIGHT, WIDTH), dtype=bool)
    region[10:20, 10:30] = True
    first, second = wall(camera_at(0)), wall(camera_at(0))
    second[~region] = 255 - second[~region]
    shown = {"00": {"ours": first}, "01": {"ours": second}}
    found = measure_flicker(frames, plane_depth, lambda f: region, lambda f: shown[f.name])
    assert found["pixels"] == 2 * region.sum() and found["methods"]["ours"]["absolute"] < 1e-9
    assert measure_flicker(frames, plane_depth, lambda f: None, lambda f: shown[f.name]) == {}
    assert measure_flicker(frames, lambda f: None, lambda f: region, lambda f: shown[f.name]) == {}


def test_what_the_other_frame_does_not_see_does_not_count() -> None:
    """A post 2 m away hides different parts of the wall from two places; it covers 12 columns, 36 pixels to the side."""
    one, other = camera_at(0.0), camera_at(1.2)
    post = np.zeros((HEIGHT, WIDTH), dtype=bool)
    post[:, 40:52] = True
    behind = DepthGrid(one, np.full((HEIGHT, WIDTH), DISTANCE))
    hiding = DepthGrid(other, np.where(post, 2.0, DISTANCE))
    matches = match_pixels(behind, hiding, np.ones((HEIGHT, WIDTH), bool))
    # The wall's pixels move by 12 columns to the left.
    assert np.allclose(matches.x, matches.columns + 0.5 - 12) and np.allclose(matches.y, matches.rows + 0.5)
    expected = {c for c in range(12, WIDTH) if not 40 <= c - 12 < 52}
    assert set(matches.columns.tolist()) == expected
    back = match_pixels(hiding, behind, post)  # nor does the post, which the other frame does not show there
    assert not len(back.rows)


def test_depth_of_every_second_pixel_and_of_other_sizes(tmp_path: Path) -> None:
    """Depth that varies along the image: a sample belongs to the second of two pixels, not to their middle."""
    camera = camera_at(0.0)
    rows, columns = np.meshgrid(np.arange(HEIGHT), np.arange(WIDTH), indexing="ij")
    full = np.round((4.0 + 0.05 * columns + 0.02 * rows) * 256).astype(np.uint16)
    for name, image in (("full", full), ("half", full[1::2, 1::2]), ("odd", full[::3, ::3][:, :20])):
        write_image_atomic(tmp_path / f"{name}.png", image)
    half = read_depth(tmp_path / "half.png", camera)
    own_rows, own_columns = half.pixels()
    assert half.step == 2 and np.array_equal(half.depth * 256, full[np.ix_(own_rows, own_columns)])
    assert read_depth(tmp_path / "full.png", camera).step == 1
    odd = read_depth(tmp_path / "odd.png", camera)
    assert odd.step == 1 and odd.depth.shape == (HEIGHT, WIDTH)
    # A view sees itself where it is, through samples of every second pixel too.
    fine = DepthGrid(camera, full / 256.0)
    matches = match_pixels(half, fine, np.ones((HEIGHT, WIDTH), bool))
    assert len(matches.rows) == half.depth.size
    assert np.allclose(matches.x, matches.columns + 0.5) and np.allclose(matches.y, matches.rows + 0.5)
    picture = wall(camera)
    assert np.allclose(differences(picture, picture, matches), 0)


@pytest.mark.parametrize("size", [(160, 120), (128, 96), (100, 75)])
def test_depth_images_of_another_size_are_read_where_the_pixels_lie(tmp_path: Path, size: tuple[int, int]) -> None:
    """Of a road that begins 2 m before the camera, with a post 3 m away and nothing known above."""
    camera = camera_at(0.0)

    def depth_of(width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
        view = camera.resized(width, height)
        rays = view.rays()
        with np.errstate(divide="ignore"):
            depth = np.where(rays[..., 1] > 0.08, 1.2 / rays[..., 1], 0.0)
        post = np.abs(rays[..., 0] - 0.1) < 0.06
        return np.where(post & (depth > 3.0), 3.0, depth), post

    given, _ = depth_of(*size)
    write_image_atomic(tmp_path / "depth.png", np.round(given * 256).astype(np.uint16))
    found = read_depth(tmp_path / "depth.png", camera)
    assert found.step == 1
    true, post = depth_of(WIDTH, HEIGHT)
    known = (true > 0) & (found.depth > 0)
    error = np.abs(found.depth / np.where(true > 0, true, 1.0) - 1)
    inner = ~(np.abs(np.gradient(post.astype(float), axis=1)) > 0) & known & (true < 6)
    assert inner.sum() > 700 and error[inner].max() < 0.01
    # At the post's edges it is the one depth or the other.
    road = 1.2 / np.maximum(camera.rays()[..., 1], 0.08)
    close = known & (true < 6)
    assert (np.minimum(np.abs(found.depth / 3.0 - 1), np.abs(found.depth / road - 1)) < 0.05)[close].all()
    assert (known == (true > 0)).mean() > 0.98


def test_cameras_are_tracks_of_their_own_and_methods_may_lack_frames() -> None:
    frames = frames_at([0.0, 0.0, 0.0, 0.0])
    frames = [replace(f, camera_name="left" if i % 2 else "right") for i, f in enumerate(frames)]
    shown = [np.full((HEIGHT, WIDTH, 3), v, np.uint8) for v in (10, 200, 12, 206)]

    def pictures(frame: Frame) -> dict[str, np.ndarray]:
        own = {"ours": shown[int(frame.name)]}
        return own if frame.name == "03" else {**own, "telea": shown[int(frame.name)]}

    found = measure_flicker(frames, plane_depth, everywhere, pictures)
    assert found["pairs"] == 2
    assert found["methods"]["ours"] == {"absolute": 4.0, "squared": 20.0, "pairs": 2}
    assert found["methods"]["telea"] == {"absolute": 2.0, "squared": 4.0, "pairs": 1}


def test_it_can_be_cancelled() -> None:
    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        measure_flicker(frames_at([0.0, 0.0]), plane_depth, everywhere, lambda f: {}, stop)


@pytest.mark.parametrize("after", [1, 2, 3, 5, 6])
def test_it_goes_on_where_it_was_interrupted(after: int, tmp_path: Path) -> None:
    frames = frames_at([0.0, 0.1, 0.25, 0.0, 0.2, 0.4])
    frames = [replace(f, camera_name="left" if i < 3 else "right") for i, f in enumerate(frames)]
    looked: list[str] = []

    def pictures(frame: Frame) -> dict[str, np.ndarray]:
        looked.append(frame.name)
        return {"ours": wall(frame.camera, seed=int(frame.name))}

    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        if done == after:
            raise Cancelled

    whole = measure_flicker(frames, plane_depth, everywhere, pictures)
    checkpoint = Kept(tmp_path, every_s=0.0).checkpoint("flicker")
    with pytest.raises(Cancelled):
        measure_flicker(frames, plane_depth, everywhere, pictures, stop, checkpoint)
    looked.clear()
    assert measure_flicker(frames, plane_depth, everywhere, pictures, checkpoint=checkpoint) == whole
    assert len(looked) <= len(frames) - max(0, after - 3)

"""The parts of the rows, where one knows what must come out."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.base.errors import SettingsError
from unveil_core.bench.plot import spread
from unveil_core.bench.rows import ROWS, chosen_rows
from unveil_core.bench.rows.flow import bilinear, complete_smoothly, inpaint_along_flow
from unveil_core.bench.rows.footage import fill_around
from unveil_core.bench.rows.reverse import transferred
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.losses import depth_prior

WIDTH, HEIGHT = 96, 64


def texture(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(…, 3) uint8 of a wall, smooth and nowhere the same."""
    waves = [np.sin(0.31 * x + 0.17 * y + k) + np.sin(0.13 * x - 0.23 * y + 2 * k) for k in range(3)]
    return np.clip(np.round(128 + 60 * np.stack(waves, axis=-1)), 0, 255).astype(np.uint8)


def panning(count: int, step: float) -> list[np.ndarray]:
    """A film of the wall that moves to the left by so many pixels a frame."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return [texture(x + step * t, y) for t in range(count)]


def never(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    raise AssertionError("there is nothing to invent")


def test_thin_plates_continue_planes() -> None:
    y, x = np.mgrid[:50, :70].astype(np.float32)
    plane = np.stack([0.3 * x - 0.1 * y + 2, 0.05 * x + 0.4 * y], axis=2)
    hole = np.zeros((50, 70), bool)
    hole[20:40, 50:] = True  # to the border, where it has to be continued, not interpolated
    broken = plane.copy()
    broken[hole] = 99
    done = complete_smoothly(broken, hole)
    assert np.abs(done - plane)[hole].max() < 0.2, "the tension bends it a little"
    assert np.array_equal(done[~hole], plane[~hole])
    everything = np.ones_like(hole)
    assert np.array_equal(complete_smoothly(broken, everything), broken), "nothing is known"


def test_between_pixels_colours_are_mixed() -> None:
    ramp = np.arange(12, dtype=np.float32).reshape(3, 4, 1)
    places = np.array([[0.5, 0.0], [1.25, 1.5], [9.0, 9.0], [-3.0, 1.0]])
    np.testing.assert_allclose(bilinear(ramp, places)[:, 0], [0.5, 7.25, 11.0, 4.0], rtol=1e-6)


def test_what_another_frame_shows_comes_along_the_flow() -> None:
    """An object that stands still in the picture hides another part of the wall in every frame."""
    film = panning(7, 6.0)
    hole = np.zeros((HEIGHT, WIDTH), bool)
    hole[20:44, 38:58] = True
    # As in the rows the hole is larger than the object: optical flow sees objects some pixels around them.
    box = hole & np.roll(hole, 6, 0) & np.roll(hole, -6, 0) & np.roll(hole, 6, 1) & np.roll(hole, -6, 1)
    crowded = [np.where(box[..., None], 255, image).astype(np.uint8) for image in film]
    done = inpaint_along_flow(crowded, [hole] * 7, never)
    for t, (picture, true) in enumerate(zip(done, film, strict=True)):
        assert np.array_equal(picture[~hole], true[~hole])
        error = np.abs(picture.astype(int) - true)[hole]
        assert error.mean() < 12, (t, error.mean())


def test_what_no_frame_shows_is_invented_once() -> None:
    """The hole moves with the wall: nobody sees behind it, and all frames get the same."""
    film = panning(5, 4.0)
    holes = []
    for t in range(5):
        hole = np.zeros((HEIGHT, WIDTH), bool)
        hole[24:44, 50 - 4 * t : 66 - 4 * t] = True
        holes.append(hole)
    asked: list[int] = []

    def one_colour(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
        asked.append(int(mask.sum()))
        return np.where(mask[..., None], (10, 200, 30), image).astype(np.uint8)

    done = inpaint_along_flow(film, holes, one_colour)
    assert asked[0] == 320 and sum(asked[1:]) < 320, "the others get most of it from the first"
    inner = [h & np.roll(h, 4, 0) & np.roll(h, -4, 0) & np.roll(h, 4, 1) & np.roll(h, -4, 1) for h in holes]
    for picture, hole in zip(done, inner, strict=True):
        assert np.abs(picture[hole].astype(int) - (10, 200, 30)).mean() < 5


def test_a_view_is_carried_to_another_by_depth() -> None:
    """Two cameras before a wall 5 m away; a box 2 m away hides part of it from the other."""
    pose = np.eye(4)
    here = Camera(WIDTH, HEIGHT, 80.0, 80.0, WIDTH / 2, HEIGHT / 2, pose)
    moved = pose.copy()
    moved[0, 3] = -0.5  # half a metre to the right: the wall shifts by 8 pixels
    there = Camera(WIDTH, HEIGHT, 80.0, 80.0, WIDTH / 2, HEIGHT / 2, moved)
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    own, other = texture(x, y), texture(x + 8, y)
    depth, other_depth = np.full((HEIGHT, WIDTH), 5.0), np.full((HEIGHT, WIDTH), 5.0)
    other_depth[:, 20:30], other[:, 20:30] = 2.0, 0
    wanted = np.zeros((HEIGHT, WIDTH), bool)
    wanted[10:50] = True
    picture, shown = transferred(here, depth, wanted, there, other, other_depth)
    expected = wanted & (x >= 8) & ((x < 28) | (x >= 38))
    assert np.array_equal(shown, expected)
    sure = shown & ~((x > 25) & (x < 41))  # cubic interpolation reaches across the box's edge
    assert np.abs(picture.astype(int) - own)[sure].max() <= 1


def test_holes_are_filled_each_from_its_surroundings() -> None:
    image = np.zeros((60, 200, 3), np.uint8)
    image[:, :100], image[:, 100:] = (200, 0, 0), (0, 0, 200)
    mask = np.zeros((60, 200), bool)
    mask[25:35, 20:30] = mask[25:35, 170:180] = True
    seen: list[set[tuple[int, ...]]] = []

    def remember(part: np.ndarray, hole: np.ndarray) -> np.ndarray:
        seen.append({tuple(c) for c in part[~hole].tolist()})
        return np.where(hole[..., None], part[~hole].mean(axis=0), part).astype(np.uint8)

    done = fill_around(remember, image, mask)
    assert seen == [{(200, 0, 0)}, {(0, 0, 200)}] or seen == [{(0, 0, 200)}, {(200, 0, 0)}]
    assert np.array_equal(done, image * ~mask[..., None] + done * mask[..., None]) and done[30, 25].tolist() == [
        200,
        0,
        0,
    ]


def test_rows_are_chosen_by_name() -> None:
    assert list(chosen_rows(())) == list(ROWS)
    assert set(chosen_rows(("ours", "flow"))) == {"ours", "flow"}
    with pytest.raises(SettingsError, match="Not a row: oars"):
        chosen_rows(("oars",))


def test_names_in_a_plot_make_room_for_each_other() -> None:
    assert spread([5.0, 40.0, 20.0], 10) == [5.0, 40.0, 20.0], "there is room"
    assert spread([20.0, 21.0], 10) == [15.5, 25.5]
    generator = np.random.default_rng(0)
    places = generator.uniform(0, 60, 9).tolist()
    moved = spread(places, 10)
    assert np.diff(sorted(moved)).min() > 10 - 1e-9 and np.argsort(moved).tolist() == np.argsort(places).tolist()


def test_depth_prior_pulls_towards_the_expected_depth() -> None:
    alpha = torch.tensor([[1.0, 0.5], [1.0, 0.0]])
    expected = torch.tensor([[4.0, 4.0], [0.0, 4.0]])
    depth = torch.tensor([[5.0, 2.0], [9.0, 0.0]], requires_grad=True)
    loss = depth_prior(depth, alpha, expected)
    loss.backward()
    assert loss.item() == pytest.approx((1.0 / 4) / 4), "half covered at the right depth, and uncovered, are no error"
    assert depth.grad is not None and float(depth.grad[0, 0]) > 0 and float(depth.grad[1, 0]) == 0

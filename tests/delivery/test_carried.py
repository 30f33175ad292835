"""What other photographs show of the street behind a removed object is taken from them, where they show it better."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from tests.delivery.test_views import over_ground
from tests.ground.test_street import look
from unveil_core.delivery.carried import Photographs, carried_over
from unveil_core.delivery.views import EmptyView, EmptyViews
from unveil_core.geometry.images import grow, sample_at

SIZE = (384, 256)
HOLE = (slice(150, 200), slice(150, 230))
SEEN_FROM = (-1.0, 1.2, 2.0)
"""Metres along the street; the first camera has the hole."""
PAVING = np.random.default_rng(0).integers(40, 216, (400, 400, 3)).astype(np.uint8)
"""Slabs of a tenth of a metre."""


def view(x: float) -> EmptyView:
    return over_ground(look(np.array([x, 0.3 * x, 1.6]), 0.0).resized(*SIZE))


def photographed(seen: EmptyView) -> np.ndarray:
    """The paved ground, grey above the horizon."""
    ground = seen.depth > 0
    places = seen.camera.unproject(np.where(ground, seen.depth, 1.0))[..., :2].reshape(-1, 2)
    picture = sample_at(PAVING, (places + (5.0, 20.0)) * 10).reshape(*ground.shape, 3)
    return np.where(ground[..., None], picture, np.uint8(120)).astype(np.uint8)


def hole() -> np.ndarray:
    mask = np.zeros(SIZE[::-1], bool)
    mask[HOLE] = True
    return mask


def street_of(views: list[EmptyView], pictures: list[np.ndarray]) -> Photographs:
    """The first photograph shows a red car in the hole."""
    first = pictures[0].copy()
    first[HOLE] = (200, 20, 20)
    views = [replace(views[0], barred=grow(hole(), 2)), *views[1:]]
    return Photographs(EmptyViews([v.camera for v in views], views), [first, *pictures[1:]], None)


def drive() -> tuple[list[EmptyView], list[np.ndarray]]:
    views = [view(0.0), *(view(x) for x in SEEN_FROM)]
    return views, [photographed(v) for v in views]


def error(picture: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(picture.astype(float) - truth)[HOLE].mean())


def smooth(picture: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(picture, (0, 0), 4.0)


def test_what_is_sharp_elsewhere_is_carried_over() -> None:
    views, pictures = drive()
    rendered = smooth(pictures[0])
    found = carried_over(street_of(views, pictures), 0, rendered, rendered, hole())
    assert error(found, pictures[0]) < 0.5 * error(rendered, pictures[0])
    assert (found[~hole()] == rendered[~hole()]).all()


def test_another_light_is_taken_out_by_the_ring() -> None:
    views, pictures = drive()
    rendered = smooth(pictures[0])
    straight = carried_over(street_of(views, pictures), 0, rendered, rendered, hole())
    # A road glares where it mirrors the sun: more to the right.
    glare = np.linspace(0, 40, SIZE[0])[None, :, None]
    lit = [pictures[0], *(np.clip(p + 10 + glare, 0, 255).astype(np.uint8) for p in pictures[1:])]
    found = carried_over(street_of(views, lit), 0, rendered, rendered, hole())
    assert error(found, pictures[0]) < error(straight, pictures[0]) + 3


def test_a_photograph_that_is_a_pixel_off_is_put_right() -> None:
    views, pictures = drive()
    rendered = smooth(pictures[0])
    moved = np.array([[1, 0, 1.5], [0, 1, -1.0]])
    off = [pictures[0], *(cv2.warpAffine(p, moved, SIZE, borderMode=cv2.BORDER_REPLICATE) for p in pictures[1:])]
    found = carried_over(street_of(views, off), 0, rendered, rendered, hole())
    assert error(found, pictures[0]) < 0.6 * error(rendered, pictures[0])


def test_the_render_stays_where_photographs_show_it_worse() -> None:
    views, pictures = drive()
    rendered = pictures[0]
    others = [np.ascontiguousarray(p[:, ::-1]) for p in pictures[1:]]  # what they show is not there
    found = carried_over(street_of(views, [pictures[0], *others]), 0, rendered, rendered, hole())
    assert error(found, pictures[0]) < 1


def test_what_is_barred_in_all_others_stays_rendered() -> None:
    views, pictures = drive()
    rendered = smooth(pictures[0])
    barred = [views[0], *(replace(v, barred=np.ones(SIZE[::-1], bool)) for v in views[1:])]
    nothing = np.zeros_like(hole())
    assert np.array_equal(carried_over(street_of(barred, pictures), 0, rendered, rendered, hole()), rendered)
    assert carried_over(street_of(views, pictures), 0, rendered, rendered, nothing) is rendered


def test_there_are_no_hard_seams() -> None:
    views, pictures = drive()
    half = np.zeros(SIZE[::-1], bool)
    half[:, : SIZE[0] // 2] = True
    views = [
        views[0],
        replace(views[1], barred=half),
        replace(views[2], barred=np.ones_like(half)),
        replace(views[3], barred=~half),
    ]
    plain = [np.full_like(p, 100) for p in pictures]
    plain[3] += 20
    # Light is told by the ring; where that is said to be none the sources differ by 20 levels.
    rendered = np.full_like(plain[0], 110)
    found = carried_over(street_of(views, plain), 0, rendered, rendered, hole())
    rows = found[HOLE].astype(int)
    assert np.abs(np.diff(rows, axis=1)).max() <= 6


def waves(phase: float = 0.0) -> np.ndarray:
    """(H, W, 3) levels of something smooth, longer than the ring is wide and shorter than the hole is long."""
    row, column = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    level = 110 + 20 * np.sin(column / 9 + phase) + 15 * np.cos(row / 7 + phase)
    return np.repeat(np.round(level)[..., None], 3, axis=2).astype(np.uint8)


def test_a_photograph_of_something_else_is_not_taken_for_being_fitted_to_the_ring() -> None:
    """After a smooth correction it agrees with the ring that it was corrected by, and says nothing of the hole."""
    views, _ = drive()
    truth = waves()
    rendered = truth + np.uint8(4)  # right, but for the light
    found = carried_over(street_of(views, [truth, *(waves(1.9 + k) for k in range(3))]), 0, rendered, rendered, hole())
    assert error(found, truth) < 5


def test_photographs_and_scene_are_lit_alike_before_they_are_compared() -> None:
    """A sharp render in another light beats a blurred photograph in the right one."""
    views, pictures = drive()
    rendered = np.clip(pictures[0].astype(int) - 12, 0, 255).astype(np.uint8)
    found = carried_over(
        street_of(views, [pictures[0], *(smooth(p) for p in pictures[1:])]), 0, rendered, rendered, hole()
    )
    assert error(found, pictures[0]) < 13

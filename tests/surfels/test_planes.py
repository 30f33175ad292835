"""Agreement by planes against the definition of correlation, and where it is greatest."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.textured_street import GROUND, WALL, WALL_M, TexturedStreet
from unveil_core.base.parallel import threads
from unveil_core.surfels.planes import BlurredView, agreement, blurred_view

UP, LEFT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
HALF = 5


def view(x: float, street: TexturedStreet | None = None) -> tuple[BlurredView, np.ndarray]:
    street = street or TexturedStreet(crown=0.0)
    camera = street.camera(x)
    image, kind = street.photograph(camera)
    return blurred_view(camera, image, 240), kind


@pytest.fixture(scope="module")
def views() -> list[tuple[BlurredView, np.ndarray]]:
    return [view(x) for x in (0.0, 1.0, 3.0)]


def test_the_true_plane_agrees_and_others_do_not(views: list[tuple[BlurredView, np.ndarray]]) -> None:
    (own, kind), (other, _), _ = views
    near = (kind == GROUND) & (np.arange(len(kind))[:, None] > 105)
    true, low, high = (agreement(own, [other], -UP, np.array([h]), HALF)[near] for h in (1.5, 1.2, 1.9))
    assert np.median(true[true > -1]) > 0.97
    assert max(np.median(low[low > -1]), np.median(high[high > -1])) < 0.6
    wall = (kind == WALL) & (np.arange(kind.shape[1])[None] < 90)
    there, nearer = (agreement(own, [other], LEFT, np.array([d]), HALF)[wall] for d in (WALL_M, 0.7 * WALL_M))
    assert np.median(there[there > -1]) > 0.97 > 0.6 > np.median(nearer[nearer > -1])


def test_a_picture_twice_as_fine_still_agrees_in_spite_of_its_noise() -> None:
    cobbles = TexturedStreet(crown=0.0, finest=0.04)
    (own, kind), (clean, _) = (view(x, cobbles) for x in (0.0, 3.0))
    noise = np.random.default_rng(0).normal(0, 25, (*clean.levels.shape[1:], 1))
    image = np.clip(clean.levels[0][..., None] + noise, 0, 255).astype(np.uint8).repeat(3, axis=2)
    other = blurred_view(clean.camera, image, 240)
    # 6 m ahead of the one and 3 m ahead of the other, which shows it twice as large.
    rays = own.camera.rays() @ UP
    ahead = np.where(rays < 0, -1.5 / np.minimum(rays, -1e-9), np.inf)
    place = (kind == GROUND) & (ahead > 6.0) & (ahead < 7.5)
    found = agreement(own, [other], -UP, np.array([1.5]), HALF)[place]
    assert (found > -1).mean() > 0.2
    assert np.median(found[found > -1]) > 0.7
    sharp = [BlurredView(v.camera, np.repeat(v.levels[:1], len(v.levels), axis=0)) for v in (own, other)]
    noisy = agreement(sharp[0], [sharp[1]], -UP, np.array([1.5]), HALF)[place]
    assert np.median(noisy[noisy > -1]) < np.median(found[found > -1])


def test_it_is_the_correlation_of_the_windows() -> None:
    street = TexturedStreet(crown=0.0)
    camera = street.camera(0.0)
    first = blurred_view(camera, street.photograph(camera)[0], 240)
    generator = np.random.default_rng(0)
    noise = generator.integers(0, 255, (*first.levels.shape[1:], 3)).astype(np.uint8)
    second = blurred_view(camera, noise, 240)
    # The same place: each pixel corresponds to itself, by any plane.
    found = agreement(first, [second], np.array([1.0, 0.0, 0.0]), np.array([9.0]), HALF)
    a, b = (v.levels[0].astype(np.float64) for v in (first, second))
    side = 2 * HALF + 1
    mean_a, mean_b, square_a, square_b, both = (
        cv2.blur(p, (side, side), borderType=cv2.BORDER_CONSTANT) for p in (a, b, a * a, b * b, a * b)
    )
    spread = (square_a - mean_a**2) * (square_b - mean_b**2)
    true = (both - mean_a * mean_b) / np.sqrt(np.maximum(spread, 4.0))
    inner = np.s_[HALF + 1 : -HALF - 2, HALF + 1 : -HALF - 2]
    assert np.abs(found[inner] - true[inner]).max() < 1e-4


def test_the_best_of_planes_and_views_counts(views: list[tuple[BlurredView, np.ndarray]]) -> None:
    (own, _), (near, _), (far, _) = views
    heights = np.array([1.2, 1.5])
    each = [agreement(own, [v], -UP, np.array([h]), HALF) for v in (near, far) for h in heights]
    assert np.allclose(agreement(own, [near, far], -UP, heights, HALF), np.max(each, axis=0), atol=1e-6)


def test_what_has_no_texture_or_counterpart_does_not_agree() -> None:
    plain, _ = view(0.0, TexturedStreet(crown=0.0, rough=0.0))
    other, kind = view(1.0, TexturedStreet(crown=0.0, rough=0.0))
    found = agreement(plain, [other], -UP, np.array([1.5]), HALF)
    inside = cv2.erode((kind == GROUND).astype(np.uint8), np.ones((31, 31), np.uint8)).astype(bool)
    assert found[inside].max() < 0.05
    beyond, _ = view(60.0)
    assert (agreement(plain, [beyond], -UP, np.array([1.5]), HALF)[-8:, :40] == -1).all()


def test_any_number_of_threads_finds_the_same(views: list[tuple[BlurredView, np.ndarray]]) -> None:
    (own, _), (near, _), (far, _) = views
    found = []
    for count in (1, 3):
        with threads(count):
            found.append(agreement(own, [near, far], -UP, np.array([1.4, 1.5]), HALF))
    assert np.array_equal(*found)

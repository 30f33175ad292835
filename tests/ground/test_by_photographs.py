"""The height of cameras, places on the ground and the pixels that show it, by photographs of streets whose truth is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from tests.textured_street import BOX, GROUND, HEIGHT, WALL, WIDTH, TexturedStreet
from unveil_core.base.frame_cache import FrameCache
from unveil_core.geometry.camera import Camera
from unveil_core.ground.by_photographs import StreetViews, heights_over_ground, shows_ground

PLACES = np.arange(0.0, 12.0, 2.0)
NOTHING = [np.zeros((HEIGHT, WIDTH), dtype=bool)] * len(PLACES)


def seen(street: TexturedStreet, cameras: Sequence[Camera]) -> tuple[StreetViews, list[np.ndarray]]:
    pictures = [street.photograph(c) for c in cameras]
    return StreetViews.of(cameras, [image for image, _ in pictures], FrameCache()), [kind for _, kind in pictures]


@pytest.mark.parametrize(("height", "slope"), [(1.5, 0.0), (2.6, 0.05), (0.9, -0.04)])
def test_heights_and_places_of_a_crowned_street(height: float, slope: float) -> None:
    street = TexturedStreet(slope=slope)
    views, _ = seen(street, [street.camera(x, height) for x in PLACES])
    found = heights_over_ground(views, NOTHING)
    assert found is not None
    heights, places = found
    assert np.abs(heights / height - 1).max() < 0.04
    error = places[:, 2] - street.height(places)
    assert len(places) > 50
    assert abs(np.median(error)) < 0.02 * height
    assert np.percentile(np.abs(error), 80) < 0.04 * height


def test_pixels_of_the_ground() -> None:
    street = TexturedStreet()
    views, kinds = seen(street, [street.camera(x) for x in PLACES])
    for i in (1, 3):
        found = shows_ground(views, i, 1.5, (HEIGHT, WIDTH))
        # Beyond 20 heights of the camera nothing is told.
        rays = street.camera(PLACES[i]).rays()
        asked = rays[..., 2] < -1 / 18
        truth = (kinds[i] == GROUND) & asked
        assert (found & truth).sum() > 0.85 * truth.sum()
        upright = np.isin(kinds[i], (WALL, BOX))
        assert (found & upright).sum() < 0.05 * upright.sum()
        assert not found[rays[..., 2] > 0].any()


def test_pixels_at_another_size() -> None:
    street = TexturedStreet()
    views, _ = seen(street, [street.camera(x) for x in PLACES])
    small, large = (shows_ground(views, 2, 1.5, shape) for shape in ((HEIGHT, WIDTH), (2 * HEIGHT, 2 * WIDTH)))
    assert large.shape == (2 * HEIGHT, 2 * WIDTH)
    assert (large[::2, ::2] == small).mean() > 0.99


def test_no_height_without_texture_or_way() -> None:
    plain = TexturedStreet(rough=0.0)
    assert heights_over_ground(seen(plain, [plain.camera(x) for x in PLACES])[0], NOTHING) is None
    street = TexturedStreet()
    standing, _ = seen(street, [street.camera(0.0)] * len(PLACES))
    assert heights_over_ground(standing, NOTHING) is None
    assert not shows_ground(standing, 2, 1.5, (HEIGHT, WIDTH)).any()


@pytest.mark.parametrize("slab", [0.5, 1.0, 2.0])
def test_paving_that_repeats_itself_needs_points_to_tell_the_height(slab: float) -> None:
    # Slabs of which so many make the way from frame to frame look alike on the true height and on others.
    street = TexturedStreet(paved=slab)
    views, _ = seen(street, [street.camera(x) for x in 2 * PLACES])
    found = heights_over_ground(views, NOTHING)
    assert found is None or np.abs(found[0] / 1.5 - 1).max() < 0.05
    found = heights_over_ground(views, NOTHING, usual=1.4)
    assert found is not None
    assert np.abs(found[0] / 1.5 - 1).max() < 0.05


def test_barred_pixels_tell_nothing() -> None:
    street = TexturedStreet()
    views, _ = seen(street, [street.camera(x) for x in PLACES])
    assert heights_over_ground(views, [~mask for mask in NOTHING]) is None

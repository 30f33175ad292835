"""The ground looks darker in the corners of the pictures and brighter far off; the chart does not."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.chart.test_chart import painted_street
from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.base.types import Picture
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.looks import read_looks
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart, read_chart, rows_of
from unveil_core.inpaint.light.view_light import ViewLight, light_by_view, light_of, lit, unlit

SIZE = (216, 144)


@pytest.fixture(scope="module")
def street():  # type: ignore[no-untyped-def]
    return painted_street()


def factor() -> np.ndarray:
    """(H, W, 1) linear light: half in the lower corners, more towards the horizon."""
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]] + 0.5
    away = ((x / SIZE[0] - 0.5) ** 2 + (y / SIZE[1] - 0.5) ** 2) / 0.5
    return ((1 - 0.55 * away) * (1 + 0.4 * np.clip(1.5 - y / SIZE[1] * 1.5, 0, 1)))[..., None]


def darkened(picture: Picture) -> Picture:
    light = linear_of_srgb(picture / 255) * factor()
    return np.round(255 * srgb_of_linear(np.clip(light, 0, 1))).astype(np.uint8)


def light_in(street, images: list[Picture]) -> ViewLight | None:  # type: ignore[no-untyped-def]
    ground, cameras, _, _, usable = street
    looks = read_looks(ground, cameras, [0] * len(cameras), images, usable, (0, rows_of(ground)))
    return light_by_view(looks, [SIZE])


@pytest.mark.parametrize("cut", [10, 11, 14, 16])
def test_stretches_that_meet_number_the_same_places_alike_and_others_apart(street, cut: int) -> None:  # type: ignore[no-untyped-def]
    """Wherever a street is cut, its two parts look at the places that the whole one looks at."""
    ground, cameras, images, _, usable = street
    whole, before, after = (
        read_looks(ground, cameras, [0] * len(cameras), images, usable, rows)
        for rows in ((0, rows_of(ground)), (0, cut), (cut, rows_of(ground)))
    )
    assert not np.intersect1d(before.place, after.place).size
    places = np.concatenate([before.place, after.place])
    assert np.array_equal(np.unique(places), np.unique(whole.place)) and len(places) == len(whole.place)
    at = {int(p): int(c) for p, c in zip(whole.place, whole.cell, strict=True)}
    cells = np.concatenate([before.cell, after.cell])
    assert all(at[int(p)] == c for p, c in zip(places, cells, strict=True))


def chart_of(street, images) -> StreetChart:  # type: ignore[no-untyped-def]
    ground, cameras, _, labels, usable = street
    return read_chart(ground, cameras, images, labels, usable)


@pytest.fixture(scope="module")
def dark(street) -> list[Picture]:  # type: ignore[no-untyped-def]
    return [darkened(image) for image in street[2]]


@pytest.fixture(scope="module")
def light(street, dark: list[Picture]) -> ViewLight:  # type: ignore[no-untyped-def]
    found = light_in(street, dark)
    assert found is not None
    return found


def test_the_chart_no_longer_shows_where_it_was_seen(street, dark: list[Picture], light: ViewLight) -> None:  # type: ignore[no-untyped-def]
    true, uneven = chart_of(street, street[2]), chart_of(street, dark)
    even = chart_of(street, [unlit(image, light.fields[0]) for image in dark])
    known = (true.source == OBSERVED) & (true.nearest < 15)
    known[:, : known.shape[1] // 4] = False  # the car's side

    def spread(chart: StreetChart) -> float:
        """Of how much brighter or darker than it is the ground looks, from place to place."""
        left = light_of(np.round(chart.color[known] * 255).astype(np.uint8)) - light_of(
            np.round(true.color[known] * 255).astype(np.uint8)
        )
        return float(np.std(left))

    assert spread(uneven) > 0.12
    assert spread(even) < 0.5 * spread(uneven)
    assert light.error < 0.7 * light.error_without


def test_a_frame_gets_its_light_back(dark: list[Picture], light: ViewLight) -> None:
    field, image = light.fields[0], dark[0]
    clear = (image.max(axis=2) < 200) & (image.min(axis=2) > 20)
    back = lit(unlit(image, field)[clear] / 255, field.plane()[clear])
    assert np.abs(back * 255 - image[clear]).max() < 1


def test_a_layer_shows_the_ground_in_the_light_of_the_camera(street, dark: list[Picture], light: ViewLight) -> None:  # type: ignore[no-untyped-def]
    _, cameras, _, _, usable = street
    layer = GroundLayer(chart_of(street, [unlit(image, light.fields[0]) for image in dark]))
    middle = len(cameras) // 2
    errors = {}
    for name, field in (("with", light.fields[0]), ("without", None)):
        pixels = layer.sample(cameras[middle], usable[middle], field)
        shown = pixels.covered & (pixels.depth < 15)
        errors[name] = float(np.abs(pixels.color[shown] * 255 - dark[middle][shown]).mean())
    assert errors["with"] < 0.6 * errors["without"]


def test_even_light_stays_as_it_is(street) -> None:  # type: ignore[no-untyped-def]
    found = light_in(street, street[2])
    if found is not None:  # paint that a pixel mixes with asphalt may be explained by a hair
        assert np.median(np.abs(found.fields[0].plane()[SIZE[1] // 2 :] - found.level)) < 0.05


def test_no_ground_is_no_light(street) -> None:  # type: ignore[no-untyped-def]
    ground, cameras, images, labels, usable = street
    nothing = [np.zeros_like(u) for u in usable]
    assert light_in((ground, cameras, images, labels, nothing), images) is None

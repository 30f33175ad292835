"""Crops around the cars, and the sums of a picture against the photograph by part."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.evaluate.holdout.compared import LEAST_CROP_PX, Compared, PartSums, Photograph, crop_around


def box(shape: tuple[int, int], rows: slice, columns: slice) -> np.ndarray:
    mask = np.zeros(shape, dtype=bool)
    mask[rows, columns] = True
    return mask


@pytest.mark.parametrize(
    ("rows", "columns", "expected"),
    [
        (slice(100, 180), slice(200, 300), (slice(75, 205), slice(175, 325))),  # a quarter of 100 on each side
        (slice(100, 104), slice(200, 210), (slice(70, 134), slice(173, 237))),  # no less than 64 a side
        (slice(0, 40), slice(390, 400), (slice(0, 64), slice(336, 400))),  # shifted, not cut
    ],
)
def test_a_crop_is_the_car_and_its_margin(rows: slice, columns: slice, expected: tuple[slice, slice]) -> None:
    assert crop_around(box((240, 400), rows, columns)) == expected


def test_a_crop_is_no_larger_than_the_picture() -> None:
    assert crop_around(box((40, 90), slice(10, 20), slice(0, 90))) == (slice(0, 40), slice(0, 90))
    assert LEAST_CROP_PX > 40


def test_only_the_part_differs_from_the_photograph_in_its_crop() -> None:
    truth, picture = np.full((100, 120, 3), 90, np.uint8), np.full((100, 120, 3), 200, np.uint8)
    part = box((100, 120), slice(40, 60), slice(50, 70))
    compared = Compared.of(Photograph.of(truth, part, None), picture)
    pasted, photograph = compared.crop(part, (slice(30, 94), slice(40, 104)))
    assert pasted.shape == photograph.shape == (64, 64, 3) and (photograph == 90).all()
    assert (pasted[10:30, 10:30] == 200).all() and int((pasted == 200).all(axis=2).sum()) == 400


def test_sums_are_pooled_over_frames_and_lpips_is_their_mean() -> None:
    truth = np.random.default_rng(0).integers(60, 180, (80, 90, 3), dtype=np.uint8)
    sums, part = PartSums(), box((80, 90), slice(20, 50), slice(20, 60))
    for error, distance in ((4, 0.1), (8, 0.3)):
        sums.add(Compared.of(Photograph.of(truth, part, part), truth + np.uint8(error)), part, distance)
    sums.add(Compared.of(Photograph.of(truth, part, part), truth), part)
    found = sums.figures()
    assert found["psnr"] == pytest.approx(10 * np.log10(255**2 / ((16 + 64) / 3)), abs=1e-3)
    assert found["lpips"] == 0.2 and found["frames"] == 3 and found["gradient"] == pytest.approx(1.0)
    assert sums.figures(lpips=0.5)["lpips"] == 0.5 and "lpips" not in PartSums(1.0, 1.0, 1, 1).figures()


def test_the_tint_is_that_of_the_ground_whatever_its_lightness() -> None:
    rng, part = np.random.default_rng(0), box((80, 90), slice(20, 50), slice(20, 60))
    truth = np.repeat(rng.integers(60, 180, (80, 90, 1), dtype=np.uint8), 3, axis=2)

    def tint(picture: np.ndarray, ground: np.ndarray | None = part, photograph: np.ndarray = truth) -> float | None:
        sums = PartSums()
        sums.add(Compared.of(Photograph.of(photograph, part, ground), picture), part)
        return sums.figures().get("tint")

    assert tint(truth + np.uint8(20)) == pytest.approx(0, abs=0.1)
    yellow = truth.copy()
    yellow[..., 2] -= 20
    assert 8 < tint(yellow) < 14
    assert tint(yellow, np.zeros_like(part)) is None
    # Where the photograph is clipped nothing tells its colour.
    clipped = truth.copy()
    clipped[:, :40] = 255
    assert tint(np.where(clipped == 255, np.uint8(0), truth), photograph=clipped) == 0
    assert tint(yellow, photograph=np.full_like(truth, 255)) is None

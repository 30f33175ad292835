"""The single-image baselines: what they must fill, what they must leave, and what must not break them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.pavement import box, tiles
from unveil_core.evaluate.baselines import navier_stokes, shift_map, telea, with_border
from unveil_core.evaluate.metrics import psnr
from unveil_core.inpaint.single_image import opencv

EVERY = pytest.mark.parametrize("fill", [telea, navier_stokes, shift_map])


def ramp(height: int = 48, width: int = 64) -> np.ndarray:
    y, x = np.mgrid[:height, :width]
    return np.stack([60 + x, 80 + y, 200 - x], axis=-1).astype(np.uint8)


@EVERY
def test_only_the_grown_mask_changes(fill) -> None:
    image = ramp()
    mask = box(image.shape, 15, 30, 20, 45)
    spoiled = image.copy()
    spoiled[mask] = (255, 0, 255)
    result = fill(spoiled, mask)
    outside = ~with_border(mask)
    np.testing.assert_array_equal(result[outside], spoiled[outside])
    assert result.dtype == np.uint8
    assert (np.abs(result[mask].astype(int) - (255, 0, 255)).max(axis=1) > 20).all()
    assert psnr(result, image, mask) > 15
    assert psnr(result, image, mask) > psnr(spoiled, image, mask) + 8


@EVERY
def test_smooth_ground_is_continued(fill) -> None:
    image = np.full((40, 50, 3), (120, 110, 90), dtype=np.uint8)
    mask = box(image.shape, 10, 25, 15, 35)
    spoiled = image.copy()
    spoiled[mask] = (200, 30, 30)
    assert np.abs(fill(spoiled, mask).astype(int) - image).max() <= 3


def test_shift_map_finds_the_period_where_telea_cannot() -> None:
    image = tiles()
    mask = box(image.shape, 30, 62, 40, 90)
    spoiled = image.copy()
    spoiled[mask] = (255, 0, 255)
    assert psnr(shift_map(spoiled, mask), image, mask) > psnr(telea(spoiled, mask), image, mask) + 6


def test_large_images_are_filled_around_each_hole(monkeypatch: pytest.MonkeyPatch) -> None:
    image = tiles()
    mask = box(image.shape, 10, 22, 10, 24) | box(image.shape, 60, 80, 90, 110)
    spoiled = image.copy()
    spoiled[mask] = (255, 0, 255)
    monkeypatch.setattr(opencv, "WHOLE_IMAGE_PX", 100)
    result = shift_map(spoiled, mask)
    outside = ~with_border(mask)
    np.testing.assert_array_equal(result[outside], image[outside])
    assert psnr(result, image, mask) > psnr(telea(spoiled, mask), image, mask) + 3


@EVERY
def test_the_same_again(fill) -> None:
    image = tiles()
    mask = box(image.shape, 30, 50, 40, 70)
    np.testing.assert_array_equal(fill(image, mask), fill(image, mask))


@EVERY
@pytest.mark.parametrize("name", ["none", "all", "one valid", "half", "border", "one pixel"])
def test_masks_of_every_kind(fill, name: str) -> None:
    image = np.random.default_rng(0).integers(1, 255, (40, 48, 3), dtype=np.uint8)
    masks = {
        "none": np.zeros((40, 48), dtype=bool),
        "all": np.ones((40, 48), dtype=bool),
        "one valid": ~box((40, 48), 20, 26, 20, 26),
        "half": box((40, 48), 0, 40, 0, 40),
        "border": ~box((40, 48), 3, 37, 3, 45),
        "one pixel": box((40, 48), 5, 6, 5, 6),
    }
    mask = masks[name]
    result = fill(image, mask)
    assert result.shape == image.shape
    assert result is not image
    outside = ~with_border(mask)
    np.testing.assert_array_equal(result[outside], image[outside])
    if name == "none" or name == "all":
        np.testing.assert_array_equal(result, image)


@EVERY
def test_wrong_shapes_are_refused(fill) -> None:
    with pytest.raises(ValueError, match="uint8"):
        fill(ramp().astype(np.float32), np.zeros((48, 64), dtype=bool))
    with pytest.raises(ValueError, match="does not fit"):
        fill(ramp(), np.zeros((3, 3), dtype=bool))

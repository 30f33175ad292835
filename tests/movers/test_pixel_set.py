"""Pixels kept as bits are those of the mask, wherever it lies in the image."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from unveil_core.base.types import Mask
from unveil_core.movers.pixel_set import PixelMasks, PixelSet


@given(arrays(bool, array_shapes(min_dims=2, max_dims=2, max_side=20)), st.integers(1, 2**16 - 1))
def test_what_is_written_is_the_mask(mask: Mask, value: int) -> None:
    mask[mask.shape[0] // 2, mask.shape[1] // 2] = True
    pixels = PixelSet.of(mask)
    image = np.zeros(mask.shape, np.uint16)
    pixels.write(image, value)
    assert np.array_equal(image, np.where(mask, value, 0)) and pixels.size == mask.sum()
    rows, columns = np.nonzero(mask)
    assert (pixels.left, pixels.upper) == (columns.min(), rows.min())
    assert (pixels.right, pixels.lower) == (columns.max() + 1, rows.max() + 1)
    again = PixelSet.of_bits(pixels.numbers, np.concatenate([pixels.bits, np.array([255], np.uint8)]))
    assert again.numbers == pixels.numbers and np.array_equal(again.bits, pixels.bits)


def test_other_pixels_in_the_box_keep_their_value() -> None:
    mask = np.eye(4, dtype=bool)
    image = np.full((4, 4), 7, np.uint16)
    PixelSet.of(mask).write(image, 9)
    assert np.array_equal(image, np.where(mask, 9, 7))


def test_masks_by_frame_are_those_that_were_put_in() -> None:
    generator = np.random.default_rng(0)
    shapes = [(6, 9), (8, 5), (4, 4)]
    masks = {v: generator.random(shapes[v]) < 0.4 for v in (2, 0)}
    kept = PixelMasks({v: PixelSet.of(mask) for v, mask in masks.items()}, shapes)
    assert list(kept) == [2, 0] and len(kept) == 2 and 1 not in kept
    assert all(np.array_equal(kept[v], mask) and kept[v].dtype == bool for v, mask in masks.items())

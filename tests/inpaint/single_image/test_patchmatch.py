"""Filling with patches: what has a period comes back, what is known stays, what has no surroundings is refused."""

from __future__ import annotations

import numpy as np
import pytest

from tests.pavement import box, tiles
from unveil_core.evaluate.metrics import psnr
from unveil_core.inpaint.single_image.patchmatch import patch_fill
from unveil_core.inpaint.single_image.registry import exemplar, telea


def test_a_pavement_keeps_its_lattice() -> None:
    image = tiles()
    mask = box(image.shape, 30, 62, 40, 90)
    spoiled = image.copy()
    spoiled[mask] = (255, 0, 255)
    filled = patch_fill(spoiled, mask)
    assert filled is not None
    assert np.array_equal(filled[~mask], image[~mask])
    assert psnr(filled, image, mask) > psnr(telea(spoiled, mask), image, mask) + 6


def test_noise_stays_as_rough_as_it_is_around() -> None:
    image = np.random.default_rng(0).integers(60, 160, (64, 80, 3)).astype(np.uint8)
    mask = box(image.shape, 25, 40, 30, 50)
    spoiled = np.where(mask[..., None], 0, image).astype(np.uint8)
    filled = exemplar(spoiled, mask)
    assert filled[mask].std() > 0.6 * image[~mask].std()
    assert abs(float(filled[mask].mean()) - float(image[~mask].mean())) < 8


def test_what_lies_in_the_hole_does_not_matter() -> None:
    image = tiles()
    mask = box(image.shape, 0, 20, 100, 128)
    results = [patch_fill(np.where(mask[..., None], v, image).astype(np.uint8), mask) for v in (0, 255)]
    assert results[0] is not None and np.array_equal(results[0], results[1])


def test_what_comes_from_another_height_costs() -> None:
    """Noise in two channels, and the row's number in the third, which says where a patch came from."""
    image = np.random.default_rng(3).integers(0, 256, (96, 128, 3)).astype(np.uint8)
    rows = np.broadcast_to(np.arange(96)[:, None], (96, 128))
    image[..., 2] = rows
    mask = box(image.shape, 20, 76, 40, 90)

    def astray(row_cost: float) -> float:
        filled = patch_fill(np.where(mask[..., None], 0, image).astype(np.uint8), mask, row_cost=row_cost)
        assert filled is not None
        return float(np.abs(filled[..., 2].astype(float) - rows)[mask].mean())

    assert astray(100.0) < 0.5 * astray(0.0)


@pytest.mark.parametrize("name", ["none", "all", "corner known", "one pixel", "border", "stripes"])
def test_masks_of_every_kind(name: str) -> None:
    image = np.random.default_rng(1).integers(1, 255, (40, 48, 3), dtype=np.uint8)
    masks = {
        "none": np.zeros((40, 48), bool),
        "all": np.ones((40, 48), bool),
        "corner known": ~box((40, 48), 0, 9, 0, 9),
        "one pixel": box((40, 48), 5, 6, 5, 6),
        "border": ~box((40, 48), 6, 34, 6, 42),
        "stripes": np.broadcast_to(np.arange(48) % 4 == 0, (40, 48)).copy(),
    }
    mask = masks[name]
    filled = patch_fill(image, mask)
    assert (filled is None) == (name in ("all", "stripes"))
    dark, light = (exemplar(np.where(mask[..., None], v, image).astype(np.uint8), mask) for v in (0, 255))
    # Nothing of what lies in the hole is used, but where OpenCV's fast marching runs out of surroundings.
    assert name in ("all", "stripes", "corner known") or np.array_equal(dark, light)
    assert dark.shape == image.shape and dark.dtype == np.uint8 and np.array_equal(dark[~mask], image[~mask])


@pytest.mark.parametrize("shape", [(8, 8), (7, 60), (5, 5), (200, 30)])
def test_images_of_any_size(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(2).integers(0, 255, (*shape, 3), dtype=np.uint8)
    mask = np.zeros(shape, bool)
    mask[-2:, -2:] = True
    dark, light = (exemplar(np.where(mask[..., None], v, image).astype(np.uint8), mask) for v in (0, 255))
    assert np.array_equal(dark, light) and dark.shape == image.shape

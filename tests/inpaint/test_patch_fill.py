"""Filling with patches: what has a period comes back, what is known stays, what has no surroundings is refused."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.inpaint.patch_fill import patch_fill
from unveil_core.inpaint.single_image import exemplar, telea


def tiles(height: int = 96, width: int = 128) -> np.ndarray:
    """A periodic pavement: the true filling is known."""
    y, x = np.mgrid[:height, :width]
    joint = (y % 16 < 2) | ((x + 8 * (y // 16 % 2)) % 16 < 2)
    return np.where(joint[..., None], (50, 45, 40), (190, 150, 120)).astype(np.uint8)


def psnr(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> float:
    return float(10 * np.log10(255**2 / max(((a.astype(float) - b)[where] ** 2).mean(), 1e-9)))


def hole(shape: tuple[int, ...], y0: int, y1: int, x0: int, x1: int) -> np.ndarray:
    mask = np.zeros(shape[:2], bool)
    mask[y0:y1, x0:x1] = True
    return mask


def test_a_pavement_keeps_its_lattice() -> None:
    image = tiles()
    mask = hole(image.shape, 30, 62, 40, 90)
    spoiled = image.copy()
    spoiled[mask] = (255, 0, 255)
    filled = patch_fill(spoiled, mask)
    assert filled is not None
    assert np.array_equal(filled[~mask], image[~mask])
    assert psnr(filled, image, mask) > psnr(telea(spoiled, mask), image, mask) + 6


def test_noise_stays_as_rough_as_it_is_around() -> None:
    image = np.random.default_rng(0).integers(60, 160, (64, 80, 3)).astype(np.uint8)
    mask = hole(image.shape, 25, 40, 30, 50)
    spoiled = np.where(mask[..., None], 0, image).astype(np.uint8)
    filled = exemplar(spoiled, mask)
    assert filled[mask].std() > 0.6 * image[~mask].std()
    assert abs(float(filled[mask].mean()) - float(image[~mask].mean())) < 8


def test_what_lies_in_the_hole_does_not_matter() -> None:
    image = tiles()
    mask = hole(image.shape, 0, 20, 100, 128)
    results = [patch_fill(np.where(mask[..., None], v, image).astype(np.uint8), mask) for v in (0, 255)]
    assert results[0] is not None and np.array_equal(results[0], results[1])


@pytest.mark.parametrize("name", ["none", "all", "corner known", "one pixel", "border", "stripes"])
def test_masks_of_every_kind(name: str) -> None:
    image = np.random.default_rng(1).integers(1, 255, (40, 48, 3), dtype=np.uint8)
    masks = {
        "none": np.zeros((40, 48), bool), "all": np.ones((40, 48), bool), "corner known": ~hole((40, 48), 0, 9, 0, 9),
        "one pixel": hole((40, 48), 5, 6, 5, 6), "border": ~hole((40, 48), 6, 34, 6, 42),
        "stripes": np.broadcast_to(np.arange(48) % 4 == 0, (40, 48)).copy(),
    }  # fmt: skip
    mask = masks[name]
    filled = patch_fill(image, mask)
    assert (filled is None) == (name in ("all", "stripes"))
    result = exemplar(image, mask)
    assert result.shape == image.shape and result.dtype == np.uint8
    assert np.array_equal(result[~mask], image[~mask])


@pytest.mark.parametrize("shape", [(8, 8), (7, 60), (5, 5), (200, 30)])
def test_images_of_any_size(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(2).integers(0, 255, (*shape, 3), dtype=np.uint8)
    mask = np.zeros(shape, bool)
    mask[-2:, -2:] = True
    assert np.array_equal(exemplar(image, mask)[~mask], image[~mask])

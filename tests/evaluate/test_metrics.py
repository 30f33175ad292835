"""PSNR, SSIM and IoU against hand-computed and independent values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from unveil_core.evaluate.metrics import gradient, mask_iou, psnr, squared_error, ssim, ssim_map


def picture(seed: int, height: int = 24, width: int = 32) -> np.ndarray:
    rng = np.random.default_rng(seed)
    smooth = gaussian_filter(rng.random((height, width, 3)), (2, 2, 0))
    return np.clip((smooth - smooth.min()) / np.ptp(smooth) * 255, 0, 255).astype(np.uint8)


def test_psnr_of_a_known_error() -> None:
    a = np.full((8, 8, 3), 100, dtype=np.uint8)
    b = a + 10
    assert psnr(a, b) == pytest.approx(20 * math.log10(255 / 10), abs=1e-9)
    assert psnr(a / 255.0, b) == pytest.approx(psnr(a, b), abs=1e-9)
    assert psnr(a, a) == math.inf


def test_psnr_counts_only_the_mask() -> None:
    a = np.zeros((8, 8, 3), dtype=np.uint8)
    b = a.copy()
    b[:4] = 255
    mask = np.zeros((8, 8), dtype=bool)
    mask[2:6] = True
    assert psnr(a, b, mask) == pytest.approx(-10 * math.log10(0.5))
    assert psnr(a, b, b[..., 0] == 0) == math.inf
    assert math.isnan(psnr(a, b, np.zeros((8, 8), dtype=bool)))


def wang_ssim(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """SSIM written out from the paper, with reflecting borders as scikit-image has them."""
    c1, c2 = 0.01**2, 0.03**2

    def blur(x: np.ndarray) -> np.ndarray:
        return gaussian_filter(x, (1.5, 1.5, 0), radius=(5, 5, 0), mode="reflect")

    x, y = a / 255.0, b / 255.0
    mx, my = blur(x), blur(y)
    vx, vy, vxy = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    whole = (2 * mx * my + c1) * (2 * vxy + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
    return whole.mean(axis=2)


def test_ssim_is_the_published_formula() -> None:
    a, b = picture(1), picture(2)
    np.testing.assert_allclose(ssim_map(a, b), wang_ssim(a, b), atol=1e-9)
    mask = np.zeros(a.shape[:2], dtype=bool)
    mask[5:15, 6:20] = True
    assert ssim(a, b, mask) == pytest.approx(wang_ssim(a, b)[mask].mean(), abs=1e-9)
    assert ssim(a, a) == pytest.approx(1.0)


def test_ssim_of_a_tiny_image_says_so() -> None:
    tiny = np.zeros((8, 20, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match="at least 11"):
        ssim(tiny, tiny)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**16), st.integers(0, 2**16))
def test_symmetry_and_pooling(seed_a: int, seed_b: int) -> None:
    a, b = picture(seed_a), picture(seed_b)
    assert psnr(a, b) == psnr(b, a)
    assert ssim(a, b) == pytest.approx(ssim(b, a))
    left = np.zeros(a.shape[:2], dtype=bool)
    left[:, :10] = True
    error = squared_error(a, b)
    pooled = (error[left].sum() + error[~left].sum()) / error.size
    assert psnr(a, b) == pytest.approx(-10 * math.log10(pooled) if pooled else math.inf)


def test_mask_iou() -> None:
    a = np.zeros((4, 4), dtype=bool)
    b = a.copy()
    a[:2], b[1:3] = True, True
    assert mask_iou(a, b) == pytest.approx(1 / 3)
    assert mask_iou(a, a) == 1.0
    assert math.isnan(mask_iou(a & False, b & False))


@pytest.mark.parametrize("bad", [np.zeros((4, 4)), np.zeros((4, 4, 4)), np.zeros((4, 4, 3), dtype=np.int32)])
def test_bad_images_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="image must be"):
        psnr(bad, bad)


def test_sizes_must_agree() -> None:
    with pytest.raises(ValueError, match="differ in size"):
        psnr(picture(0), picture(0, 20, 20))
    with pytest.raises(ValueError, match="does not fit"):
        psnr(picture(0), picture(1), np.ones((3, 3), dtype=bool))


def test_gradient_of_a_ramp_is_its_slope() -> None:
    ramp = np.tile(np.arange(0, 120, 4, dtype=np.uint8)[None, :, None], (20, 1, 3))
    assert np.allclose(gradient(ramp), 4.0)
    noisy = ramp + np.random.default_rng(0).integers(0, 9, ramp.shape, dtype=np.uint8)
    assert gradient(noisy).mean() > gradient(gaussian_filter(noisy, (1, 1, 0))).mean() > 3.5

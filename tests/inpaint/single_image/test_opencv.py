"""OpenCV's fillings: only the mask changes, and the same picture is filled the same way again, in another process too."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.pavement import box, tiles, worn_tiles
from unveil_core.evaluate.metrics import psnr
from unveil_core.inpaint.single_image.opencv import FSR_NOTHING, fsr, shift_map
from unveil_core.inpaint.single_image.registry import navier_stokes, telea

EVERY = pytest.mark.parametrize("fill", [telea, navier_stokes, shift_map, fsr])


@EVERY
def test_any_size_and_any_mask_and_the_same_again(fill) -> None:
    @settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
    @given(st.integers(1, 40), st.integers(1, 40), st.sampled_from((0.0, 0.1, 0.6, 1.0)), st.integers(0, 99))
    def check(height: int, width: int, share: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        image = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
        mask = rng.random((height, width)) < share
        result = fill(image, mask)
        assert result.shape == image.shape and result.dtype == np.uint8 and result is not image
        assert np.array_equal(result[~mask], image[~mask])
        rng.random(rng.integers(1, 5000))  # other memory
        assert np.array_equal(fill(image, mask), result)

    check()


@pytest.mark.parametrize("fill", [shift_map, fsr])
def test_a_hole_in_a_pavement_is_filled(fill) -> None:
    image, mask = tiles(), box(tiles().shape, 40, 52, 50, 66)
    spoiled = np.where(mask[..., None], (255, 0, 255), image).astype(np.uint8)
    other = np.where(mask[..., None], 0, image).astype(np.uint8)
    result = fill(spoiled, mask)
    assert np.array_equal(result, fill(other, mask)), "what lies in the hole matters"
    assert psnr(result, image, mask) > psnr(spoiled, image, mask) + 8


def test_fsr_keeps_channels_apart_and_leaves_nothing_open() -> None:
    image = np.zeros((40, 50, 3), np.uint8)
    image[...] = (200, 100, 20)
    mask = box(image.shape, 10, 25, 10, 25)
    assert np.abs(fsr(image, mask)[mask].astype(int) - (200, 100, 20)).max() <= 3
    tiny = image[:5, :5]
    result = fsr(tiny, box(tiny.shape, 1, 3, 1, 3))
    assert np.abs(result.astype(int) - tiny).max() <= 3 and (result != FSR_NOTHING).any(axis=2).all()


SCRIPT = """
import hashlib, sys
import numpy as np
from tests.pavement import worn_tiles
from unveil_core.inpaint.single_image.opencv import fsr, shift_map
image, mask = worn_tiles()
print(*(hashlib.sha256(fill(image, mask).tobytes()).hexdigest() for fill in (shift_map, fsr)))
"""


def test_another_process_fills_the_same_way() -> None:
    here = [hashlib.sha256(fill(*worn_tiles()).tobytes()).hexdigest() for fill in (shift_map, fsr)]
    root = Path(__file__).resolve().parents[3]
    told = subprocess.run([sys.executable, "-c", SCRIPT], cwd=root, capture_output=True, text=True, check=True)
    assert told.stdout.split() == here

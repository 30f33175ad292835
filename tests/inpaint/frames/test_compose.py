"""Seam, single-image inpainters, depth completion."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.inpaint.frames.compose import compose_frame
from unveil_core.inpaint.frames.depth import complete_depth
from unveil_core.inpaint.single_image.registry import BUILT_IN, inpainter


def picture() -> np.ndarray:
    y, x = np.mgrid[0:64, 0:96]
    return np.stack([(x * 2) % 256, (y * 3) % 256, (x + y) % 256], axis=-1).astype(np.uint8)


def test_untouched_pixels_stay_bit_for_bit() -> None:
    image = picture()
    mask = np.zeros((64, 96), bool)
    mask[20:40, 30:60] = True
    clean = np.full_like(image, 7)
    result = compose_frame(image, clean, mask)
    assert np.array_equal(result[~mask], image[~mask])
    assert (result[24:36, 34:56] == 7).all()
    ring = mask & ~np.pad(mask[21:39, 31:59], ((21, 25), (31, 37)))
    assert ((result[ring] != 7) & (result[ring] != image[ring])).any()  # a soft seam


def test_a_mask_on_the_border_of_the_image_works() -> None:
    image = picture()
    mask = np.zeros((64, 96), bool)
    mask[40:, :30] = True
    result = compose_frame(image, np.full_like(image, 9), mask)
    assert result[63, 0].tolist() == [9, 9, 9]


@pytest.mark.parametrize("name", sorted(BUILT_IN))
def test_inpainters_fill_and_leave_the_rest(name: str) -> None:
    image = picture()
    mask = np.zeros((64, 96), bool)
    mask[25:35, 40:55] = True
    damaged = image.copy()
    damaged[mask] = 255
    result = inpainter(name)(damaged, mask)
    assert np.array_equal(result[~mask], image[~mask])
    assert not np.array_equal(result[mask], damaged[mask])
    assert np.array_equal(result, inpainter(name)(damaged, mask))


def test_unknown_inpainter_is_one_clear_line() -> None:
    with pytest.raises(SettingsError, match="unknown inpainter 'lama'"):
        inpainter("lama")


def test_depth_completion_continues_a_plane() -> None:
    y, x = np.mgrid[0:40, 0:60]
    inverse = 0.05 + 0.002 * x + 0.001 * y
    depth = (1 / inverse).astype(np.float32)
    wanted = np.zeros((40, 60), bool)
    wanted[15:25, 25:35] = True
    known = ~wanted
    result = complete_depth(np.where(wanted, 0, depth), known, wanted, np.full((40, 60), np.inf))
    assert np.abs(result[wanted] / depth[wanted] - 1).max() < 0.05
    assert np.array_equal(result[known], depth[known].astype(np.float64))
    low = complete_depth(depth, known, wanted, np.full((40, 60), 3.0))
    assert (low[wanted] <= 3.0).all()

"""Seam, single-image inpainters, depth completion."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.pavement import box, tiles
from unveil_core.base.errors import SettingsError
from unveil_core.evaluate.metrics import psnr
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow
from unveil_core.inpaint.frames.compose import compose_frame, in_the_light_of, optimized_pixels, sky_below
from unveil_core.inpaint.frames.depth import NOTHING_KNOWN_M, complete_depth
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
def test_inpainters_continue_what_is_around(name: str) -> None:
    image = tiles()
    mask = box(image.shape, 25, 35, 40, 55)
    damaged, flat = image.copy(), image.copy()
    damaged[mask], flat[mask] = 255, image[grow(mask, 4) & ~mask].mean(axis=0)
    result = inpainter(name)(damaged, mask)
    assert np.array_equal(result[~mask], image[~mask])
    assert psnr(result, image, mask) > psnr(flat, image, mask)
    if name in ("exemplar", "shift-map"):
        assert psnr(result, image, mask) > 40, "what has a period comes back"
    # OpenCV's shift map draws at random: asked again it must not give another picture.
    assert np.array_equal(result, inpainter(name)(damaged, mask))


def test_unknown_inpainter_is_one_clear_line() -> None:
    with pytest.raises(SettingsError, match="Not an inpainter: lama"):
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


@pytest.mark.parametrize("seed", range(4))
def test_depth_is_completed_as_if_all_that_is_unknown_were(seed: int) -> None:
    """Pieces of sky and other unknown places, some that touch what is wanted, some near, most far off."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:160, 0:240]
    depth = (1 / (0.05 + 0.0002 * x + 0.0001 * y + 0.003 * np.sin(x / 9) * np.cos(y / 7))).astype(np.float32)
    known = y > 30 + 8 * np.sin(x / 20)
    for _ in range(25):
        row, column, h, w = (int(v) for v in rng.integers((0, 0, 2, 2), (150, 230, 14, 14)))
        known[row : row + h, column : column + w] = False
    wanted = np.zeros_like(known)
    wanted[100:118, 60:90] = wanted[60:75, 150:165] = wanted[20:45, 200:210] = True
    usable = known & ~wanted
    inverse = np.where(usable, 1 / depth, 0).astype(np.float32)
    scale = inverse[usable].max()
    whole = cv2.inpaint(inverse / scale, (~usable).astype(np.uint8), 5, cv2.INPAINT_NS) * scale
    expected = 1 / np.maximum(whole.astype(np.float64), inverse[usable].min())
    found = complete_depth(depth, known, wanted, np.full(depth.shape, np.inf))
    assert np.array_equal(found[wanted], expected[wanted])
    assert np.array_equal(found[~wanted], depth[~wanted].astype(np.float64))


def test_where_nothing_is_known_the_ground_or_the_end_of_the_street_is() -> None:
    nothing = np.zeros((4, 6), bool)
    ceiling = np.where(np.arange(6) < 3, 7.0, np.inf) * np.ones((4, 1))
    found = complete_depth(np.zeros((4, 6), np.float32), nothing, ~nothing, ceiling)
    assert (found[:, :3] == 7.0).all() and (found[:, 3:] == NOTHING_KNOWN_M).all()


def test_the_scene_is_shown_in_the_light_of_the_filled_frame() -> None:
    """What is fine comes from the scene, what is broad from the filled frame."""
    fine = np.tile(np.array([[100, 120], [120, 100]], np.uint8), (32, 48))[..., None].repeat(3, axis=2)
    filled = np.full((64, 96, 3), 150, np.uint8)
    removed = np.zeros((64, 96), bool)
    removed[16:48, 24:72] = True
    found = in_the_light_of(fine, filled, removed)[removed].astype(int)
    assert abs(found.mean() - 150) < 1 and found.std() > 8


def test_the_sky_is_not_shown_below_the_horizon() -> None:
    """A level camera, 1.5 m above the ground: rows from the middle on are below the horizon."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    camera = Camera(8, 6, 8.0, 8.0, 4.0, 3.0, pose)
    depth = np.full((6, 8), 5.0, np.float32)
    depth[:, 2:5] = 0
    bare = sky_below(camera, depth)
    assert bare[3:, 2:5].all() and bare.sum() == 9
    removed = np.ones((6, 8), bool)
    assert np.array_equal(optimized_pixels(removed, ~removed, bare), ~bare)

"""Objects that one frame's labels lack, where the scene has them."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.remove.missed import missed_pixels

ROAD, CAR = 110, 40


def all_of(asked: np.ndarray) -> np.ndarray:
    """Other frames have an object wherever they are asked."""
    return asked


def scene(scale: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture (H, W, 3) of two cars on a road, the scene's rendering of it, and the cars' share (H, W)."""
    rng = np.random.default_rng(0)
    share = np.zeros((256 * scale, 384 * scale), np.float32)
    share[100 * scale : 140 * scale, 50 * scale : 120 * scale] = 1
    share[100 * scale : 140 * scale, 200 * scale : 260 * scale] = 1
    clean = np.where(share[..., None] > 0, CAR, ROAD).repeat(3, axis=2).astype(np.float32)
    photograph = np.clip(clean + rng.normal(0, 5, clean.shape), 0, 255).astype(np.uint8)
    return photograph, clean / 255, share


@pytest.mark.parametrize("scale", [1, 3])
def test_a_missed_car_is_found_whole_and_the_other_stays_as_it_is(scale: int) -> None:
    photograph, rendered, share = scene(scale)
    own = share > 0.5
    own[:, 190 * scale :] = False
    missed = missed_pixels(photograph, rendered, share, own, all_of)
    lacking = (share > 0.5) & ~(missed | own)  # the disc that grows it leaves its corners
    assert lacking.sum() < 0.005 * missed.sum() and not (missed & (share < 0.5)).any()
    assert not (missed & own).any()


def test_what_has_moved_on_or_is_hidden_is_not_missed() -> None:
    photograph, rendered, share = scene()
    own = share > 0.5
    own[:, 190:] = False
    photograph[:, 190:] = ROAD
    assert not missed_pixels(photograph, rendered, share, own, all_of).any()


def test_labels_that_are_a_pixel_off_miss_nothing() -> None:
    photograph, rendered, share = scene()
    own = np.roll(share > 0.5, (1, 1), axis=(0, 1))
    assert not missed_pixels(photograph, rendered, share, own, all_of).any()
    assert not missed_pixels(photograph, rendered, np.zeros_like(share), np.zeros_like(own), all_of).any()


def test_what_other_frames_labels_lack_as_well_is_no_object() -> None:
    """Both cars are missed; most other frames have the left one, and of the right one only an end."""
    photograph, rendered, share = scene()
    own = np.zeros(share.shape, dtype=bool)

    def backed(asked: np.ndarray) -> np.ndarray:
        return asked & (np.arange(384) < 215)

    missed = missed_pixels(photograph, rendered, share, own, backed)
    assert missed[110:130, 60:110].all() and not missed[:, 190:].any()

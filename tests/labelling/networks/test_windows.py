"""Windows cover a picture, overlap, and blend without a seam."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.labelling.networks.windows import LEAST_OVERLAP, best_at_size, blended, starts


@pytest.mark.parametrize("window", [16, 33, 64])
def test_windows_cover_and_overlap(window: int) -> None:
    for length in range(1, 400, 7):
        found = starts(length, window)
        assert found[0] == 0 and found[-1] + window >= length
        assert len(found) == 1 or found[-1] + window == length
        assert all(0 < b - a <= window * (1 - LEAST_OVERLAP) + 1 for a, b in zip(found[:-1], found[1:], strict=True))


def test_what_windows_agree_on_is_kept() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (70, 130, 3)).astype(np.uint8)

    def planes(part: np.ndarray) -> np.ndarray:
        return part.transpose(2, 0, 1).astype(np.float32)

    assert np.allclose(blended(picture, (32, 40), planes), planes(picture), atol=1e-3)


def test_between_windows_that_differ_the_change_is_gradual() -> None:
    """Each window gives a constant of its own: from one to the next there is no step."""
    given = iter(range(100))

    def constant(part: np.ndarray) -> np.ndarray:
        return np.full((1, *part.shape[:2]), float(next(given)), np.float32)

    found = blended(np.zeros((32, 300, 3), np.uint8), (32, 64), constant)[0, 16]
    assert np.abs(np.diff(found)).max() < 0.25 and found[0] == 0 and found[-1] == len(starts(300, 64)) - 1


def test_the_largest_after_enlarging_one_by_one() -> None:
    import cv2

    scores = np.random.default_rng(0).normal(size=(5, 12, 20)).astype(np.float32)
    enlarged = np.stack([cv2.resize(p, (50, 33), interpolation=cv2.INTER_LINEAR) for p in scores])
    assert np.array_equal(best_at_size(scores, (33, 50)), enlarged.argmax(axis=0))
    assert np.array_equal(best_at_size(scores, (12, 20)), scores.argmax(axis=0))

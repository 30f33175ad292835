"""Label images at another size: labels stay where they are and as large as they are."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.base.parallel import threads
from unveil_core.geometry.label_images import resize_labels

SIZES = [((1920, 1280), (768, 512)), ((1536, 1024), (768, 512)), ((1152, 768), (384, 256)), ((720, 480), (384, 256))]
"""Factors 2.5, 2, 3 and 1.875."""


@pytest.mark.parametrize(("full", "size"), SIZES)
def test_edges_stay_where_they_are(full: tuple[int, int], size: tuple[int, int]) -> None:
    """Of a disc whose edge meets the pixels at every phase."""
    x, y = (a + 0.5 for a in np.meshgrid(np.arange(full[0]), np.arange(full[1])))
    disc = (x - 0.43 * full[0] - 0.3) ** 2 + (y - 0.52 * full[1] - 0.2) ** 2 < (0.3 * full[1]) ** 2
    found = resize_labels(np.where(disc, 13, 0).astype(np.uint8), size) == 13
    factor = full[0] / size[0]
    small_x, small_y = (a + 0.5 for a in np.meshgrid(np.arange(size[0]), np.arange(size[1])))
    for fine, coarse in ((x, small_x), (y, small_y)):
        assert abs(coarse[found].mean() - fine[disc].mean() / factor) < 0.05
        # And neither smaller nor larger: half a pixel of its border would be 0.6 % and more.
        assert abs(np.ptp(coarse[found]) + 1 - (np.ptp(fine[disc]) + 1) / factor) < 1
    assert abs(found.sum() * factor**2 / disc.sum() - 1) < 0.002


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.int16, np.int64])
def test_the_label_that_covers_most_is_taken(dtype: type) -> None:
    labels = np.array([[7, 7, 0, 3], [7, 2, 0, 3], [1, 1, 1, 100], [1, 1, 100, 100]], dtype)
    found = resize_labels(labels, (2, 2))
    assert found.dtype == dtype and found[0, 0] == 7 and found[0, 1] in (0, 3) and found[1].tolist() == [1, 100]
    assert resize_labels(labels, (1, 1)).item() == 1
    assert resize_labels(labels, (4, 4)) is labels


def test_a_tie_moves_no_edge() -> None:
    labels = np.zeros((40, 40), np.uint8)
    labels[:, 19:] = 5  # through the middle of a column of the result
    found = resize_labels(labels, (20, 20))
    assert (found[:, :9] == 0).all() and (found[:, 10:] == 5).all() and (found[:, 9] == 5).mean() == 0.5


def test_the_same_for_any_number_of_threads() -> None:
    labels = np.random.default_rng(0).integers(0, 4, (301, 203)).astype(np.uint16)
    with threads(1):
        alone = resize_labels(labels, (90, 70))
    with threads(3):
        assert np.array_equal(resize_labels(labels, (90, 70)), alone)


def test_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match="labels must be integers"):
        resize_labels(np.zeros((4, 4), np.float32), (2, 2))  # type: ignore[arg-type]

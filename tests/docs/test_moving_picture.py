"""The moving picture of the README."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from PIL import Image

from docs.generate import ROOT
from docs.moving_picture import GAP_PX, MOST_BYTES, animation, side_by_side

PICTURE = ROOT / "docs" / "pictures" / "street.webp"


def noise(count: int, height: int = 64, width: int = 96) -> list[Image.Image]:
    values = np.random.default_rng(0).integers(0, 255, (count, height, width, 3), dtype=np.uint8)
    return [Image.fromarray(picture) for picture in values]


def test_photograph_and_clean_frame_lie_side_by_side() -> None:
    photo, clean = np.zeros((4, 6, 3), np.uint8), np.full((4, 6, 3), 90, np.uint8)
    both = np.asarray(side_by_side(photo, clean))
    assert both.shape == (4, 12 + GAP_PX, 3)
    assert np.array_equal(both[:, :6], photo) and np.array_equal(both[:, -6:], clean) and (both[:, 6:-6] == 255).all()


def test_quality_gives_way_to_size() -> None:
    pictures = noise(4)
    best = animation(pictures)
    smaller = animation(pictures, len(best) - 1)
    assert len(smaller) < len(best)
    assert Image.open(io.BytesIO(smaller)).n_frames == 4


def test_what_cannot_be_small_is_told() -> None:
    with pytest.raises(SystemExit, match="More than 100 bytes even at quality"):
        animation(noise(2), 100)


def test_the_picture_of_the_readme_moves_and_is_small() -> None:
    assert PICTURE.stat().st_size <= MOST_BYTES
    with Image.open(PICTURE) as picture:
        assert picture.n_frames > 20 and picture.info["loop"] == 0
    assert re.search(r"!\[[^\]]+\]\(docs/pictures/street\.webp\)", (ROOT / "README.md").read_text(encoding="utf-8"))

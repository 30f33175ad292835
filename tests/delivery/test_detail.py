"""Detail of delivered frames: what a source shows finer comes in, its light does not, and what is something else stays out."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.delivery.detail import BestSource, Detail, grain_of, sensor_noise

SHAPE = (60, 90)


def soft(seed: int, sigma: float = 6.0) -> np.ndarray:
    """(60, 90, 3) in [0, 1], patches as wide as ``sigma``."""
    noise = np.random.default_rng(seed).normal(size=(*SHAPE, 3)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), sigma)
    return (0.5 + 0.1 * blurred / blurred.std()).astype(np.float32)


def everywhere(value: float) -> np.ndarray:
    return np.full(SHAPE, value, np.float32)


def test_a_source_in_another_light_is_brought_to_the_colours_of_the_clean_frame() -> None:
    clean = soft(0)
    best = BestSource(clean)
    best.add(0, clean - np.float32(0.04), everywhere(1.0))
    found = best.found
    assert (found.source == 0).all() and (found.believed == 1).all()
    assert np.abs(found.difference - 0.04).max() < 1e-4


def test_what_shows_something_else_is_not_believed() -> None:
    clean = soft(0)
    best = BestSource(clean)
    best.add(0, clean + np.float32(0.3), everywhere(1.0))
    assert (best.found.source == -1).all() and not best.found.believed.any()


def test_the_finer_source_wins_where_it_shows_the_place() -> None:
    clean, half = soft(0), everywhere(1.6)
    half[:, :45] = 0
    best = BestSource(clean)
    best.add(0, clean, everywhere(1.0))
    best.add(1, np.where(half[..., None] > 0, clean, 0), half)
    assert (best.found.source[:, 60:] == 1).all() and (best.found.source[:, :40] == 0).all()
    # The order in which they come does not matter.
    other = BestSource(clean)
    other.add(1, np.where(half[..., None] > 0, clean, 0), half)
    other.add(0, clean, everywhere(1.0))
    assert np.array_equal(best.found.source, other.found.source)


def test_between_pixels_only_those_of_one_source_are_mixed() -> None:
    source = np.zeros((4, 6), np.int32)
    source[:, 3:], source[0] = 1, -1
    difference = (
        np.repeat(source[..., None], 3, axis=2).astype(np.float32) * 10 + np.arange(6, dtype=np.float32)[:, None]
    )
    detail = Detail(source, difference, np.where(source >= 0, 1.0, 0.0).astype(np.float32))
    at = np.array([[1.5, 2.5], [2.0, 2.5], [2.9, 2.5], [3.1, 2.5], [4.25, 3.0], [2.0, 0.6], [-5.0, 2.5], [9.0, 9.0]])
    own, between, believed = detail.at(at)
    assert own.tolist() == [0, 0, 0, 1, 1, -1, 0, 1]
    assert np.abs(between[:, 0] - [1.0, 1.5, 2.0, 13.0, 13.75, 0.0, 0.0, 15.0]).max() < 1e-5
    assert believed.tolist() == [1, 1, 1, 1, 1, 0, 1, 1]


@pytest.mark.parametrize(
    ("kind", "channels"), [(np.float32, 3), *((kind, c) for kind in (np.uint8, np.uint16) for c in (0, 3, 4))]
)
def test_grain_is_that_of_the_light_whatever_holds_it(kind: type, channels: int) -> None:
    generator = np.random.default_rng(0)
    texture = 0.02 * generator.normal(size=(200, 300))
    picture = np.linspace(0.2, 0.8, 300)[None] + texture  # slow light, fine grain
    picture[:, 150:] += 0.15  # and an edge, which is no grain
    most = 1.0 if kind is np.float32 else np.iinfo(kind).max
    stored = (picture * most).round().astype(kind) if most != 1.0 else picture.astype(np.float32)
    if channels:
        stored = np.repeat(stored[..., None], channels, axis=2)
    grain = grain_of(stored, 6.0)
    inner = np.s_[20:-20, 20:120]
    assert np.corrcoef(grain[inner].ravel(), texture[inner].ravel())[0, 1] > 0.95
    assert 0.8 < grain[inner].std() / 0.02 < 1.1
    assert abs(grain[:, 148:152].mean()) < 0.01 and np.abs(grain).max() < 0.1


def test_noise_is_as_strong_as_where_the_photograph_shows_nothing() -> None:
    generator = np.random.default_rng(0)
    known = np.ones((160, 240), bool)
    known[:, 200:] = False
    noise = cv2.GaussianBlur(generator.normal(size=known.shape).astype(np.float32), (0, 0), 0.8)
    plain = 0.5 + 0.01 * noise / noise.std()
    plain[:, 200:] = generator.random((160, 40))  # what is removed tells nothing of the noise
    picture = np.repeat((plain * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    found = sensor_noise(picture, known, 2.5, seed=3)
    assert 0.6 < found.std() / 0.01 < 1.3 and abs(found.mean()) < 1e-3
    assert np.array_equal(found, sensor_noise(picture, known, 2.5, seed=3))
    flat = np.full((160, 240, 3), 90, np.uint8)
    assert np.abs(sensor_noise(flat, known, 2.5, seed=3)).max() < 1e-6

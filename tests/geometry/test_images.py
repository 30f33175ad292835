"""Borders of things, at every size of image."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import area_px, border_px, grow, within
from unveil_core.inpaint.frames.holes import BackgroundLayers, FrameTask, hole_in_frame

WIDTHS = (384, 512, 768, 1000, 1200, 1400, 1600, 1920, 2560, 3840)


def test_borders_grow_with_the_image() -> None:
    for least in (1, 2, 3, 4):
        assert border_px(384, least) == border_px(120, least) == least
        assert border_px(3840, least) == pytest.approx(least * 3840 / 800, abs=0.5)
        assert all(border_px(a, least) <= border_px(b, least) for a, b in zip(WIDTHS, WIDTHS[1:], strict=False))


def test_areas_grow_with_the_image() -> None:
    assert area_px((256, 384), 40) == area_px((80, 128), 40) == 40
    assert area_px((1280, 1920, 3), 40) == 1000


@pytest.mark.parametrize("radius", [3, 14, 70])
def test_masks_grow_by_a_disc(radius: int) -> None:
    mask = np.zeros((201, 201), bool)
    assert not grow(mask, radius).any() and not within(mask, radius).any()
    mask[100, 100] = True
    away = np.hypot(*(np.indices(mask.shape) - 100))
    assert np.array_equal(within(mask, radius), away <= radius)
    grown = grow(mask, radius)
    assert grown[away <= radius - 1].all() and not grown[away > radius + 1].any()


@pytest.mark.parametrize("width", WIDTHS)
def test_a_hole_contains_the_border_of_its_mask(width: int) -> None:
    """Above the horizon, where only what nobody saw is a hole: else a rim around the object would show the sky."""
    camera = Camera(width, 200, 300.0, 300.0, width / 2, 100.0, np.eye(4))
    hidden = np.zeros((200, width), bool)
    hidden[60:140, width // 3 : width // 2] = True
    removed, nothing = grow(hidden, border_px(width)), np.zeros_like(hidden)
    task = FrameTask(camera, np.zeros((200, width, 3), np.uint8), removed, hidden)
    hole = hole_in_frame(task, BackgroundLayers({}, nothing, None, nothing, nothing, nothing))
    assert np.array_equal(hole, removed) and (removed & ~hidden).any()

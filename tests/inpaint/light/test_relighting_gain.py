"""The gain that takes shadows away is the same however many rows are relit at a time."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.base import srgb
from unveil_core.geometry.images import grow
from unveil_core.inpaint.light import relight

PER_M = 20.0


@pytest.mark.parametrize("seed", range(3))
def test_strips_leave_no_seam(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(seed)
    rows, columns = 700, 80
    shadow = np.zeros((rows, columns), bool)
    for row, column, size in generator.integers((0, 0, 10), (300, columns, 60), (6, 3)):
        shadow[row : row + 2 * size, column : column + size] = True
    wide = grow(shadow, 0.12 * PER_M)
    target = generator.uniform(0.2, 0.6, (rows, columns, 3)).astype(np.float32)
    color = srgb.relight(target, np.where(shadow[..., None], 0.25, 1.0))
    seen = generator.uniform(size=shadow.shape) < 0.9
    relit = shadow & seen & (generator.uniform(size=shadow.shape) < 0.95)

    def gain() -> np.ndarray:
        return relight.relighting_gain(color, target, seen, shadow, wide, relit, per_m=PER_M)

    monkeypatch.setattr(relight, "STRIP_M", rows / PER_M)
    whole = gain()
    assert whole[shadow].mean() > 1.5 and (whole[-100:] == 1.0).all()
    monkeypatch.setattr(relight, "STRIP_M", 2.35)
    np.testing.assert_allclose(gain(), whole, rtol=0, atol=1e-6)


def test_deep_blue_shade_keeps_its_hue() -> None:
    """Beside a lorry, which hides half of the sky, a twelfth of the light is left, and of the red a thirtieth."""
    target = np.full((200, 80, 3), 0.5, np.float32)
    shadow = np.zeros((200, 80), bool)
    shadow[60:140, 20:60] = True
    color = srgb.relight(target, np.where(shadow[..., None], [0.03, 0.09, 0.17], 1))
    none = np.zeros_like(shadow)
    gain = relight.relighting_gain(color, target, ~none, shadow, grow(shadow, 2), shadow, per_m=PER_M)
    inside = srgb.relight(color, gain)[80:120, 30:50]
    np.testing.assert_allclose(inside, 0.5, atol=0.02)

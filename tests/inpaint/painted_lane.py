"""A road of two lanes between sidewalks, and what may be painted across it; in metres from the chart's first texel."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.fill.stop_lines import continue_stop_lines

PER_M = 25
ROWS, COLUMNS = 40 * PER_M, 14 * PER_M
KERBS, MIDDLE = (3.0, 11.0), 7.0
"""Of the road. The lane with the line lies between the first kerb and the line in the middle."""
LEVEL = 0.3
"""Of paint, against asphalt."""


def metres() -> tuple[np.ndarray, np.ndarray]:
    """(A, 1) along the street and (1, B) across it."""
    return (np.arange(ROWS)[:, None] + 0.5) / PER_M, (np.arange(COLUMNS)[None] + 0.5) / PER_M


def rectangle(along: tuple[float, float], across: tuple[float, float]) -> Mask:
    s, t = metres()
    return (s > along[0]) & (s < along[1]) & (t > across[0]) & (t < across[1])


def stop_line(
    thick: float = 0.4, *, slope: float = 0.0, at: float = 20.0, across: tuple[float, float] = (3.1, 6.9)
) -> Mask:
    s, t = metres()
    return (np.abs(s - at - slope * (t - sum(across) / 2)) < thick / 2) & (t > across[0]) & (t < across[1])


def painted(paint: Mask, grain: float = 0.03, seed: int = 0, blur: float = 0.0) -> Float32:
    """Detail (A, B, 3) of a street with that paint; ``blur`` in texels."""
    level = LEVEL * paint.astype(np.float32)
    level = cv2.GaussianBlur(level, (0, 0), blur) if blur else level
    noise = np.random.default_rng(seed).normal(0, grain, (ROWS, COLUMNS, 1))
    return np.repeat(level[..., None] + noise, 3, axis=2).astype(np.float32)


def road() -> Mask:
    return rectangle((0, 40), KERBS)


def middle_line() -> Mask:
    return rectangle((0, 40), (MIDDLE - 0.06, MIDDLE + 0.06))


def continued(
    detail: Float32, hidden: Mask, *, on: Mask | None = None, line: Mask | None = None
) -> tuple[Float32, Mask]:
    """Detail and place of what is continued into what is hidden, on a road of two lanes if nothing else is given."""
    on, line = road() if on is None else on, middle_line() if line is None else line
    seen = np.where(hidden[..., None], 0, detail).astype(np.float32)
    made, share = continue_stop_lines(seen, ~hidden, hidden, on, line, texels_per_m=PER_M)
    assert not share[~hidden].any() and share.min() >= 0 and share.max() <= 1
    assert not made[share == 0].any() and np.isfinite(made).all()
    return made, share > 0.5

"""Detail of other frames in the colours of the frame that takes it."""

from __future__ import annotations

import numpy as np

from unveil_core.delivery.full_size import in_exposure
from unveil_core.drives.exposure import IDENTITY, Exposure


def test_what_a_darker_camera_shows_is_brought_to_the_colours_of_the_frame() -> None:
    street = np.random.default_rng(0).random((20, 3)).astype(np.float32)
    dark, bright = Exposure(np.full(3, 0.6), np.full(3, 0.02)), Exposure(np.array([1.2, 1.0, 0.9]), np.zeros(3))
    as_dark, as_bright = ((street * e.gain + e.bias).astype(np.float32) for e in (dark, bright))
    assert np.abs(in_exposure(as_dark, dark, bright) - as_bright).max() < 1e-6
    assert in_exposure(street, IDENTITY, IDENTITY) is street

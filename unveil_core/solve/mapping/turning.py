"""How far cameras turn: a camera that moves straight ahead and does not turn tells nothing of its lens."""

from __future__ import annotations

import numpy as np

from unveil_core.solve.mapping.model import Model

__all__ = ["LEAST_TURN_DEG", "told_of_focal", "turned_deg"]

LEAST_TURN_DEG = 1.0
"""Below it the focal length is off by per cents: 4 % where a camera turned by 0.25 degrees, under 1 % where by 5."""


def turned_deg(model: Model, pictures: list[int]) -> float:
    """Root mean square angle between the views of some pictures and their mean, degrees."""
    ahead = model.poses[pictures, 2, :3]
    mean = ahead.mean(axis=0)
    angles = np.arccos(np.clip(ahead @ mean / np.linalg.norm(mean), -1, 1))
    return float(np.degrees(np.sqrt((angles**2).mean())))


def told_of_focal(model: Model, pictures: list[int], focal_px: float) -> str | None:
    """What a user should know of a focal length that nothing but some pictures tells; None where they tell it well.

    Where the camera only moves ahead, a longer lens and a deeper street give the same pictures.
    """
    turned = turned_deg(model, pictures)
    if turned >= LEAST_TURN_DEG:
        return None
    return (
        f"the camera turns by {turned:.1f} degrees alone, so the focal length of {focal_px:.0f} pixels may be off by 5 %, "
        "and the scale by twice that; give --focal where you know it"
    )

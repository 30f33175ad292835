"""What a person says of an object: pixels of some frames that are its own, pixels that are not, and rough masks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from unveil_core.base.types import Float64, Mask

__all__ = ["Prompt", "Prompts"]


def _none() -> Float64:
    return np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Prompt:
    """What is said of one object in one frame.

    Attributes:
        inside: (N, 2) positions in the working picture that show the object, pixels from its outer corner.
        outside: (M, 2) positions that do not.
        stroke: (H, W) pixels of a rough stroke over the object, all its own; None where none was drawn.
        matte: (H, W) pixels of the object, all of them; None where nobody drew it whole.
    """

    inside: Float64 = field(default_factory=_none)
    outside: Float64 = field(default_factory=_none)
    stroke: Mask | None = None
    matte: Mask | None = None

    def own(self, shape: tuple[int, int], radius: float = 0.0) -> Mask:
        """(H, W) pixels that are surely the object's: those of the clicks and of the stroke.

        Args:
            radius: of a click, pixels.
        """
        found = _around(self.inside, shape, radius)
        for drawn in (self.stroke, self.matte):
            if drawn is not None:
                found |= drawn
        return found

    def others(self, shape: tuple[int, int], radius: float = 0.0) -> Mask:
        """(H, W) pixels that are surely not the object's."""
        found = _around(self.outside, shape, radius)
        return found if self.matte is None else found | ~self.matte


def _around(places: Float64, shape: tuple[int, int], radius: float) -> Mask:
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    found = np.zeros(shape, dtype=bool)
    for x, y in places:
        found |= (columns - x) ** 2 + (rows - y) ** 2 <= max(radius, 0.75) ** 2
    return found


@dataclass(frozen=True, eq=False)
class Prompts:
    """One object.

    Attributes:
        name: what the person calls it.
        frames: what is said of it, by the index of the frame in the drive.
    """

    name: str
    frames: dict[int, Prompt]

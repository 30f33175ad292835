"""From the numbers of plates to pictures as the scene wants them, encoded as sRGB from 0 to 1, and back.

Light is brought to the primaries of Rec. 709, exposed, and encoded. Where plates are brighter than white, the upper part of the
encoding is bent so that their brightest comes out at 1: sunlit walls and the sky keep their steps, and what is put in the place
of a removed object may be as bright. All of it can be undone, so colours that are filled in go back into the plates' own numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.plates.ocio import applied
from unveil_core.base.plates.transfers import TRANSFERS
from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.base.types import Float32, Float64

__all__ = ["KNEE", "PlateColours"]

KNEE = 0.8
"""Encoded level from which brighter plates are bent: below lies all that a street reflects in the sun, at a normal exposure."""
Matrix = tuple[float, ...]


@dataclass(frozen=True)
class PlateColours:
    """What the numbers of plates mean.

    Attributes:
        transfer: encoding of their light, one of ``transfers.TRANSFERS``; "ocio" where a configuration tells.
        to_rec709: nine numbers by rows, from their primaries to Rec. 709; none = they have these.
        exposure: factor of light before it is encoded.
        ceiling: the encoded level, as sRGB goes on beyond 1, that comes out at 1; 1 = nothing is bent.
        configuration, space: of OpenColorIO, where ``transfer`` is "ocio".
    """

    transfer: str = "linear"
    to_rec709: Matrix = ()
    exposure: float = 1.0
    ceiling: float = 1.0
    configuration: str = ""
    space: str = ""

    def light(self, values: NDArray[np.floating]) -> Float64:
        """(..., 3) linear light with the primaries of Rec. 709, of a plate's numbers, exposed."""
        if self.transfer == "ocio":
            return applied(values, self.configuration, self.space).astype(np.float64) * self.exposure
        light = TRANSFERS[self.transfer][0](np.asarray(values, dtype=np.float64))
        matrix = self._matrix() if self.to_rec709 else np.eye(3)
        return np.asarray(light @ matrix.T * self.exposure, dtype=np.float64)

    def of_light(self, light: Float64) -> Float64:
        """The inverse of :meth:`light`."""
        light = light / self.exposure
        if self.transfer == "ocio":
            return applied(light, self.configuration, self.space, back=True).astype(np.float64)
        own = light if not self.to_rec709 else np.asarray(light @ np.linalg.inv(self._matrix()).T, dtype=np.float64)
        return TRANSFERS[self.transfer][1](own)

    def encoded(self, values: NDArray[np.floating]) -> Float32:
        """(..., 3) float32 a plate's numbers as the scene sees them, mostly within 0 and 1."""
        return self._bent(srgb_of_linear(self.light(values))).astype(np.float32)

    def decoded(self, encoded: NDArray[np.floating]) -> Float64:
        """The inverse of :meth:`encoded`."""
        return self.of_light(self.linear(encoded))

    def linear(self, encoded: NDArray[np.floating]) -> Float64:
        """(..., 3) light of what the scene sees."""
        return linear_of_srgb(self._straight(np.asarray(encoded, dtype=np.float64)))

    def of_linear(self, light: Float64) -> Float64:
        """The inverse of :meth:`linear`."""
        return self._bent(srgb_of_linear(light))

    def _matrix(self) -> Float64:
        return np.array(self.to_rec709, dtype=np.float64).reshape(3, 3)

    def _bent(self, level: Float64) -> Float64:
        if self.ceiling <= 1:
            return level
        rate = _rate((self.ceiling - KNEE) / (1 - KNEE))
        above = np.maximum(level - KNEE, 0) / (1 - KNEE)
        return np.where(level > KNEE, KNEE + (1 - KNEE) * np.log1p(rate * above) / rate, level)

    def _straight(self, level: Float64) -> Float64:
        if self.ceiling <= 1:
            return level
        rate = _rate((self.ceiling - KNEE) / (1 - KNEE))
        above = np.maximum(level - KNEE, 0) / (1 - KNEE)
        return np.where(level > KNEE, KNEE + (1 - KNEE) * np.expm1(rate * above) / rate, level)

    def to_json(self) -> dict[str, Any]:
        """What cameras.json keeps of it."""
        return {**vars(self), "to_rec709": list(self.to_rec709)}

    @staticmethod
    def from_json(found: dict[str, Any]) -> PlateColours:
        """The inverse of :meth:`to_json`.

        Raises:
            ValueError, KeyError, TypeError: it is none.
        """
        matrix = tuple(float(v) for v in found["to_rec709"])
        numbers = float(found["exposure"]), float(found["ceiling"])
        texts = str(found["configuration"]), str(found["space"])
        transfer = str(found["transfer"])
        if transfer not in (*TRANSFERS, "ocio") or len(matrix) not in (0, 9):
            raise ValueError("colours of plates that are none")
        if not np.isfinite((*matrix, *numbers)).all() or min(numbers) <= 0:
            raise ValueError("colours of plates that are not finite")
        if matrix and abs(np.linalg.det(np.reshape(matrix, (3, 3)))) < 1e-9:
            raise ValueError("primaries of plates that are none")
        return PlateColours(transfer, matrix, *numbers, *texts)


def _rate(top: float) -> float:
    """c for which log(1 + c top) = c: so a curve that begins without a bend ends at 1, for ``top`` above 1."""
    found = max(np.log(top), 1e-6) + 1.0
    for _ in range(60):  # a fixed point that draws near: the slope there is below 1
        found = float(np.log1p(found * top))
    return max(found, 1e-9)

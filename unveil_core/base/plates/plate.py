"""One plate: the pixels of its picture as the file has them, and the same with other colours in some places."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.files import write_bytes_atomic
from unveil_core.base.types import Float32, Mask

__all__ = ["COPY", "Plate", "PlateFacts", "checked_facts"]

MOST_PIXELS = 1 << 28
"""Of a plate."""
COPY = "copy it again from its source, or drop the frame"
GREY = np.array([0.2126, 0.7152, 0.0722])
"""Light of a colour, by the primaries of Rec. 709."""
Store = Callable[[Path, NDArray[Any], NDArray[Any] | None], None]
"""Writes a file with these pixels and this transparency."""


@dataclass(frozen=True)
class PlateFacts:
    """What the header of a plate tells.

    Attributes:
        kind: "openexr" or "dpx".
        size: of the picture (an EXR's display window), pixels; corner: column and row of it at which the data begins.
        data_size: of the data, pixels.
        pixel_aspect: width of a pixel over its height.
        attributes: by name.
        bits: of a whole number.
    """

    kind: str
    size: tuple[int, int]
    corner: tuple[int, int]
    data_size: tuple[int, int]
    pixel_aspect: float
    attributes: dict[str, Any] = field(compare=False)
    bits: int = 16


def checked_facts(facts: PlateFacts, path: Path) -> PlateFacts:
    """The facts, of a plate that can be held.

    Raises:
        DriveError: it claims too many pixels, or none.
    """
    for width, height in (facts.size, facts.data_size):
        if min(width, height) < 1 or width * height > MOST_PIXELS:
            raise DriveError(f"claims {width}x{height} pixels", path=path, mend=f"plates have {MOST_PIXELS:,} at most")
    sound = np.isfinite(facts.pixel_aspect) and 0.1 < facts.pixel_aspect < 10
    return facts if sound else replace(facts, pixel_aspect=1.0)


@dataclass(frozen=True, eq=False)
class Plate:
    """Attributes:
    path: of the file; facts: of its header.
    data: (h, w, 3) or (h, w, 1) float16, float32, or the file's whole numbers; alpha: (h, w) likewise, None without.
    store: writes a file like this one with other pixels.
    """

    path: Path
    facts: PlateFacts
    data: NDArray[Any]
    alpha: NDArray[Any] | None
    store: Store

    @property
    def values(self) -> Float32:
        """(H, W, 3) float32 the picture in the file's own encoding, whole numbers from 0 to 1; 0 where it has no data."""
        width, height = self.facts.size
        found = np.zeros((height, width, 3), np.float32)
        inside, own = self._windows()
        some = self.data[own]
        if some.dtype.kind == "u":
            shift = 8 * some.dtype.itemsize - self.facts.bits
            found[inside] = (some >> shift).astype(np.float32) / np.float32((1 << self.facts.bits) - 1)
        else:
            found[inside] = some
        return found

    def replaced(self, mask: Mask, values: NDArray[np.floating]) -> Plate:
        """The plate with other colours where a mask (H, W) is; they are opaque there.

        Args:
            values: (N, 3) of the masked pixels, in the file's encoding as :attr:`values` has it.
        """
        inside, own = self._windows()
        full = np.zeros((*mask.shape, 3), np.float64)
        full[mask] = values
        some = mask[inside]
        new = full[inside][some]
        data, alpha = self.data.copy(), self.alpha
        data[own][some] = self._native(new if data.shape[2] == 3 else (new @ GREY)[:, None])
        if alpha is not None:
            alpha = alpha.copy()
            alpha[own][some] = np.iinfo(alpha.dtype).max if alpha.dtype.kind == "u" else 1.0
        return replace(self, data=data, alpha=alpha)

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all, of the plate's own kind and pixel type.

        Raises:
            DriveError: it cannot be written.
        """
        with tempfile.TemporaryDirectory(prefix="unveil-plate-") as folder:
            scratch = Path(folder) / f"plate{self.path.suffix.lower()}"
            self.store(scratch, self.data, self.alpha)
            write_bytes_atomic(path, scratch.read_bytes(), like=self.path)

    def _windows(self) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
        """Rows and columns of the picture that the data covers, and those of the data."""
        (x, y), (width, height), (data_width, data_height) = self.facts.corner, self.facts.size, self.facts.data_size
        left, top = max(x, 0), max(y, 0)
        right, bottom = max(min(x + data_width, width), left), max(min(y + data_height, height), top)
        return (slice(top, bottom), slice(left, right)), (slice(top - y, bottom - y), slice(left - x, right - x))

    def _native(self, values: NDArray[np.floating]) -> NDArray[Any]:
        """(N, C) as the data has them."""
        kind = self.data.dtype
        if kind.kind != "u":
            largest = float(np.finfo(kind).max)
            return np.clip(values, -largest, largest).astype(kind)
        bits, whole = self.facts.bits, 8 * kind.itemsize
        code = np.clip(np.round(values * ((1 << bits) - 1)), 0, (1 << bits) - 1).astype(np.uint32)
        wide, filled = code << (whole - bits), bits
        while filled < whole:  # the bits below repeat those above, as they are read
            wide |= wide >> filled
            filled *= 2
        return wide.astype(kind)

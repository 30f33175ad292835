"""Some pixels of an image, one bit for each pixel of the box around them: those of all frames of a long drive are held."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask

__all__ = ["PixelMasks", "PixelSet"]


@dataclass(frozen=True, eq=False)
class PixelSet:
    """Pixels of an image.

    Attributes:
        left, upper, right, lower: of the box around them; the last two are the first column and row outside.
        size: how many there are.
        bits: one for each pixel of the box, row by row, packed.
    """

    left: int
    upper: int
    right: int
    lower: int
    size: int
    bits: NDArray[np.uint8]

    @classmethod
    def of(cls, mask: Mask) -> PixelSet:
        """The pixels of a mask (H, W), which must have one at least."""
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        box = int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
        crop = mask[box[1] : box[3], box[0] : box[2]]
        return cls(*box, int(crop.sum()), np.packbits(crop))

    @classmethod
    def of_bits(cls, numbers: Sequence[int], bits: NDArray[np.uint8]) -> PixelSet:
        """From its :attr:`numbers` and an array that begins with its bits."""
        left, upper, right, lower, size = numbers
        return cls(left, upper, right, lower, size, bits[: -(-(right - left) * (lower - upper) // 8)].copy())

    @property
    def numbers(self) -> tuple[int, int, int, int, int]:
        """left, upper, right, lower, size."""
        return self.left, self.upper, self.right, self.lower, self.size

    def write(self, image: NDArray[np.uint16], value: int) -> None:
        """Give these pixels of an image (H, W) a value."""
        shape = self.lower - self.upper, self.right - self.left
        crop = np.unpackbits(self.bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
        image[self.upper : self.lower, self.left : self.right][crop] = value


class PixelMasks(Mapping[int, Mask]):
    """The pixels of one object as masks by frame, each made when it is asked for: an object may be seen all along a drive.

    Args:
        pixels: by frame; shapes: (H, W) of each frame of the drive.
    """

    def __init__(self, pixels: Mapping[int, PixelSet], shapes: Sequence[tuple[int, int]]) -> None:
        self.pixels, self._shapes = pixels, shapes

    def __getitem__(self, frame: int) -> Mask:
        image = np.zeros(self._shapes[frame], np.uint16)
        self.pixels[frame].write(image, 1)
        return image.astype(bool)

    def __contains__(self, frame: object) -> bool:
        return frame in self.pixels

    def __iter__(self) -> Iterator[int]:
        return iter(self.pixels)

    def __len__(self) -> int:
        return len(self.pixels)

"""What the numbers in a drive's label pictures mean. Readers of drives leave it open; the modules beside this one find it."""

from __future__ import annotations

from dataclasses import dataclass, field

from unveil_core.base.drive_options import MASK_REMOVES
from unveil_core.drives.labels.colours import COLOUR_ORDERS

__all__ = [
    "BLACK",
    "WHITE",
    "InstanceCode",
    "LabelCodes",
    "MaskCode",
    "SemanticCode",
]

TRAIN_IDS = "cityscapes"
BLACK, WHITE = MASK_REMOVES
"""What a mask removes."""


@dataclass(frozen=True)
class SemanticCode:
    """Of pictures of classes.

    Attributes:
        order: one of ``base.drive_options.LABEL_CLASSES``.
        divisor: a pixel is its class times this plus the number of an object; 1 = there are no such numbers.
        by_palette: of pictures with a palette its colours count, in the place of the numbers that point to them.
        stray_is_void: numbers that the order does not have are void; else they are an error.
        blue_first: of colours red and blue are exchanged, as OpenCV writes what it is not told to turn round.
    """

    order: str = TRAIN_IDS
    divisor: int = 1
    by_palette: bool = False
    stray_is_void: bool = False
    blue_first: bool = False

    @property
    def in_colours(self) -> bool:
        """Whether classes are told by colours."""
        return self.order in COLOUR_ORDERS

    @property
    def is_plain(self) -> bool:
        """Whether pictures hold trainIds and nothing else."""
        return self == SemanticCode()


@dataclass(frozen=True)
class MaskCode:
    """Of masks of what is removed.

    Attributes:
        removes: "black", as nerfstudio and COLMAP have it, or "white".
        by_alpha: transparency is the mask, not the colours.
        up_to: the largest level that counts as black, of 255: 0, or more in files that were changed a little by their format.
    """

    removes: str = BLACK
    by_alpha: bool = False
    up_to: int = 0


@dataclass(frozen=True)
class InstanceCode:
    """Of instance maps.

    Attributes:
        divisor: an object is its class times this plus a number, and what is below it is no object, as in Cityscapes'
            ``instanceIds``; 1 = pixels are ids.
        zero_is_none: with a divisor, the number 0 within a class is no object, as KITTI-360 has it.
        colours: red * 65536 + green * 256 + blue of each object, ascending, of maps that tell objects by colours; None of others.
    """

    divisor: int = 1
    zero_is_none: bool = False
    colours: tuple[int, ...] | None = None


@dataclass(frozen=True)
class LabelCodes:
    """Of all label pictures of a frame."""

    semantic: SemanticCode = field(default_factory=SemanticCode)
    mask: MaskCode = field(default_factory=MaskCode)
    instance: InstanceCode = field(default_factory=InstanceCode)

"""Label pictures, masks and instance maps of a frame as one thing each, whatever numbers their files have."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import Values, read_values
from unveil_core.base.pictures.headers import PNG_BYTES, png_start
from unveil_core.drives.checks.sizes import is_clean_ratio
from unveil_core.drives.cityscapes import VOID
from unveil_core.drives.drive import Frame
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.labels.codes import BLACK, InstanceCode, MaskCode, SemanticCode
from unveil_core.drives.labels.colours import packed, train_ids_of_colours
from unveil_core.drives.labels.orders import order_targets
from unveil_core.geometry.label_images import resize_labels

__all__ = [
    "can_stay",
    "colours_of",
    "ids_of",
    "instances",
    "instances_of",
    "is_of_other_size",
    "levels_of",
    "mask_of",
    "removed",
    "semantics_of",
    "stray_ids",
    "train_ids",
]

Ids = NDArray[Any]
L = TypeVar("L", bound=np.integer[Any])
MOST_TIMES = 8
"""A label picture may be so many times smaller or larger than its photograph."""
MOST_TAGS = 64
"""Pictures in which one channel alone has numbers are taken for such with labels in it, as CARLA's cameras write, if these are
smaller: 28 is CARLA's largest."""
SPREAD = 257
"""What programs multiply 8 bits by that make 16 of them."""


def semantics_of(frame: Frame, *, strict: bool = False) -> NDArray[np.uint8]:
    """(H, W) trainIds of a frame that has a picture of classes, 255 void.

    Args:
        strict: see :func:`train_ids`.
    Raises:
        DriveError: it cannot be read, has another shape than the photograph, or holds no such classes.
    """
    assert frame.semantic_path is not None
    values = _values(frame.semantic_path, frame)
    return _fitted(train_ids(values, frame.codes.semantic, frame.semantic_path, strict=strict), frame)


def mask_of(frame: Frame) -> NDArray[np.bool_]:
    """(H, W) what the mask of a frame that has one removes.

    Raises:
        DriveError: it cannot be read, or has another shape than the photograph.
    """
    assert frame.mask_path is not None
    gone = removed(_values(frame.mask_path, frame), frame.codes.mask)
    return _fitted(gone.view(np.uint8), frame).view(np.bool_)


def instances_of(frame: Frame) -> NDArray[np.uint16]:
    """(H, W) ids of objects of a frame that has an instance map, 0 none.

    Raises:
        DriveError: it cannot be read, has another shape than the photograph, or has several channels that tell nothing.
    """
    assert frame.instance_path is not None
    return _fitted(instances(_values(frame.instance_path, frame), frame.codes.instance, frame.instance_path), frame)


def is_of_other_size(path: Path, frame: Frame) -> bool:
    """Whether a label picture is smaller or larger than its photograph in both directions alike: it is scaled when it is read.

    Raises:
        DriveError: it cannot be read, or has another shape.
    """
    found, wanted = picture_size(path), (frame.camera.width, frame.camera.height)
    if found == wanted:
        return False
    if is_clean_ratio(wanted, found) and 1 / MOST_TIMES <= found[0] / wanted[0] <= MOST_TIMES:
        return True
    problem = f"Not the size of its camera: {found[0]}x{found[1]} pixels, the camera says {wanted[0]}x{wanted[1]}"
    raise DriveError(problem, path=path, mend="export it at the size of its photograph, or another one of its shape")


def _values(path: Path, frame: Frame) -> Values:
    return read_values(path, None if is_of_other_size(path, frame) else (frame.camera.width, frame.camera.height))


def _fitted(picture: NDArray[L], frame: Frame) -> NDArray[L]:
    """A label picture at the size of its photograph."""
    fitted: Any = resize_labels(picture, (frame.camera.width, frame.camera.height))
    return np.asarray(fitted)


def ids_of(values: Values, *, by_palette: bool = False) -> Ids | None:
    """(H, W) numbers of a picture that has one number a pixel, in one channel or the same in all of them; None of others.

    Args:
        by_palette: of a picture with a palette, its grey levels in the place of the numbers that point to them.
    """
    pixels: Ids = values.pixels
    if values.palette is not None and not by_palette:
        return pixels
    pixels = pixels if values.palette is None else values.palette[pixels]
    if pixels.ndim == 3:
        if (pixels[..., 0] == pixels[..., 1]).all() and (pixels[..., 0] == pixels[..., 2]).all():
            pixels = pixels[..., 0]
        else:
            told = [k for k in range(3) if pixels[..., k].any()]
            if len(told) != 1 or int(pixels[..., told[0]].max()) >= MOST_TAGS:
                return None
            pixels = pixels[..., told[0]]
    if pixels.dtype == np.uint16 and pixels.max(initial=0) > 255 and not (pixels % SPREAD).any():
        pixels = pixels // SPREAD
    return pixels


def colours_of(values: Values, *, blue_first: bool = False) -> NDArray[np.uint8]:
    """(H, W, 3) RGB of 8 bits, of a picture with a palette its colours; ``blue_first``: of one that has BGR."""
    pixels: Ids = values.pixels if values.palette is None else values.palette[values.pixels]
    pixels = (pixels >> 8).astype(np.uint8) if pixels.dtype == np.uint16 else pixels
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=2)
    return pixels[..., 2::-1] if blue_first else pixels[..., :3]


def levels_of(values: Values, code: MaskCode) -> Ids:
    """(H, W) levels of a mask: the largest of the channels, or the transparency where the code says so and there is any."""
    pixels: Ids = values.pixels if values.palette is None else values.palette[values.pixels]
    if pixels.ndim == 2:
        return pixels
    return pixels[..., 3] if code.by_alpha and pixels.shape[2] == 4 else pixels[..., :3].max(axis=2)


def stray_ids(ids: Ids, code: SemanticCode) -> NDArray[np.int64]:
    """Numbers in (H, W) ids of classes that the code's order does not have, ascending; 255 and 65535 are void everywhere."""
    found = np.unique(ids).astype(np.int64)
    found = np.unique(np.where(found >= code.divisor, found // code.divisor, found)) if code.divisor > 1 else found
    return found[(found >= len(order_targets(code.order))) & ~np.isin(found, (VOID, 0xFFFF))]


def train_ids(values: Values, code: SemanticCode, path: Path, *, strict: bool = False) -> NDArray[np.uint8]:
    """(H, W) trainIds, 255 void.

    Args:
        path: of the picture, for messages.
        strict: numbers that the code does not know are an error, not void.
    Raises:
        DriveError: it holds colours where numbers are meant, or few of the colours that are meant; or see ``strict``.
    """
    if code.in_colours:
        found, known = train_ids_of_colours(
            colours_of(values, blue_first=code.blue_first), code.order, lossy=values.lossy
        )
        if strict and known.mean() < 0.5:
            problem = f"has {1 - known.mean():.0%} pixels of other colours than {code.order}"
            raise DriveError(problem, path=path, mend="draw all label pictures alike, or give trainIds")
        return found
    ids = ids_of(values, by_palette=code.by_palette)
    if ids is None:
        problem = "has colours where other label pictures have numbers of classes"
        raise DriveError(problem, path=path, mend="make all of one kind")
    if strict and not code.stray_is_void and len(stray := stray_ids(ids, code)):
        problem = f"holds {', '.join(map(str, stray[:4]))}, which no class of {code.order} has"
        raise DriveError(problem, path=path, mend="say what it holds by --label-classes, or export it again")
    if code.is_plain and ids.dtype == np.uint8:
        return np.where(ids < len(order_targets(code.order)), ids, VOID).astype(np.uint8)
    whole = ids.astype(np.int64)
    whole = np.where(whole >= code.divisor, whole // code.divisor, whole) if code.divisor > 1 else whole
    targets = order_targets(code.order)
    table = np.append(targets, np.uint8(VOID))
    return table[np.minimum(whole, len(targets))]


def removed(values: Values, code: MaskCode) -> NDArray[np.bool_]:
    """(H, W) what a mask removes."""
    levels = levels_of(values, code)
    dark: NDArray[np.bool_] = levels <= code.up_to * (SPREAD if levels.dtype == np.uint16 else 1)
    return dark if code.removes == BLACK else ~dark


def instances(values: Values, code: InstanceCode, path: Path) -> NDArray[np.uint16]:
    """(H, W) ids, 0 none; ``path`` for messages.

    Raises:
        DriveError: it has several channels that differ, and no code for colours.
    """
    if code.colours is not None:
        keys = np.asarray(code.colours, np.int64)
        numbers = packed(colours_of(values))
        if code.divisor == 1:
            at = np.searchsorted(keys, numbers).clip(max=max(len(keys) - 1, 0))
            return (
                np.where(keys[at] == numbers, at + 1, 0).astype(np.uint16)
                if len(keys)
                else np.zeros_like(at, np.uint16)
            )
        # Cityscapes' panoptic pictures write the same number as red + green * 256 + blue * 65536.
        ids = (numbers >> 16) | (numbers & 0xFF00) | ((numbers & 0xFF) << 16)
    else:
        found = ids_of(values)
        if found is None:
            raise DriveError("Not an image of one channel", path=path, mend="instances are 16-bit PNGs of ids")
        ids = found.astype(np.int64)
    if code.divisor > 1:
        own = (ids >= code.divisor) & ((ids % code.divisor > 0) | (not code.zero_is_none))
        ids = np.where(own & (ids < 1 << 16), ids, 0)
    return ids.astype(np.uint16)


def can_stay(path: Path, frame: Frame, *bits: int) -> bool:
    """Whether a label picture is a PNG of its photograph's size, of one channel, with one of these numbers of bits."""
    try:
        with open_file(path) as stream:
            header = stream.read(PNG_BYTES)
    except OSError:
        return False
    found = png_start(header)
    if found is None:
        return False
    *size, depth, colour = found
    return size == [frame.camera.width, frame.camera.height] and depth in bits and colour == 0

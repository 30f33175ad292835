"""Inpainting networks in ONNX files: image and mask in, image out; and those that are given a reference as well.

An image is RGB, floating point in [0, 1] or uint8; a mask is 1 (255 as uint8) where it is to be filled. What lies under the mask is
black before a network sees it, so that it cannot matter. Whether floating-point answers run to 1 or to 255 is found by trying,
and so is the multiple that the sides must be of where they are free (8, 16, 32 or 64). One thread computes, so that the same image
gives the same bytes on every machine of a kind.
"""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.networks.onnx_files import check_readable, describe, open_onnx, short
from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.types import Levels, Mask, Picture
from unveil_core.inpaint.single_image.crops import Crop, crops
from unveil_core.inpaint.single_image.onnx_signature import (
    BOTH,
    IMAGE,
    MASK,
    REFERENCE,
    Port,
    SignatureProblem,
    read_ports,
)

__all__ = ["OnnxReference", "OnnxSingleImage", "load_reference", "load_single_image"]

Scalar = TypeVar("Scalar", bound=np.generic)

WANTED = "give an ONNX file of image (1, 3, H, W) in [0, 1] and mask (1, 1, H, W), 1 = fill, or both as (1, 4, H, W), to image"
WANTED_REFERENCE = "give an ONNX file of image, mask (1 = fill) and reference (1, 3, H, W) in [0, 1] to image"
MULTIPLES = (8, 16, 32, 64)
LEAST_PX = 64
"""Smaller pictures are continued to this: deep networks halve them many times."""
MOST_PX = 1024
"""Longest side that a network of free size is shown: its memory grows with the area."""
BRIGHT = (150, 250)
"""Colours of the picture by which a network is tried."""


def load_single_image(path: Path) -> OnnxSingleImage:
    """A single-image inpainter (see :class:`~unveil_core.inpaint.single_image.registry.SingleImageInpainter`).

    Raises:
        SettingsError: the file is missing, damaged, or not of such a network.
    """
    return OnnxSingleImage(_Network(path, WANTED, reference=False))


def load_reference(path: Path) -> OnnxReference:
    """A reference-based inpainter (see :class:`~unveil_core.inpaint.frames.by_reference.ReferenceInpainter`).

    Raises:
        SettingsError: the file is missing, damaged, or not of such a network.
    """
    return OnnxReference(_Network(path, WANTED_REFERENCE, reference=True))


class OnnxSingleImage:
    """Fills each hole in a crop around it: native resolution, unless the hole is larger than what the network takes."""

    def __init__(self, network: _Network) -> None:
        self._network = network

    def __call__(self, image: Levels, mask: Mask) -> Levels:
        """Fill ``mask`` (H, W) of ``image`` (H, W, 3), levels of 255; pixels outside the mask come back unchanged."""
        _check(image, mask)
        result, image = image.copy(), as_bytes(image)
        network = self._network
        for crop in crops(mask, network.limit, whole=network.fixed):
            filled = _shown(network, crop, image, mask, None)
            result[crop.part][crop.pixels] = filled[crop.pixels]
        return result


class OnnxReference:
    """Fills the holes of an image that is shown as a whole, as is the reference: so a place lies in both where it does."""

    def __init__(self, network: _Network) -> None:
        self._network = network

    def __call__(self, image: Levels, mask: Mask, reference: Levels) -> Levels:
        """Fill ``mask`` (H, W) of ``image`` (H, W, 3) with what ``reference`` (H', W', 3) shows of the place; pixels outside
        the mask come back unchanged."""
        _check(image, mask)
        _check(reference, None)
        given, image, reference = image, as_bytes(image), as_bytes(reference)
        if not mask.any():
            return given.copy()
        size = _within(mask.shape, self._network.limit)
        whole = Crop((slice(0, mask.shape[0]), slice(0, mask.shape[1])), size, mask)
        filled = _shown(self._network, whole, image, mask, reference)
        return np.where(mask[..., None], filled, given)


def _check(image: Picture, mask: Mask | None) -> None:
    if (
        image.dtype not in (np.dtype(np.uint8), np.dtype(np.float32))
        or image.ndim != 3
        or image.shape[2] != 3
        or not image.size
    ):
        raise ValueError(f"an image must be (H, W, 3) uint8 or float32, not {image.shape} {image.dtype}")
    if mask is not None and (mask.shape != image.shape[:2] or mask.dtype != np.bool_):
        raise ValueError(f"a mask of {mask.shape} {mask.dtype} does not fit an image of {image.shape[:2]}")


def _within(shape: tuple[int, ...], limit: tuple[int, int]) -> tuple[int, int]:
    """The size of a picture that is made to fit into a limit with its proportions, never larger than it is."""
    scale = min(1.0, limit[0] / shape[0], limit[1] / shape[1])
    return max(1, min(limit[0], round(shape[0] * scale))), max(1, min(limit[1], round(shape[1] * scale)))


def _shown(network: _Network, crop: Crop, image: Picture, mask: Mask, reference: Picture | None) -> Picture:
    """What a network makes of a part of an image, (h, w, 3) of the part's own size."""
    part, hole = image[crop.part], mask[crop.part]
    full = hole.shape
    known = np.where(hole[..., None], 0, part).astype(np.uint8)
    if crop.size != full:
        known, hole = _resized(known, crop.size), _resized(hole.astype(np.float32), crop.size) > 0
    filled = network.fill(known, hole, reference)
    if crop.size == full:
        return filled
    # Along the hole's border the larger picture mixes pixels of both sides: outside, those that are known.
    return cv2.resize(np.where(hole[..., None], filled, known), full[::-1], interpolation=cv2.INTER_CUBIC)


def _resized(picture: NDArray[Scalar], size: tuple[int, int]) -> NDArray[Scalar]:
    return cv2.resize(picture, size[::-1], interpolation=cv2.INTER_AREA)


class _Network:
    """An inpainting network from a file, tried once."""

    def __init__(self, path: Path, wanted: str, *, reference: bool) -> None:
        self.path, self.wanted = Path(path), wanted
        check_readable(self.path, wanted)
        try:
            self._session = open_onnx(self.path, threads=1)
        except Exception as error:  # whatever the library says about a damaged file
            raise self.error(f"cannot be loaded: {short(error)}") from error
        try:
            self._ports = read_ports(self._session.inputs, reference=reference)
        except SignatureProblem as problem:
            raise self.error(str(problem)) from problem
        first = next(p for p in self._ports if p.role in (IMAGE, BOTH))
        self._size = (first.height, first.width)
        self._multiple, self._output, self._output_last, self._white = 1, 0, False, 1.0
        self._try()
        self._session.tried()

    @property
    def fixed(self) -> bool:
        """Whether it takes one size only."""
        return None not in self._size

    @property
    def limit(self) -> tuple[int, int]:
        """Largest (height, width) that it is shown."""
        height, width = self._size
        return height or MOST_PX, width or MOST_PX

    def error(self, problem: str) -> SettingsError:
        """To be raised about this file."""
        return SettingsError(problem, path=self.path, mend=self.wanted)

    def fill(self, known: Picture, hole: Mask, reference: Picture | None) -> Picture:
        """(H, W, 3) uint8 from an image (H, W, 3) that is black in its ``hole`` (H, W), no larger than the limit."""
        height, width = hole.shape
        padded = (self._padded(height, 0), self._padded(width, 1))
        answers = self._run(_continued(known, padded), _continued(hole, padded), reference, (height, width))
        values = self._picture(answers, padded)
        return np.clip(np.round(values[:height, :width] * (255 / self._white)), 0, 255).astype(np.uint8)

    def _padded(self, length: int, axis: int) -> int:
        return self._size[axis] or -(-max(length, LEAST_PX) // self._multiple) * self._multiple

    def _run(
        self, known: Picture, hole: Mask, reference: Picture | None, shown: tuple[int, int]
    ) -> list[NDArray[np.generic]]:
        """Its answers to an image of which ``shown`` (height, width) are no continuation."""
        image, mask = known.astype(np.float32) / 255, hole[..., None].astype(np.float32)
        given = {IMAGE: image, MASK: mask, BOTH: np.concatenate([image, mask], axis=2)}
        tensors = {}
        for port in self._ports:
            if port.role == REFERENCE:
                given[REFERENCE] = _fitted(reference, port, shown, hole.shape)
            tensors[port.name] = port.tensor(given[port.role])  # type: ignore[arg-type]
        try:
            return self._session.run(tensors)
        except Exception as error:  # a model may fail in any way of its own
            shapes = " and ".join(str(t.shape) for t in tensors.values())
            raise self.error(f"does not take {shapes}: {short(error)}") from error

    def _picture(self, answers: list[NDArray[np.generic]], size: tuple[int, int]) -> NDArray[np.float32]:
        """(H, W, 3) of the answers, in the network's own range."""
        found = np.asarray(answers[self._output])
        if found.shape != ((1, *size, 3) if self._output_last else (1, 3, *size)):
            raise self.error(f"gives {found.shape}, not (1, 3, {size[0]}, {size[1]})")
        values = found[0].astype(np.float32) if self._output_last else found[0].transpose(1, 2, 0).astype(np.float32)
        if not np.isfinite(values).all():
            raise self.error("gives values that are not finite")
        return values

    def _try(self) -> None:
        """Run it once on a bright picture with a hole: sides that it takes, which answer is the image, and its range."""
        problem: SettingsError | None = None
        for multiple in (1,) if self.fixed else MULTIPLES:
            # An odd multiple, so that no larger one happens to divide it.
            odd = (LEAST_PX // multiple | 1) * multiple
            size = (self._size[0] or odd, self._size[1] or odd)
            rng = np.random.default_rng(0)
            known = rng.integers(*BRIGHT, (*size, 3)).astype(np.uint8)
            hole = np.zeros(size, dtype=bool)
            hole[size[0] // 4 : size[0] // 2, size[1] // 4 : size[1] // 2] = True
            known[hole] = 0
            try:
                answers = self._run(known, hole, rng.integers(*BRIGHT, (*size, 3)).astype(np.uint8), size)
                self._choose(answers, size)
                values = self._picture(answers, size)
            except SettingsError as error:
                problem = problem or error
                continue
            self._multiple = multiple
            self._white = (
                255.0 if np.issubdtype(answers[self._output].dtype, np.integer) or np.median(values) > 2 else 1.0
            )
            if (values[hole] * (255 / self._white) < 0.5).all():
                raise self.error("leaves the hole black: its mask may be meant the other way round")
            return
        assert problem is not None
        raise problem

    def _choose(self, answers: list[NDArray[np.generic]], size: tuple[int, int]) -> None:
        for k, answer in enumerate(answers):
            shape = getattr(answer, "shape", ())
            if shape in ((1, 3, *size), (1, *size, 3)) and answer.dtype.kind in "fiu":
                self._output, self._output_last = k, shape != (1, 3, *size)
                return
        shapes = " and ".join(str(getattr(a, "shape", type(a).__name__)) for a in answers)
        outputs = describe(self._session.outputs)
        raise self.error(f"gives {shapes} as {outputs}, not an image (1, 3, {size[0]}, {size[1]})")


def _continued(picture: NDArray[Scalar], size: tuple[int, int]) -> NDArray[Scalar]:
    """Mirrored below and to the right, as often as need be: (H, W, …) to a size no smaller."""
    more = [(0, want - have) for want, have in zip(size, picture.shape, strict=False)]
    return np.pad(picture, more + [(0, 0)] * (picture.ndim - 2), mode="symmetric")  # type: ignore[return-value]


def _fitted(
    reference: Picture | None, port: Port, shown: tuple[int, int], padded: tuple[int, ...]
) -> NDArray[np.float32]:
    """A reference as its input wants it: as large as the image beside it is shown, with its proportions, then continued."""
    assert reference is not None
    wanted = (port.height or padded[0], port.width or padded[1])
    most = (min(shown[0], wanted[0]), min(shown[1], wanted[1]))
    scale = min(most[0] / reference.shape[0], most[1] / reference.shape[1])
    size = tuple(max(1, min(m, round(side * scale))) for m, side in zip(most, reference.shape, strict=False))
    if size != reference.shape[:2]:
        way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        reference = cv2.resize(reference, size[::-1], interpolation=way)
    return _continued(reference, wanted).astype(np.float32) / 255  # type: ignore[return-value]

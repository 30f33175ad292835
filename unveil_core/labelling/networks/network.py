"""A network that takes one picture: its input, the sizes that it takes, and running it."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.networks.onnx_files import ONNX_TYPES, check_readable, describe, open_onnx, short
from unveil_core.base.types import Picture
from unveil_core.labelling.networks.settings import NetworkSettings

__all__ = ["IMAGENET", "WANTED", "PictureNetwork"]

WANTED = (
    "give an ONNX file of one image (1, 3, H, W) to logits (1, classes, h, w), to a label map (1, h, w), "
    "to YOLO-seg's two outputs or to MaskFormer's"
)
IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
"""Mean and standard deviation of RGB in [0, 1] that most networks are trained with."""
MULTIPLES = (32, 64, 14, 128)
"""What the sides must be multiples of where they are free, in the order in which it is tried. 14: networks on DINOv2."""
TRIED_PX = (160, 224)
"""Height and width that a network of free size is tried with, about: two lengths that cannot be mistaken for each other."""


class PictureNetwork:
    """A network from a file, not yet run.

    Attributes:
        path, settings: as given.
        size: height and width that it takes, None where free.
        multiple: what free sides must be multiples of; found by :meth:`try_it`.
        mean, std, white: colours are brought to [0, white], then (x - mean) / std. A network of uint8 gets 0 to 255 as they are.
        class_names: that the file itself has for its classes, as Ultralytics writes them, or None.
    """

    def __init__(self, path: Path, settings: NetworkSettings, *, threads: int | None = None) -> None:
        """Open the file.

        Raises:
            SettingsError: it is missing, damaged, or does not take one picture.
        """
        self.path, self.settings = path, settings
        check_readable(path, WANTED)
        try:
            self._session = open_onnx(path, threads=threads)
            self.class_names = _names_inside(self._session.metadata)
        except Exception as error:  # whatever the library says about a damaged file
            raise self.error(f"cannot be loaded: {short(error)}") from error
        self._read_input(self._session.inputs)
        self.output_names: tuple[str, ...] = tuple(o.name for o in self._session.outputs)
        if settings.output is not None and settings.output not in self.output_names:
            problem = f"{path.name} has no output {settings.output}"
            raise SettingsError(problem, path=settings.path, mend=f"it has {', '.join(self.output_names)}")
        self.multiple = 1
        self.white = 1.0 if settings.white is None else settings.white
        given = settings.mean is not None or settings.std is not None or settings.white is not None
        none = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
        usual = none if given else IMAGENET
        self.mean, self.std = settings.mean or usual[0], settings.std or usual[1]
        self.normalization_given = given

    def error(self, problem: str, mend: str = WANTED) -> SettingsError:
        """To be raised about this file."""
        return SettingsError(problem, path=self.path, mend=mend)

    def _read_input(self, inputs: Sequence[Any]) -> None:
        if len(inputs) != 1:
            raise self.error(f"has the inputs {describe(inputs)}")
        given = inputs[0]
        shape = list(given.shape or ())
        dtype = ONNX_TYPES.get(given.type)
        if dtype is None or dtype is np.bool_:
            raise self.error(f"wants {describe([given])}, and is given float, float16, double or uint8")
        if len(shape) != 4:
            raise self.error(f"wants {describe([given])}, and is given four dimensions (1, 3, H, W) or (1, H, W, 3)")
        if isinstance(shape[0], int) and shape[0] != 1:
            raise self.error(f"wants {shape[0]} images at a time in {describe([given])}, and is given one")
        self._last = shape[3] == 3 and shape[1] != 3
        channels = shape[3] if self._last else shape[1]
        if isinstance(channels, int) and channels != 3:
            raise self.error(f"wants {describe([given])}, not an image of 3 channels")
        self._name, self._dtype = given.name, dtype
        sides = shape[1:3] if self._last else shape[2:4]
        # Some exporters write -1 or 0 for a side that is free.
        height, width = (s if isinstance(s, int) and s > 0 else None for s in sides)
        self.size: tuple[int | None, int | None] = (height, width)

    @property
    def fixed(self) -> bool:
        """Whether it takes one size only."""
        return None not in self.size

    def padded(self, shown: tuple[int, int]) -> tuple[int, int]:
        """The size (height, width) that the network is given for a picture no larger."""
        height, width = (
            own if own is not None else -(-side // self.multiple) * self.multiple
            for own, side in zip(self.size, shown, strict=True)
        )
        return height, width

    def run(self, picture: Picture) -> dict[str, NDArray[Any]]:
        """Its answers by name to a picture (h, w, 3) uint8 RGB of a size that it takes, as float32 or integers.

        Raises:
            SettingsError: it fails, or gives what is not finite.
        """
        colours = picture[..., ::-1] if self.settings.channels == "BGR" else picture
        if self._dtype is np.uint8:
            values: NDArray[Any] = colours
        else:
            scaled = colours.astype(np.float32) * np.float32(self.white / 255)
            values = ((scaled - np.array(self.mean, np.float32)) / np.array(self.std, np.float32)).astype(self._dtype)
        tensor = np.ascontiguousarray(values[None] if self._last else values.transpose(2, 0, 1)[None])
        try:
            answers = self._session.run({self._name: tensor})
        except Exception as error:  # a model may fail in any way of its own
            raise self.error(f"does not take {tensor.shape}: {short(error)}") from error
        found = {}
        for name, answer in zip(self.output_names, answers, strict=True):
            if not isinstance(answer, np.ndarray) or answer.dtype.kind not in "fiub":
                continue
            if answer.dtype.kind == "f":
                answer = answer.astype(np.float32)
                if not np.isfinite(answer).all():
                    raise self.error(f"gives values that are not finite in {name!r}")
            found[name] = answer
        return found

    def try_it(self) -> tuple[tuple[int, int], dict[str, NDArray[Any]]]:
        """Run it once on noise: the size (height, width) that it was given, and its answers. Finds :attr:`multiple`.

        Raises:
            SettingsError: it takes none of the sizes that are tried.
        """
        problem: SettingsError | None = None
        for multiple in (1,) if self.fixed else MULTIPLES:
            # Odd multiples, so that no larger one happens to divide them.
            tried = [(side // multiple | 1) * multiple for side in TRIED_PX]
            tried[1] += 2 * multiple * (tried[0] == tried[1])
            height, width = self.size[0] or tried[0], self.size[1] or tried[1]
            noise = np.random.default_rng(0).integers(0, 256, (height, width, 3)).astype(np.uint8)
            try:
                answers = self.run(noise)
            except SettingsError as error:
                problem = problem or error
                continue
            self.multiple = multiple
            self._session.tried()
            return (height, width), answers
        assert problem is not None
        raise problem


def _names_inside(metadata: dict[str, str]) -> tuple[str, ...] | None:
    """Class names in order, from the metadata key ``names`` that holds a dictionary or list in Python's notation."""
    text = metadata.get("names", "")
    try:
        found = ast.literal_eval(text[:100_000])
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return None
    if isinstance(found, dict):
        found = [found[k] for k in range(len(found))] if set(found) == set(range(len(found))) else None
    return tuple(str(name) for name in found) if isinstance(found, list) and found else None

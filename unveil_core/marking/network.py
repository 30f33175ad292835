"""A promptable network of the user's (SAM and its like) in the place of colours: the same clicks, or those that geometry gives.

Two ONNX files: an encoder from a picture to features, and a decoder from features and points to masks. Which input is which follows
from names and shapes, as the exporters of SAM, SAM 2, MobileSAM and EfficientSAM's decoders in that style write them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError
from unveil_core.base.networks.onnx_files import check_readable, describe, open_onnx, short
from unveil_core.base.networks.session import OnnxSession, OnnxValue
from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.images import within
from unveil_core.marking.asked.prompts import Prompt
from unveil_core.marking.outline import object_outline
from unveil_core.marking.seeds import Seeds

__all__ = ["Networks", "Promptable"]

ENCODER = "give the encoder's ONNX file: an image (1, 3, H, W) or (H, W, 3) to features"
DECODER = "give the decoder's ONNX file: features, point_coords (1, N, 2) and point_labels (1, N) to masks (1, K, H, W)"
USUAL_SIDE = 1024
"""Side of the square that an encoder of free size gets the picture in, pixels."""
MEAN, STD = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
"""Of colours from 0 to 255, that such encoders are trained with."""
OWN, OTHER, UPPER_LEFT, LOWER_RIGHT, PADDING = 1, 0, 2, 3, -1
"""Labels of points: on the object, beside it, corners of a box around it, none."""
GIVEN_POINTS = 3
"""Points on an object, and beside it, that geometry gives where nobody clicked."""
BEYOND = 0.15
"""How far outside of what geometry allows a mask may go, a share of the object's size."""


@dataclass(frozen=True)
class Networks:
    """The two files."""

    encoder: Path
    decoder: Path


class Promptable:
    """The two halves, open; a picture is encoded once however often it is asked about.

    Attributes:
        networks: the files.
    """

    def __init__(self, networks: Networks, *, threads: int | None = None) -> None:
        """Open the files.

        Raises:
            SettingsError: one is missing, damaged, or no such half.
        """
        self.networks = networks
        self._encoder = _open(networks.encoder, ENCODER, threads)
        self._decoder = _open(networks.decoder, DECODER, threads)
        if len(self._encoder.inputs) != 1:
            raise SettingsError(f"has the inputs {describe(self._encoder.inputs)}", path=networks.encoder, mend=ENCODER)
        self._picture = self._encoder.inputs[0]
        shape = self._picture.shape
        self._last = len(shape) in (3, 4) and shape[-1] == 3
        if not self._last and (len(shape) != 4 or shape[1] not in (3, None)):
            raise SettingsError(f"wants {describe([self._picture])}", path=networks.encoder, mend=ENCODER)
        sides = shape[-3:-1] if self._last else shape[-2:]
        self._raw = len(shape) == 3  # such exports normalize and resize by themselves
        self._size = tuple(s if isinstance(s, int) and s > 0 else USUAL_SIDE for s in sides)
        self._given = {role: v.name for v in self._decoder.inputs if (role := _role(v)) is not None}
        if not {"coords", "labels"} <= self._given.keys():
            problem = f"has the inputs {describe(self._decoder.inputs)}"
            raise SettingsError(problem, path=networks.decoder, mend=DECODER)
        # With several scales of features pictures are stretched to the square, with one they are padded.
        self._stretched = not self._raw and len([v for v in self._decoder.inputs if _role(v) is None]) > 1
        self._features: tuple[int, dict[str, NDArray[Any]]] | None = None

    def outline(self, v: int, image: NDArray[np.uint8], seeds: Seeds | None, prompt: Prompt | None) -> Mask:
        """(H, W) pixels of an object in a photograph (H, W, 3), the ``v``-th: by clicks, and by what geometry says.

        Raises:
            SettingsError: a network fails, or gives no mask.
        """
        if prompt is not None and prompt.matte is not None:
            return prompt.matte.copy()
        points, labels = _asked(image.shape[:2], seeds, prompt)
        if not (labels == OWN).any():
            return np.zeros(image.shape[:2], dtype=bool)
        mask = self.mask_of(v, image, points, labels)
        if seeds is not None:
            allowed = np.zeros(mask.shape, dtype=bool)
            allowed[seeds.window] = within(seeds.possible, BEYOND * seeds.size) & ~seeds.hidden
            mask &= allowed
        if prompt is not None:
            mask = (mask | prompt.own(mask.shape)) & ~prompt.others(mask.shape)
        # A network that finds nothing of what geometry is sure of is asked about something that it does not know.
        if seeds is not None and seeds.sure.any() and mask[seeds.window][seeds.sure].mean() < 0.5:
            return object_outline(image, seeds, prompt)
        return mask

    def mask_of(self, v: int, image: NDArray[np.uint8], points: Float64, labels: NDArray[np.int64]) -> Mask:
        """(H, W) what the decoder says of points (N, 2), pixels, and labels (N,) in a photograph (H, W, 3)."""
        factor, features = self._encoded(v, image)
        feeds: dict[str, NDArray[Any]] = dict(features)
        if "box" not in self._given and not (labels >= UPPER_LEFT).any():
            # SAM's decoder wants a box or a point that is none.
            points, labels = np.append(points, [[0.0, 0.0]], axis=0), np.append(labels, PADDING)
        height, width = image.shape[:2]
        values: dict[str, NDArray[Any]] = {
            "coords": (points * factor)[None].astype(np.float32),
            "labels": labels[None],
            "mask": np.zeros((1, 1, 256, 256), np.float32),
            "has_mask": np.zeros(1, np.float32),
            "size": np.array([height, width], np.float32),
        }
        for value in self._decoder.inputs:
            role = _role(value)
            if role == "mask":
                sides = [s if isinstance(s, int) else 256 for s in value.shape[-2:]]
                feeds[value.name] = np.zeros((1, 1, *sides), _dtype(value))
            elif role is not None:
                feeds[value.name] = values[role].astype(_dtype(value))
        answers = self._run(self._decoder, self.networks.decoder, feeds)
        return self._chosen(answers, (height, width))

    def _chosen(self, answers: Mapping[str, NDArray[Any]], shape: tuple[int, int]) -> Mask:
        """The mask that the decoder holds for the best."""
        pictures = {n: a for n, a in answers.items() if a.ndim in (4, 5) and a.dtype.kind == "f"}
        if not pictures:
            problem = f"gives {', '.join(f'{n} {a.shape}' for n, a in answers.items())}"
            raise SettingsError(problem, path=self.networks.decoder, mend=DECODER)
        name = max(pictures, key=lambda n: pictures[n].shape[-1] * pictures[n].shape[-2])
        masks = pictures[name].reshape(-1, *pictures[name].shape[-2:])
        scores = next((a.ravel() for n, a in answers.items() if "iou" in n.lower() and a.size == len(masks)), None)
        logits = masks[0 if scores is None else int(scores.argmax())].astype(np.float32)
        if logits.shape == shape:
            return np.asarray(logits > 0)
        height, width = shape
        if not self._stretched and not self._raw:  # a square with the picture in its upper left corner
            part = max(height, width)
            rows, columns = (max(1, round(logits.shape[k] * s / part)) for k, s in enumerate((height, width)))
            logits = logits[:rows, :columns]
        return np.asarray(cv2.resize(logits, (width, height), interpolation=cv2.INTER_LINEAR) > 0)

    def _encoded(self, v: int, image: NDArray[np.uint8]) -> tuple[NDArray[np.float64], dict[str, NDArray[Any]]]:
        """Factors from pixels to the decoder's coordinates, and its features by the names of its inputs."""
        height, width = image.shape[:2]
        tall, wide = self._size
        tensor: NDArray[Any]
        if self._raw:
            long = USUAL_SIDE / max(height, width)
            factor, tensor = np.array([long, long]), image.astype(_dtype(self._picture))
        else:
            long = min(tall / height, wide / width)
            factor = np.array([wide / width, tall / height]) if self._stretched else np.array([long, long])
            size = (max(1, round(width * factor[0])), max(1, round(height * factor[1])))
            small = cv2.resize(image, size, interpolation=cv2.INTER_AREA if long < 1 else cv2.INTER_LINEAR)
            colours = (small.astype(np.float32) - np.array(MEAN, np.float32)) / np.array(STD, np.float32)
            square = np.zeros((tall, wide, 3), np.float32)
            square[: size[1], : size[0]] = colours
            tensor = (square if self._last else square.transpose(2, 0, 1))[None].astype(_dtype(self._picture))
        if self._features is None or self._features[0] != v:
            answers = self._run(self._encoder, self.networks.encoder, {self._picture.name: tensor})
            self._features = v, self._matched(answers)
        return factor, self._features[1]

    def _matched(self, answers: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """What the encoder gives by the names of the decoder's inputs: by name, else by shape, else in order."""
        wanted = [v for v in self._decoder.inputs if _role(v) is None]
        left, found = dict(answers), {}
        for value in wanted:
            fits = [
                n
                for n, a in left.items()
                if len(value.shape) == a.ndim
                and all(not isinstance(s, int) or s == t for s, t in zip(value.shape, a.shape, strict=True))
            ]
            name = value.name if value.name in fits else next(iter(fits), None)
            if name is None:
                shapes = ", ".join(f"{n} {a.shape}" for n, a in answers.items())
                problem = f"wants {describe([value])}; the encoder gives {shapes}"
                raise SettingsError(problem, path=self.networks.decoder, mend="give the two halves of one network")
            found[value.name] = left.pop(name).astype(_dtype(value))
        return found

    def _run(self, half: OnnxSession, path: Path, feeds: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        try:
            answers = half.run(feeds)
        except Exception as error:  # a model may fail in any way of its own
            raise SettingsError(
                f"fails: {short(error)}", path=path, mend="check it in the program that exported it"
            ) from error
        half.tried()
        return {v.name: a for v, a in zip(half.outputs, answers, strict=True) if isinstance(a, np.ndarray)}


def _open(path: Path, mend: str, threads: int | None) -> OnnxSession:
    check_readable(path, mend)
    try:
        return open_onnx(path, threads=threads)
    except Exception as error:  # whatever the library says about a damaged file
        raise SettingsError(f"cannot be loaded: {short(error)}", path=path, mend=mend) from error


def _role(value: OnnxValue) -> str | None:
    """What of the prompt a decoder's input is; None for features."""
    name = value.name.lower()
    if "has_mask" in name:
        return "has_mask"
    if "mask" in name:
        return "mask"
    if "coord" in name or (name.endswith("points") and len(value.shape) in (3, 4)):
        return "coords"
    if "label" in name:
        return "labels"
    return "size" if "orig" in name and "size" in name else None


def _dtype(value: OnnxValue) -> type[np.generic]:
    kinds: dict[str, type[np.generic]] = {
        "float16": np.float16,
        "double": np.float64,
        "uint8": np.uint8,
        "int64": np.int64,
        "int32": np.int32,
    }
    return next((kind for name, kind in kinds.items() if name in value.type), np.float32)


def _asked(shape: tuple[int, int], seeds: Seeds | None, prompt: Prompt | None) -> tuple[Float64, NDArray[np.int64]]:
    """Points (N, 2), pixels, and their labels (N,): the clicks, what a stroke covers, and what geometry is sure of."""
    points: list[Float64] = []
    labels: list[int] = []

    def add(places: Float64, label: int) -> None:
        points.extend(places)
        labels.extend([label] * len(places))

    if prompt is not None:
        add(prompt.inside, OWN)
        add(prompt.outside, OTHER)
        if prompt.stroke is not None:
            add(_spread(prompt.stroke), OWN)
    if seeds is not None:
        corner = np.array([seeds.window[1].start, seeds.window[0].start])
        if OWN not in labels:
            add(_spread(seeds.sure if seeds.sure.any() else seeds.likely) + corner, OWN)
        if prompt is None and (seeds.other | seeds.hidden).any():
            add(_spread(seeds.other | seeds.hidden) + corner, OTHER)
        rows, columns = np.nonzero(seeds.likely & ~seeds.hidden)
        if prompt is None and len(rows):
            add(np.array([[columns.min(), rows.min()]]) + corner, UPPER_LEFT)
            add(np.array([[columns.max() + 1.0, rows.max() + 1.0]]) + corner, LOWER_RIGHT)
    return np.array(points, dtype=np.float64).reshape(-1, 2), np.array(labels, dtype=np.int64)


def _spread(mask: Mask) -> Float64:
    """(K, 2) places deep within a mask (H, W), far from each other."""
    inside = np.pad(mask.astype(np.uint8), 1)
    depth = cv2.distanceTransform(inside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1].astype(np.float32)
    found: list[tuple[float, float]] = []
    for _ in range(GIVEN_POINTS):
        row, column = np.unravel_index(int(depth.argmax()), depth.shape)
        radius = float(depth[row, column])
        if radius <= 0:
            break
        found.append((column + 0.5, row + 0.5))
        cv2.circle(depth, (int(column), int(row)), int(max(2 * radius, 0.15 * max(depth.shape))), 0.0, -1)
    return np.array(found).reshape(-1, 2)

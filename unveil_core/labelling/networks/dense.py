"""Networks that name a class at each pixel: logits, label maps, and MaskFormer's queries, all as scores of Cityscapes classes.

A score is the logarithm of a probability. Classes that mean the same Cityscapes class count together. Scores are enlarged
bilinearly before the largest is taken, which gives smoother borders than enlarging labels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32
from unveil_core.drives.cityscapes import VOID

__all__ = [
    "NO_LABEL",
    "Dense",
    "OutputProblem",
    "alike",
    "enlarged",
    "find_dense",
    "looks_like_detr",
    "maskformer_pair",
]

LEAST_PROBABILITY = 1e-6
"""Below it probabilities that a network gives as such make no difference."""
NO_LABEL = -1


class OutputProblem(Exception):
    """What is wrong with the answers of a network, a short phrase."""


@dataclass(frozen=True)
class Dense:
    """How the classes at each pixel are read from a network's answers.

    Attributes:
        kind: "logits", "labels" or "maskformer".
        outputs: names of the answers that count: one, or MaskFormer's classes and masks.
        last: whether classes are the last axis instead of the second.
        count: number of classes; None where label maps do not tell.
        probabilities: the answer holds probabilities, not logits.
    """

    kind: str
    outputs: tuple[str, ...]
    last: bool = False
    count: int | None = None
    probabilities: bool = False

    def scores(
        self, answers: Mapping[str, NDArray[Any]], targets: NDArray[np.int64], ids: NDArray[np.uint8]
    ) -> Float32:
        """(K, h, w) of the Cityscapes classes ``ids`` (K,).

        Args:
            answers: of the network, by name.
            targets: (C,) trainId of each class or label, ``NO_LABEL`` of labels that the network should not give.
        Raises:
            OutputProblem: the answers are not as they were when the network was tried.
        """
        first = answers[self.outputs[0]]
        if self.kind == "maskformer":
            return _log(_grouped(_maskformer(first, answers[self.outputs[1]]), targets, ids))
        if self.kind == "labels":
            return _of_labels(first, targets, ids)
        planes = np.moveaxis(first[0], -1, 0) if self.last else first[0]
        if planes.shape[0] != len(targets):
            raise OutputProblem(f"gives {planes.shape[0]} classes, and gave {len(targets)} before")
        if self.probabilities:
            return _log(_grouped(planes, targets, ids))
        return _log_probabilities(planes, targets, ids)


def _log(probabilities: Float32) -> Float32:
    return np.log(np.maximum(probabilities, np.float32(LEAST_PROBABILITY)))


def _grouped(probabilities: Float32, targets: NDArray[np.int64], ids: NDArray[np.uint8]) -> Float32:
    """(K, h, w) shares of the classes (C, h, w) that mean the same."""
    summed = np.stack([probabilities[targets == i].sum(axis=0) for i in ids])
    return summed / np.maximum(summed.sum(axis=0), np.float32(LEAST_PROBABILITY))


def _log_probabilities(logits: Float32, targets: NDArray[np.int64], ids: NDArray[np.uint8]) -> Float32:
    """(K, h, w) log-probabilities of classes (C, h, w) that mean the same, by softmax, without overflow."""

    def log_sum(planes: Float32) -> Float32:
        if len(planes) == 1:
            return planes[0]
        largest = planes.max(axis=0)
        return largest + np.log(np.exp(planes - largest).sum(axis=0))

    summed = np.stack([log_sum(logits[targets == i]) for i in ids])
    return summed - log_sum(summed)


def _maskformer(classes: Float32, masks: Float32) -> Float32:
    """(C, h, w) from the queries' classes (1, Q, C + 1), the last "nothing", and masks (1, Q, h, w): what each query says there,
    by how sure it is."""
    shares = np.exp(classes[0] - classes[0].max(axis=1, keepdims=True))
    shares = (shares / shares.sum(axis=1, keepdims=True))[:, :-1]
    inside = 1 / (1 + np.exp(-np.clip(masks[0], -50, 50)))
    return np.asarray(np.tensordot(shares, inside, axes=(0, 0)), dtype=np.float32)


def _of_labels(labels: NDArray[Any], targets: NDArray[np.int64], ids: NDArray[np.uint8]) -> Float32:
    """(K, h, w), 0 for the class that a label map names and -1 for others."""
    plain = np.squeeze(labels).reshape(_plane(labels.shape)).astype(np.int64)
    plain = np.where((plain < 0) | (plain == VOID), len(targets), plain)
    table = np.append(targets, VOID)
    if plain.max() >= len(table) or (table[plain] == NO_LABEL).any():
        wrong = plain[plain >= len(table)] if plain.max() >= len(table) else plain[table[plain] == NO_LABEL]
        raise OutputProblem(f"gives the label {int(wrong.max())}, which is none of its classes")
    return (table[plain] == ids[:, None, None]).astype(np.float32) - 1


def _plane(shape: tuple[int, ...]) -> tuple[int, int]:
    """Height and width of a label map (1, h, w), (1, 1, h, w) or (1, h, w, 1)."""
    if len(shape) == 3:
        return shape[1], shape[2]
    return (shape[2], shape[3]) if shape[1] == 1 else (shape[1], shape[2])


def _is_plane(shape: tuple[int, ...], given: tuple[int, int]) -> bool:
    """Whether an answer is one value a pixel: of the proportions of the picture that was given."""
    if not (len(shape) == 3 or (len(shape) == 4 and 1 in (shape[1], shape[3]))) or shape[0] != 1:
        return False
    return alike(_plane(shape), given)


def alike(size: tuple[int, ...], given: tuple[int, int]) -> bool:
    """Whether a size is the given one at some stride, with its sides rounded."""
    if min(size) < 1:
        return False
    stride = given[0] / size[0]
    return abs(given[1] / stride - size[1]) <= 1 + 0.5 * size[1] / size[0]


def maskformer_pair(answers: Mapping[str, NDArray[Any]], given: tuple[int, int]) -> tuple[str, str] | None:
    """Names of the queries' classes (1, Q, C + 1) and masks (1, Q, h, w), where there are such."""
    floats = {n: a for n, a in answers.items() if a.dtype.kind == "f" and a.shape[:1] == (1,)}
    masks = [n for n, a in floats.items() if a.ndim == 4 and alike((a.shape[2], a.shape[3]), given)]
    pairs = [
        (c, m)
        for m in sorted(masks, key=lambda n: "mask" not in n)
        for c in sorted((n for n, a in floats.items() if a.ndim == 3), key=lambda n: "class" not in n)
        if floats[c].shape[1] == floats[m].shape[1] and floats[c].shape[2] > 4
    ]
    return pairs[0] if pairs else None


def find_dense(
    answers: Mapping[str, NDArray[Any]], given: tuple[int, int], kind: str | None, count: int | None
) -> Dense | None:
    """How to read the answers to a picture of a size (height, width); None where none is dense.

    Args:
        kind: that the user names, else None; count: of classes that the user names, else None.
    """
    if kind in (None, "maskformer") and (pair := maskformer_pair(answers, given)) is not None:
        return Dense("maskformer", pair, count=answers[pair[0]].shape[2] - 1)
    for name, answer in answers.items():
        if kind in (None, "labels") and _is_plane(answer.shape, given):
            whole = answer.dtype.kind in "iub" or bool((answer == np.round(answer)).all() and answer.min() >= 0)
            if whole or kind == "labels":
                return Dense("labels", (name,))
        if kind in (None, "logits") and answer.ndim == 4 and answer.shape[0] == 1 and answer.dtype.kind == "f":
            first = answer.shape[1] > 1 and alike((answer.shape[2], answer.shape[3]), given)
            last = answer.shape[3] > 1 and alike((answer.shape[1], answer.shape[2]), given)
            if first and last:  # by the number of classes, which mostly is less than that of pixels
                first = answer.shape[1] == count if count is not None else answer.shape[1] <= answer.shape[3]
            if first or last:
                planes = answer[0] if first else np.moveaxis(answer[0], -1, 0)
                sums = bool(planes.min() >= 0 and np.allclose(planes.sum(axis=0), 1, atol=1e-2))
                return Dense("logits", (name,), not first, planes.shape[0], sums)
    return None


def enlarged(scores: Float32, size: tuple[int, int]) -> Float32:
    """(K, h, w) scores at another size (height, width), bilinear."""
    if scores.shape[1:] == size:
        return scores
    return np.stack([cv2.resize(plane, size[::-1], interpolation=cv2.INTER_LINEAR) for plane in scores])


def looks_like_detr(answers: Mapping[str, NDArray[Any]]) -> bool:
    """Whether there are boxes (1, Q, 4) beside classes and masks of Q objects, as DETR's descendants give them: not read."""
    counts = {a.shape[1] for a in answers.values() if a.ndim == 3 and a.shape[2] == 4}
    return any(a.ndim == 4 and a.shape[1] in counts for a in answers.values())

"""YOLO-seg (Ultralytics' v5, v8, v11 and those that suppress doubles themselves): objects with boxes and masks.

The picture is shown whole, with its proportions, amid grey. A network gives, for N places, a box, scores of C classes and P
coefficients, and P prototype masks (1, P, h, w): an object's mask is the sigmoid of the prototypes' sum by its coefficients, cut
to its box. v8 and later: (1, 4 + C + P, N). v5: (1, N, 5 + C + P) with a score of there being an object at all, which multiplies
the others. With doubles suppressed: (1, N, 6 + P), the box by its corners, a score and the number of the class.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Picture
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.labelling.networks.class_tables import removable
from unveil_core.labelling.networks.dense import alike
from unveil_core.labelling.networks.network import PictureNetwork

__all__ = ["YOLO_SIDE", "Yolo", "find_yolo", "segment_objects"]

YOLO_SIDE = 640
"""Longer side that a network of free size is shown, pixels: what these networks are trained with."""
GREY = 114
"""Around the picture, as in training."""
STRIDES = (8, 16, 32)
"""Pixels a place, of the three grids that the places lie on."""
MOST_OBJECTS = 300
"""Likeliest objects of one picture that are looked at."""
ALIKE = ("car", "truck", "bus", "train")
"""Networks often see one vehicle as two of these: such doubles are suppressed as doubles of one class are."""


@dataclass(frozen=True)
class Yolo:
    """How objects are read from a network's answers.

    Attributes:
        objects, prototypes: names of the two answers.
        version: 8 (also 11), 5, or 0 where doubles are suppressed.
        turned: the objects' answer is (1, features, N) instead of (1, N, features).
        last: the prototypes are (1, h, w, P).
        count: number of classes; None where the answer does not tell.
    """

    objects: str
    prototypes: str
    version: int
    turned: bool
    last: bool
    count: int | None


def find_yolo(answers: Mapping[str, NDArray[Any]], given: tuple[int, int], count: int | None) -> Yolo | None:
    """How to read the answers to a picture of a size (height, width), None where they are not those of YOLO-seg.

    Args:
        count: of classes that the user or the file names, else None.
    """
    floats = {n: a for n, a in answers.items() if a.dtype.kind == "f" and a.shape[:1] == (1,)}
    places = sum(-(-given[0] // s) * -(-given[1] // s) for s in STRIDES)
    for name, planes in floats.items():
        if planes.ndim != 4:
            continue
        last = alike(planes.shape[1:3], given) and not alike(planes.shape[2:4], given)
        coefficients = planes.shape[3] if last else planes.shape[1]
        for other, objects in floats.items():
            if objects.ndim != 3:
                continue
            for turned in (False, True):
                rows, features = objects.shape[1:] if not turned else objects.shape[:0:-1]
                classes = features - coefficients
                if features == 6 + coefficients and rows not in (places, 3 * places):
                    return Yolo(other, name, 0, turned, last, count)
                if classes == 5 + count if count is not None else rows == 3 * places and classes > 5:
                    return Yolo(other, name, 5, turned, last, classes - 5)
                if classes == 4 + count if count is not None else rows == places and classes > 4:
                    return Yolo(other, name, 8, turned, last, classes - 4)
    return None


@dataclass(frozen=True)
class _Objects:
    """Attributes:
    boxes: (n, 4) x0, y0, x1, y1 in pixels of what the network was given; scores: (n,); classes: (n,) trainIds;
    coefficients: (n, P).
    """

    boxes: Float64
    scores: Float64
    classes: NDArray[np.uint8]
    coefficients: Float32

    def __getitem__(self, which: NDArray[Any]) -> _Objects:
        return _Objects(self.boxes[which], self.scores[which], self.classes[which], self.coefficients[which])


def segment_objects(
    network: PictureNetwork, yolo: Yolo, targets: NDArray[np.uint8], image: Picture
) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """(H, W) trainIds of removable objects, 255 elsewhere, and (H, W) ids of objects, 1 the surest, 0 none.

    Args:
        targets: (C,) trainIds of the network's classes.
        image: (H, W, 3).
    """
    shown, scale, offset = _letterboxed(network, image)
    answers = network.run(shown)
    planes = answers[yolo.prototypes][0]
    prototypes: Float32 = np.moveaxis(planes, -1, 0) if yolo.last else planes
    objects = _objects(answers[yolo.objects][0], yolo, targets, network.settings.score, prototypes.shape[0])
    objects = objects[_without_doubles(objects, network.settings.overlap)]
    semantic = np.full(image.shape[:2], VOID, dtype=np.uint8)
    instance = np.zeros(image.shape[:2], dtype=np.uint16)
    for k in range(len(objects.scores) - 1, -1, -1):  # the surest is painted last
        part, mask = _mask_in_image(objects, k, prototypes, shown.shape[:2], scale, offset, image.shape[:2])
        semantic[part][mask], instance[part][mask] = objects.classes[k], k + 1
    return semantic, instance


def _letterboxed(network: PictureNetwork, image: Picture) -> tuple[Picture, float, tuple[int, int]]:
    """The image with its proportions amid grey as the network takes it, its scale there, and where it begins (y, x)."""
    height, width = image.shape[:2]
    usual = network.settings.window or (YOLO_SIDE, YOLO_SIDE)
    limit = (network.size[0] or usual[0], network.size[1] or usual[1])
    scale = min(limit[0] / height, limit[1] / width)
    size = (max(1, round(height * scale)), max(1, round(width * scale)))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    small = image if size == (height, width) else cv2.resize(image, size[::-1], interpolation=way)
    padded = network.padded(size)
    offset = ((padded[0] - size[0]) // 2, (padded[1] - size[1]) // 2)
    shown = np.full((*padded, 3), GREY, dtype=np.uint8)
    shown[offset[0] : offset[0] + size[0], offset[1] : offset[1] + size[1]] = small
    return shown, scale, offset


def _objects(answer: Float32, yolo: Yolo, targets: NDArray[np.uint8], least: float, coefficients: int) -> _Objects:
    """What is removable and sure enough, the surest first."""
    rows = np.asarray(answer.T if yolo.turned else answer, dtype=np.float64)
    if yolo.version == 0:
        numbers = np.round(rows[:, 5]).astype(np.int64)
        known = (numbers >= 0) & (numbers < len(targets))
        classes = np.where(known, targets[np.clip(numbers, 0, len(targets) - 1)], VOID).astype(np.uint8)
        scores, corners = rows[:, 4], rows[:, :4]
    else:
        first = 5 if yolo.version == 5 else 4
        by_class = rows[:, first : rows.shape[1] - coefficients] * (rows[:, 4:5] if yolo.version == 5 else 1.0)
        best = by_class.argmax(axis=1)
        classes, scores = targets[best], by_class.max(axis=1)
        half = rows[:, 2:4] / 2
        corners = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
    wanted = np.flatnonzero((scores >= least) & removable(classes))
    wanted = wanted[np.argsort(-scores[wanted], kind="stable")][:MOST_OBJECTS]
    own = rows[wanted, rows.shape[1] - coefficients :].astype(np.float32)
    return _Objects(corners[wanted], scores[wanted], classes[wanted], own)


def _without_doubles(objects: _Objects, overlap: float) -> NDArray[np.int64]:
    """Indices of the objects that overlap no surer one of their kind by more than that (intersection over union)."""
    boxes = objects.boxes
    area = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0), axis=1)
    kinds = np.where(np.isin(objects.classes, [train_id(n) for n in ALIKE]), train_id(ALIKE[0]), objects.classes)
    left, kept = np.arange(len(boxes)), []
    while len(left):
        first, rest = left[0], left[1:]
        kept.append(first)
        low, high = np.maximum(boxes[first, :2], boxes[rest, :2]), np.minimum(boxes[first, 2:], boxes[rest, 2:])
        shared = np.prod(np.maximum(high - low, 0), axis=1)
        union = np.maximum(area[first] + area[rest] - shared, 1e-9)
        left = rest[(shared / union <= overlap) | (kinds[rest] != kinds[first])]
    return np.array(kept, dtype=np.int64)


def _mask_in_image(
    objects: _Objects,
    k: int,
    prototypes: Float32,
    shown: tuple[int, ...],
    scale: float,
    offset: tuple[int, int],
    size: tuple[int, ...],
) -> tuple[tuple[slice, slice], NDArray[np.bool_]]:
    """The part of the image that an object's box covers, and the mask of that part."""
    box = (objects.boxes[k] - np.array([offset[1], offset[0]] * 2)) / scale
    x0, y0 = (max(0, int(np.floor(v + 0.5))) for v in box[:2])
    x1, y1 = (min(side, int(np.floor(v + 0.5))) for v, side in zip(box[2:], size[::-1], strict=True))
    part = (slice(y0, max(y0, y1)), slice(x0, max(x0, x1)))
    if y1 <= y0 or x1 <= x0:
        return part, np.zeros((max(0, y1 - y0), max(0, x1 - x0)), dtype=bool)
    logits = np.tensordot(objects.coefficients[k], prototypes, axes=1).astype(np.float32)
    step_y, step_x = prototypes.shape[1] / shown[0], prototypes.shape[2] / shown[1]
    # From the centre of a pixel of the part to the place in the prototypes, whose centres are at + 0.5, too.
    to_prototype = np.array(
        [
            [scale * step_x, 0, ((x0 + 0.5) * scale + offset[1]) * step_x - 0.5],
            [0, scale * step_y, ((y0 + 0.5) * scale + offset[0]) * step_y - 0.5],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    enlarged = cv2.warpAffine(logits, to_prototype, (x1 - x0, y1 - y0), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return part, np.asarray(enlarged > 0)

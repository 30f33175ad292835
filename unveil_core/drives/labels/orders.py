"""Class numbers of public data sets, and the Cityscapes class that each of them means.

Cityscapes trainIds and labelIds, with those that KITTI-360 adds; ADE20K's 150 classes (SceneParse150), counted from 0, or from 1 as
its files have them; Mapillary Vistas 1.2; the tags of CARLA since 0.9.14; the 80 of COCO's detectors; PASCAL VOC's 21; Waymo's
camera segmentation (``protos/camera_segmentation.proto``).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.cityscapes import CITYSCAPES, LABEL_IDS, VOID, train_id

__all__ = ["ORDERS", "order_targets", "targets_by_number"]

KITTI360_IDS: dict[int, str] = {
    9: "road", 14: "fence", 15: "building", 16: "building", 18: "pole", 29: "truck", 30: "truck", 34: "building",
    35: "fence", 37: "pole", 38: "pole", 43: "car",
}  # fmt: skip
"""LabelIds without a trainId that are like classes with one: parking 9, guard rail 14, bridge 15, tunnel 16, polegroup 18, caravan
29, trailer 30; and of those that KITTI-360 adds, garage 34, gate 35, small pole 37, lamp 38, unknown vehicle 43."""
LABEL_ID_COUNT = 45
"""labelIds and those of KITTI-360, with 0."""
ADE20K: dict[int, str] = {
    0: "wall", 1: "building", 2: "sky", 4: "vegetation", 6: "road", 9: "terrain", 11: "sidewalk", 12: "person",
    13: "terrain", 17: "vegetation", 20: "car", 25: "building", 29: "terrain", 32: "fence", 38: "fence",
    43: "traffic sign", 46: "terrain", 48: "building", 52: "sidewalk", 54: "road", 61: "building", 66: "vegetation",
    68: "terrain", 72: "vegetation", 79: "building", 80: "bus", 83: "truck", 84: "building", 87: "pole",
    91: "terrain", 93: "pole", 94: "terrain", 102: "car", 116: "motorcycle", 127: "bicycle", 136: "traffic light",
}  # fmt: skip
MAPILLARY: dict[int, str] = {
    2: "sidewalk", 3: "fence", 4: "fence", 5: "fence", 6: "wall", 7: "road", 8: "road", 9: "sidewalk", 10: "road",
    11: "sidewalk", 12: "road", 13: "road", 14: "road", 15: "sidewalk", 16: "building", 17: "building", 18: "building",
    19: "person", 20: "rider", 21: "rider", 22: "rider", 23: "road", 24: "road", 25: "terrain", 26: "terrain", 27: "sky",
    29: "terrain", 30: "vegetation", 36: "road", 41: "road", 43: "road", 44: "pole", 45: "pole", 46: "pole", 47: "pole",
    48: "traffic light", 49: "traffic sign", 50: "traffic sign", 52: "bicycle", 54: "bus", 55: "car", 56: "truck",
    57: "motorcycle", 58: "train", 59: "car", 60: "truck", 61: "truck",
}  # fmt: skip
CARLA: dict[int, str] = {
    1: "road", 2: "sidewalk", 3: "building", 4: "wall", 5: "fence", 6: "pole", 7: "traffic light", 8: "traffic sign",
    9: "vegetation", 10: "terrain", 11: "sky", 12: "person", 13: "rider", 14: "car", 15: "truck", 16: "bus", 17: "train",
    18: "motorcycle", 19: "bicycle", 24: "road", 25: "terrain", 26: "building", 27: "road", 28: "fence",
}  # fmt: skip
COCO: dict[int, str] = {
    0: "person", 1: "bicycle", 2: "car", 3: "motorcycle", 5: "bus", 6: "train", 7: "truck", 9: "traffic light",
    11: "traffic sign",
}  # fmt: skip
VOC: dict[int, str] = {2: "bicycle", 6: "bus", 7: "car", 14: "motorcycle", 15: "person", 19: "train"}
WAYMO: dict[int, str] = {
    2: "car", 3: "truck", 4: "bus", 5: "truck", 6: "bicycle", 7: "motorcycle", 8: "truck", 9: "person", 10: "rider",
    11: "rider", 15: "pole", 17: "traffic sign", 18: "traffic light", 19: "building", 20: "road", 21: "road", 22: "road",
    23: "sidewalk", 24: "vegetation", 25: "sky", 26: "terrain",
}  # fmt: skip

ORDERS: dict[str, tuple[int, dict[int, str]]] = {
    "cityscapes": (19, dict(enumerate(CITYSCAPES))),
    "cityscapes-ids": (LABEL_ID_COUNT, LABEL_IDS | KITTI360_IDS),
    "ade20k": (150, ADE20K),
    "ade20k-from-1": (151, {number + 1: name for number, name in ADE20K.items()}),
    "mapillary": (66, MAPILLARY),
    "carla": (29, CARLA),
    "coco": (80, COCO),
    "voc": (21, VOC),
    "waymo": (29, WAYMO),
    "waymo-28": (28, {number - 1: name for number, name in WAYMO.items()}),
}
"""Number of classes, and the Cityscapes class by number of those that are one, by the order's name. "waymo-28" leaves Waymo's
class 0, undefined, out. Classes that are not listed are void, as animals and furniture."""


def order_targets(order: str) -> NDArray[np.uint8]:
    """(C,) trainIds of the classes of one of :data:`ORDERS`, 255 void."""
    return targets_by_number(*ORDERS[order])


def targets_by_number(count: int, names: Mapping[int, str]) -> NDArray[np.uint8]:
    """(C,) trainIds of so many classes, of which some are called as Cityscapes calls them; 255 void of the others."""
    found = np.full(count, VOID, dtype=np.uint8)
    for number, name in names.items():
        found[number] = train_id(name)
    return found

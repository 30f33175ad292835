"""From the classes of segmentation networks to Cityscapes: by name, or by the order of a public dataset.

Orders: Cityscapes trainIds and labelIds; ADE20K's 150 classes (SceneParse150); the 80 of COCO's detectors; PASCAL VOC's 21; Waymo's
camera segmentation (``protos/camera_segmentation.proto``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.cityscapes import CITYSCAPES, LABEL_IDS, VOID, train_id
from unveil_core.semantics.classes import REMOVABLE

__all__ = ["BY_COUNT", "ORDERS", "known_name", "order_targets", "removable", "targets_of"]

SYNONYMS: dict[str, str] = {
    "street": "road", "lane marker": "road", "lane marking": "road", "road marker": "road", "road marking": "road",
    "pavement": "sidewalk", "footpath": "sidewalk", "house": "building", "skyscraper": "building",
    "hovel": "building", "tower": "building", "bridge": "building", "guard rail": "fence", "railing": "fence",
    "streetlight": "pole", "street light": "pole", "pole group": "pole", "polegroup": "pole", "stop sign": "traffic sign",
    "sign": "traffic sign", "signboard": "traffic sign", "tree": "vegetation", "plant": "vegetation",
    "palm": "vegetation", "flower": "vegetation", "bush": "vegetation", "grass": "terrain", "earth": "terrain",
    "field": "terrain", "sand": "terrain", "land": "terrain", "ground": "terrain", "hill": "terrain",
    "dirt track": "terrain", "path": "sidewalk", "pedestrian": "person", "human": "person", "people": "person",
    "cyclist": "rider", "bicyclist": "rider", "motorcyclist": "rider", "vehicle": "car", "van": "car",
    "pickup": "car", "pickup truck": "car", "pick up truck": "car", "lorry": "truck", "trailer": "truck", "caravan": "truck",
    "other large vehicle": "truck", "tram": "train", "minibike": "motorcycle", "motorbike": "motorcycle",
    "motor": "motorcycle", "scooter": "motorcycle", "bike": "bicycle",
}  # fmt: skip
"""Names of classes that mean a Cityscapes class."""

ADE20K: dict[int, str] = {
    0: "wall", 1: "building", 2: "sky", 4: "vegetation", 6: "road", 9: "terrain", 11: "sidewalk", 12: "person",
    13: "terrain", 17: "vegetation", 20: "car", 25: "building", 29: "terrain", 32: "fence", 38: "fence",
    43: "traffic sign", 46: "terrain", 48: "building", 52: "sidewalk", 54: "road", 61: "building", 66: "vegetation",
    68: "terrain", 72: "vegetation", 79: "building", 80: "bus", 83: "truck", 84: "building", 87: "pole",
    91: "terrain", 93: "pole", 94: "terrain", 102: "car", 116: "motorcycle", 127: "bicycle", 136: "traffic light",
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
    "cityscapes-ids": (34, LABEL_IDS),
    "ade20k": (150, ADE20K),
    "coco": (80, COCO),
    "voc": (21, VOC),
    "waymo": (29, WAYMO),
    "waymo-28": (28, {number - 1: name for number, name in WAYMO.items()}),
}
"""Number of classes, and the Cityscapes class by number of those that are one, by the order's name. "waymo-28" leaves Waymo's
class 0, undefined, out. Classes that are not listed are void, as animals and furniture."""
BY_COUNT: dict[int, str] = {count: name for name, (count, _) in ORDERS.items() if name != "cityscapes-ids"}
"""The order that is taken where nothing names the classes."""


def known_name(name: str) -> str | None:
    """The Cityscapes class that a name means, None where it means none. Case, ``_`` and ``-`` do not matter."""
    plain = " ".join(name.lower().replace("_", " ").replace("-", " ").split())
    found = SYNONYMS.get(plain, plain)
    return found if found in CITYSCAPES else None


def targets_of(names: Sequence[str]) -> NDArray[np.uint8]:
    """(C,) trainIds of C class names, 255 for those that mean no Cityscapes class."""
    return np.array([train_id(known_name(name)) for name in names], dtype=np.uint8)


def order_targets(order: str) -> NDArray[np.uint8]:
    """(C,) trainIds of the classes of one of :data:`ORDERS`, 255 void."""
    count, names = ORDERS[order]
    found = np.full(count, VOID, dtype=np.uint8)
    for number, name in names.items():
        found[number] = train_id(name)
    return found


def removable(targets: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(C,) which of the trainIds are of classes that are removed by default."""
    return np.isin(targets, [train_id(name) for name in REMOVABLE])

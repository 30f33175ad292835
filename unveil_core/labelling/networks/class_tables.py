"""From the classes of segmentation networks to Cityscapes: by name, or by the order of a public dataset.

The numbers of the data sets' classes are in ``drives.labels.orders``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.cityscapes import CITYSCAPES, LABEL_IDS, train_id
from unveil_core.drives.labels.orders import ORDERS as LABEL_ORDERS
from unveil_core.drives.labels.orders import targets_by_number
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

ORDERS: dict[str, tuple[int, dict[int, str]]] = {
    name: (34, LABEL_IDS) if name == "cityscapes-ids" else LABEL_ORDERS[name]
    for name in ("cityscapes", "cityscapes-ids", "ade20k", "coco", "voc", "waymo", "waymo-28")
}
"""Of label pictures those that networks have, see ``drives.labels.orders``; of labelIds Cityscapes' own."""
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
    return targets_by_number(*ORDERS[order])


def removable(targets: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(C,) which of the trainIds are of classes that are removed by default."""
    return np.isin(targets, [train_id(name) for name in REMOVABLE])

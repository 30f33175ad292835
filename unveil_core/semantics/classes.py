"""Cityscapes classes, the groups that the command line knows, and the compact label set of one scene."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SelectionError
from unveil_core.drives.cityscapes import CITYSCAPES, VOID

__all__ = [
    "CITYSCAPES",
    "COLORS",
    "GROUND_CLASSES",
    "GROUPS",
    "REMOVABLE",
    "SIDE_CLASSES",
    "SLIM_CLASSES",
    "SOLID_CLASSES",
    "THIN_CLASSES",
    "VOID",
    "LabelSet",
    "expand_names",
]

COLORS: tuple[tuple[int, int, int], ...] = (
    (128, 64, 128), (244, 35, 232), (70, 70, 70), (102, 102, 156), (190, 153, 153), (153, 153, 153), (250, 170, 30),
    (220, 220, 0), (107, 142, 35), (152, 251, 152), (70, 130, 180), (220, 20, 60), (255, 0, 0), (0, 0, 142),
    (0, 0, 70), (0, 60, 100), (0, 80, 100), (0, 0, 230), (119, 11, 32),
)  # fmt: skip
"""The colours that the field draws these classes in (sRGB)."""

REMOVABLE: tuple[str, ...] = ("person", "rider", "car", "truck", "bus", "train", "motorcycle", "bicycle")
GROUPS: dict[str, tuple[str, ...]] = {
    "vehicle": ("car", "truck", "bus", "train", "motorcycle", "bicycle"),
    "human": ("person", "rider"),
    "dynamic": REMOVABLE,
}

GROUND_CLASSES = ("road", "sidewalk", "terrain")
"""The ground: what objects stand on."""
SIDE_CLASSES = ("building", "wall", "fence")
"""Surfaces that bound the ground beside the street."""
SOLID_CLASSES = ("building", "wall")
"""Surfaces that reach down to the ground and are opaque, though cars may hide their foot."""
THIN_CLASSES = ("pole", "traffic light", "traffic sign")
"""Objects so thin that labels and depth do not register there: no evidence for or against motion."""
SLIM_CLASSES = ("person", "rider", "motorcycle", "bicycle")
"""Objects about half a metre wide, in contrast to vehicles."""


def expand_names(names: Iterable[str], known: Iterable[str] = CITYSCAPES) -> tuple[str, ...]:
    """Expand groups and check names, in the order of ``known``; ``remove`` stands for itself in masks-only scenes.

    Raises:
        SelectionError: a name is neither a class nor a group.
    """
    known = tuple(known)
    chosen: set[str] = set()
    for raw in names:
        name = raw.strip().lower()
        if name in GROUPS:
            chosen.update(GROUPS[name])
        elif name in CITYSCAPES or name in known:
            chosen.add(name)
        else:
            raise SelectionError(
                f"Not a class: {raw!r}", mend=f"use Cityscapes names or the groups {', '.join(GROUPS)}"
            )
    return tuple(name for name in dict.fromkeys((*CITYSCAPES, *known)) if name in chosen)


@dataclass(frozen=True)
class LabelSet:
    """The labels that occur in one scene, compact: surfel label k means ``names[k]``.

    Attributes:
        names: K names; Cityscapes names, or ("keep", "remove") in a masks-only scene.
        disk_ids: K values that stand for them in the label images of the workspace (trainIds, or 0 and 1).
    """

    names: tuple[str, ...]
    disk_ids: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int | None:
        """The compact label of ``name``, or None where the scene has none."""
        return self.names.index(name) if name in self.names else None

    def indices(self, names: Collection[str]) -> tuple[int, ...]:
        """The compact labels of those of the ``names`` that the scene has."""
        return tuple(k for k, name in enumerate(self.names) if name in names)

    def compact(self, image: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Map a label image of disk ids (H, W) to compact labels (H, W) int64, -1 for void or anything else."""
        table = np.full(256, -1, dtype=np.int64)
        for k, disk_id in enumerate(self.disk_ids):
            table[disk_id] = k
        return table[image]

    @staticmethod
    def cityscapes(present: Iterable[int]) -> LabelSet:
        """The label set of the trainIds that occur."""
        ids = tuple(sorted(int(i) for i in set(present) if 0 <= int(i) < len(CITYSCAPES)))
        return LabelSet(tuple(CITYSCAPES[i] for i in ids), ids)

    @staticmethod
    def keep_remove() -> LabelSet:
        """The two labels of a scene that knows only masks or boxes."""
        return LabelSet(("keep", "remove"), (0, 1))

"""The labels of one drive: which classes occur, what is to be removed, and the label image of each frame.

A drive brings Cityscapes semantics, or nothing but masks of what to remove; the second kind of scene has the two labels
*keep* and *remove*. A drive that brings neither is all *keep*; what is removed is marked by hand, see ``drives.marked``.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError, SelectionError
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.labels.codes import BLACK, WHITE
from unveil_core.drives.labels.reading import instances_of, mask_of, semantics_of
from unveil_core.semantics.classes import REMOVABLE, LabelSet, expand_names

__all__ = [
    "SceneLabels",
    "choose_labels",
    "find_labels",
    "frame_instances",
    "frame_labels",
    "has_labels",
    "labels_of_frames",
]


_T = TypeVar("_T", str, int)


@dataclass(frozen=True)
class SceneLabels:
    """The labels of a scene, and which of them are removed.

    Attributes:
        labels: the compact label set.
        source: "semantics", "masks" or "nothing".
        removed: names of the classes that are removed whole; may be empty when single instances are chosen.
        instances: ids of single objects that are removed.
        pixel_counts: pixels per label over the drive, as many as labels.
    """

    labels: LabelSet
    source: str
    removed: tuple[str, ...]
    instances: tuple[int, ...]
    pixel_counts: tuple[int, ...]

    @property
    def removed_labels(self) -> tuple[int, ...]:
        """Compact labels of :attr:`removed`."""
        return self.labels.indices(self.removed)

    @property
    def removable_labels(self) -> tuple[int, ...]:
        """Compact labels of everything that could be removed: the default classes and what is removed here."""
        known = {*REMOVABLE, "remove", *self.removed}
        return self.labels.indices(known)

    def to_json(self) -> dict[str, object]:
        """A JSON-able dict, for labels.json and selection.json together."""
        return {**self.labels_json(), **self.selection_json()}

    def labels_json(self) -> dict[str, object]:
        """The part that does not depend on what was chosen: the scene need not be made anew for another choice."""
        return {
            "names": list(self.labels.names),
            "disk_ids": list(self.labels.disk_ids),
            "source": self.source,
            "pixel_counts": list(self.pixel_counts),
        }

    def selection_json(self) -> dict[str, object]:
        """What was chosen."""
        return {"removed": list(self.removed), "instances": list(self.instances)}

    @staticmethod
    def from_json(data: dict) -> SceneLabels:  # type: ignore[type-arg]
        """Inverse of :meth:`to_json`; what is not of that form raises a KeyError, TypeError or ValueError."""
        names, removed = (_list_of(data[key], str, key) for key in ("names", "removed"))
        ids, instances, counts = (_list_of(data[key], int, key) for key in ("disk_ids", "instances", "pixel_counts"))
        if not len(names) == len(set(names)) == len(ids) == len(counts):
            raise ValueError(f"{len(names)} names, {len(ids)} disk_ids and {len(counts)} pixel_counts")
        if not all(0 <= i < 256 for i in ids) or min(counts, default=0) < 0:
            raise ValueError("disk_ids are 0 to 255, pixel_counts not below 0")
        return SceneLabels(LabelSet(names, ids), str(data["source"]), removed, instances, counts)


def _list_of(values: object, kind: type[_T], key: str) -> tuple[_T, ...]:
    """The checked values of a list of a JSON file."""
    if not isinstance(values, list) or not all(type(v) is kind for v in values):
        raise ValueError(f"not a list of {kind.__name__}: {key}")
    return tuple(values)


def find_labels(drive: Drive) -> SceneLabels:
    """Which labels occur in a drive, with everything removable chosen; ``removed`` is empty where nothing is.

    Raises:
        DriveError: some frames lack semantics that others have.
    """
    with_semantics = [f for f in drive.frames if f.semantic_path is not None]
    if with_semantics and len(with_semantics) < len(drive.frames):
        first = next(f for f in drive.frames if f.semantic_path is None)
        raise DriveError("has no semantic_path while other frames do", path=first.image_path, mend="add it or drop all")
    if with_semantics:
        counts = np.zeros(256, dtype=np.int64)
        for frame in with_semantics:
            counts += np.bincount(semantics_of(frame).ravel(), minlength=256)
        labels = LabelSet.cityscapes(np.flatnonzero(counts[:19]))
        pixel_counts = tuple(int(counts[i]) for i in labels.disk_ids)
        default = tuple(n for n in REMOVABLE if n in labels.names)
        return SceneLabels(labels, "semantics", default, (), pixel_counts)
    masked = [f for f in drive.frames if f.mask_path is not None]
    removed_pixels = kept = 0
    for frame in masked:
        gone = mask_of(frame)
        removed_pixels += int(gone.sum())
        kept += int(gone.size - gone.sum())
    if not masked:
        kept = sum(f.camera.width * f.camera.height for f in drive.frames)
    removed = ("remove",) if removed_pixels else ()
    source = "masks" if masked else "nothing"
    return SceneLabels(LabelSet.keep_remove(), source, removed, (), (kept, removed_pixels))


def has_labels(drive: Drive) -> bool:
    """Whether anything but a person's marks tells what could be removed."""
    return any(f.semantic_path is not None or f.mask_path is not None for f in drive.frames)


def choose_labels(
    drive: Drive, remove: Sequence[str] = (), instances: Sequence[int] = (), *, known: Collection[int] | None = None
) -> SceneLabels:
    """Find which labels occur in a drive and resolve what the user wants removed.

    Args:
        drive: with semantics on all frames, masks on some, or neither when instances are chosen.
        remove: class names and groups as typed; empty = every removable class that occurs, or the masks.
        instances: ids of single objects.
        known: all ids that there are; None = those in the drive's instance images, unchecked where it has none.
    Raises:
        DriveError: neither semantics nor masks, and no instance chosen.
        SelectionError: the selection is empty.
    """
    scene = find_labels(drive)
    if scene.source == "nothing" and not instances:
        raise DriveError(
            "the drive has neither semantics nor masks",
            path=drive.root,
            mend="give --labels or --segmenter, add masks, or mark objects and choose them: unveil mask outlines what is clicked",
        )
    wanted = expand_names(remove, scene.labels.names) if remove else (() if instances else scene.removed)
    if scene.source == "masks" and (remove or not instances):
        wanted = ("remove",)  # masks carry no class: whatever name was typed, the masked pixels are meant
    counts = dict(zip(scene.labels.names, scene.pixel_counts, strict=True))
    chosen = tuple(n for n in wanted if counts.get(n, 0) > 0)
    if instances:
        _check_instances(drive, instances, known)
    elif not chosen and scene.source == "masks":
        removes = drive.frames[0].codes.mask.removes
        mend = f"--mask-removes {WHITE if removes == BLACK else BLACK} turns them round"
        raise SelectionError(f"nothing to remove: no mask has anything {removes}, which is what is removed", mend=mend)
    elif not chosen:
        asked = ", ".join(remove) if remove else ", ".join(REMOVABLE)
        found = ", ".join(n for n, c in counts.items() if c) or "nothing"
        raise SelectionError(f"nothing to remove: the drive has no {asked}; found: {found}")
    return replace(scene, removed=chosen, instances=tuple(instances))


def _check_instances(drive: Drive, instances: Sequence[int], known: Collection[int] | None) -> None:
    if known is None:
        mapped = [f for f in drive.frames if f.instance_path is not None]
        if not mapped:  # the objects of such a drive are found after its import
            return
        known = {int(i) for frame in mapped for i in np.unique(instances_of(frame)) if i}
    missing = [i for i in instances if i not in known]
    if missing:
        listed = ", ".join(str(i) for i in sorted(known)) or "none"
        raise SelectionError(f"nothing to remove: the drive has no instance {missing[0]}; found: {listed}")


def frame_labels(frame: Frame, scene: SceneLabels) -> NDArray[np.int64]:
    """(H, W) compact labels of a frame, -1 where unknown (void, or a frame without a mask)."""
    if scene.source == "semantics":
        return scene.labels.compact(semantics_of(frame))
    if scene.source == "nothing":
        return np.zeros((frame.camera.height, frame.camera.width), dtype=np.int64)
    if frame.mask_path is None:
        return np.full((frame.camera.height, frame.camera.width), -1, dtype=np.int64)
    return mask_of(frame).astype(np.int64)


def labels_of_frames(frames: Sequence[Frame], scene: SceneLabels, cache: FrameCache) -> Sequence[NDArray[np.int64]]:
    """:func:`frame_labels` of all frames, held in a quarter of their size."""
    small = cache.frames(len(frames), lambda i: frame_labels(frames[i], scene).astype(np.int16))
    return Frames(len(frames), lambda i: small[i].astype(np.int64))


def frame_instances(frame: Frame) -> NDArray[np.int64] | None:
    """(H, W) instance ids of a frame, 0 = none; None where the drive has no instance image for it."""
    if frame.instance_path is None:
        return None
    return instances_of(frame).astype(np.int64)

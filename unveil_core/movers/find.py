"""The dynamic objects of a drive: a list, their pixels in every frame, their shadows, and the points that lie on them.

Where the drive has tracks of boxes, these decide. Otherwise an object is dynamic if other frames see through the place where a
frame shows it on the ground (``seen_through``), or if the ground contacts of one instance id wander. All others are static.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, instants
from unveil_core.geometry.images import border_px
from unveil_core.ground.from_points import find_ground
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.boxes import box_pixels, moving_boxes, points_in_boxes
from unveil_core.movers.contacts import find_contacts
from unveil_core.movers.points import points_along_track, points_behind_contacts
from unveil_core.movers.seen_through import MASKED, SLIM, WIDE, Body, FrameVisibility, frame_visibility, probe_points
from unveil_core.movers.shadows import mover_shadow
from unveil_core.movers.tracks import Patch, find_patches, instance_moves, link_patches
from unveil_core.semantics.classes import GROUND_CLASSES, REMOVABLE, SLIM_CLASSES, THIN_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels

__all__ = ["FoundMovers", "Mover", "find_movers"]


@dataclass(frozen=True)
class Mover:
    """One dynamic object.

    Attributes:
        number: 1, 2, … within the drive; its value in the mask images.
        class_name: of its label.
        evidence: "boxes", "seen through" or "drift".
        source: its id in the drive's boxes or instance images, 0 where it has none.
        frames: (camera name, frame name) of those that show it, in the drive's order.
    """

    number: int
    class_name: str
    evidence: str
    source: int
    frames: tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class FoundMovers:
    """The dynamic objects of a drive.

    Attributes:
        movers: the list.
        numbers: (H, W) uint16 per frame, the dynamic object that a pixel shows, 0 = none.
        shadows: (H, W) bool per frame, ground in the shadow of one.
        on_mover: (P,) bool, of the drive's points.
    """

    movers: tuple[Mover, ...]
    numbers: tuple[NDArray[np.uint16], ...]
    shadows: tuple[Mask, ...]
    on_mover: Mask


class _Search:
    """State of the search for dynamic objects in a drive."""

    def __init__(self, drive: Drive, scene: SceneLabels) -> None:
        self.drive, self.names = drive, scene.labels.names
        self.labels = [frame_labels(f, scene).astype(np.int8) for f in drive.frames]
        known = {*REMOVABLE, "remove"}
        self.removable = tuple(k for k, n in enumerate(self.names) if n in known)
        ground = tuple(k for k, n in enumerate(self.names) if n in GROUND_CLASSES)
        # Without classes all that is not to be removed may be ground.
        self.below_labels = ground or tuple(k for k, n in enumerate(self.names) if n == "keep")
        self.behind_labels = (*self.below_labels, *(k for k, n in enumerate(self.names) if n == "sky"))
        self.ground: HeightField | None = None
        if any(np.isin(label, self.removable).any() for label in self.labels):
            self.ground = find_ground(drive, self.labels, ground, self.removable)
        self.numbers = [np.zeros(label.shape, np.uint16) for label in self.labels]
        self.movers: list[tuple[str, str, int]] = []
        """(class, evidence, source), the first has number 1."""

    def body(self, label: int) -> Body:
        if self.names[label] == "remove":
            return MASKED
        return SLIM if self.names[label] in SLIM_CLASSES else WIDE

    def below(self, frame: int) -> Mask:
        return np.isin(self.labels[frame], self.below_labels)

    def visibility(self) -> list[FrameVisibility]:
        return [
            frame_visibility(f.camera, np.isin(label, self.behind_labels), np.isin(label, self.removable))
            for f, label in zip(self.drive.frames, self.labels, strict=True)
        ]

    def add(self, class_name: str, evidence: str, source: int) -> int:
        self.movers.append((class_name, evidence, source))
        return len(self.movers)


def find_movers(drive: Drive, scene: SceneLabels, progress: Progress = no_progress) -> FoundMovers | None:
    """The dynamic objects of a drive, None where there are none.

    Args:
        drive: an imported drive; scene: its labels.
        progress: called per frame.
    Raises:
        DriveError: a box of an unknown class.
    """
    search = _Search(drive, scene)
    boxed = _by_boxes(search)
    if search.ground is not None:
        visibility = search.visibility()
        instances = [frame_instances(f) for f in drive.frames]
        for owner, ids in zip(boxed, instances, strict=True):
            if ids is not None:
                ids[owner > 0] = 0
        _by_instances(search, instances, visibility)
        _by_patches(search, [i is not None for i in instances], boxed, visibility, progress)
    if not search.movers:
        return None
    numbers = tuple(search.numbers)
    shown = [np.unique(n) for n in numbers]
    movers = tuple(
        Mover(
            k + 1,
            name,
            evidence,
            source,
            tuple((f.camera_name, f.name) for f, n in zip(drive.frames, shown, strict=True) if k + 1 in n),
        )
        for k, (name, evidence, source) in enumerate(search.movers)
    )
    return FoundMovers(movers, numbers, _shadows(search), _points(search))


def _by_boxes(search: _Search) -> list[NDArray[np.int64]]:
    """Mark the pixels of moving boxes; returns (H, W) per frame the id of the box that each pixel belongs to, 0 = none."""
    moved, _ = moving_boxes(search.drive)
    number = {source: search.add(name, "boxes", source) for source, name in sorted(moved.items())}
    owners = []
    for v, frame in enumerate(search.drive.frames):
        owner = np.zeros(search.labels[v].shape, np.int64)
        if frame.boxes:
            owner = box_pixels(frame, search.labels[v], search.removable, frame_instances(frame))
        for source, k in number.items():
            search.numbers[v][owner == source] = k
        owners.append(owner)
    return owners


def _by_instances(
    search: _Search, instances: list[NDArray[np.int64] | None], visibility: list[FrameVisibility]
) -> None:
    assert search.ground is not None
    frames: dict[int, list[int]] = {}
    for v, ids in enumerate(instances):
        if ids is not None:
            ids[~np.isin(search.labels[v], search.removable)] = 0
            for source in np.unique(ids):
                if source:
                    frames.setdefault(int(source), []).append(v)
    below = [search.below(v) for v in range(len(visibility))]
    nothing = [np.zeros_like(b) for b in below]
    for source in sorted(frames):
        masks: list[Mask | None] = [None] * len(visibility)
        counts = np.zeros(len(search.names), np.int64)
        for v in frames[source]:
            image = instances[v]
            assert image is not None
            mask = image == source
            masks[v] = mask
            counts += np.bincount(search.labels[v][mask], minlength=len(search.names))
        own_visibility = [
            FrameVisibility(s.camera, s.open, n if m is None else m)
            for s, m, n in zip(visibility, masks, nothing, strict=True)
        ]
        label = int(counts.argmax())
        evidence = instance_moves(masks, below, own_visibility, search.body(label), search.ground)
        if evidence is not None:
            number = search.add(search.names[label], evidence, source)
            for v in frames[source]:
                search.numbers[v][instances[v] == source] = number


def _by_patches(
    search: _Search,
    with_ids: list[bool],
    boxed: list[NDArray[np.int64]],
    visibility: list[FrameVisibility],
    progress: Progress,
) -> None:
    """Objects without ids, frame by frame; ``with_ids``: which frames have instance images."""
    assert search.ground is not None
    wanted = {k: search.body(k) for k in search.removable}
    patches: dict[int, list[Patch]] = {}
    for v, frame in enumerate(search.drive.frames):
        if not with_ids[v]:
            label = np.where(boxed[v] > 0, -1, search.labels[v]).astype(np.int8)
            patches[v] = find_patches(v, label, wanted, search.below(v), visibility, search.ground)
        progress(v + 1, len(with_ids), f"looking for what moves, {frame.name}")
    cameras = list(dict.fromkeys(f.camera_name for f in search.drive.frames))
    tracks = [[v for v, f in enumerate(search.drive.frames) if f.camera_name == c] for c in cameras]
    link_patches(tracks, patches)
    moving = [p for v in sorted(patches) for p in patches[v] if p.number]
    name_of = {p.number: search.names[p.label] for p in reversed(moving)}
    number = {n: search.add(name_of[n], "seen through", 0) for n in dict.fromkeys(p.number for p in moving)}
    for patch in moving:
        search.numbers[patch.frame][patch.mask] = number[patch.number]


def _shadows(search: _Search) -> tuple[Mask, ...]:
    frames = search.drive.frames
    if search.ground is None:
        return tuple(np.zeros(n.shape, dtype=bool) for n in search.numbers)
    grays: dict[int, NDArray[np.float32]] = {}
    plains: dict[int, Mask] = {}

    def gray(v: int) -> NDArray[np.float32]:
        if v not in grays:
            flat = cv2.cvtColor(read_image(frames[v].image_path), cv2.COLOR_RGB2GRAY)
            grays[v] = cv2.GaussianBlur(flat, (0, 0), 0.8).astype(np.float32)
        return grays[v]

    def plain(v: int) -> Mask:
        if v not in plains:
            side = 2 * border_px(frames[v].camera.width) + 1
            shown = cv2.dilate((search.numbers[v] > 0).astype(np.uint8), np.ones((side, side), np.uint8)).astype(bool)
            plains[v] = search.below(v) & ~shown
        return plains[v]

    cameras = [f.camera for f in frames]
    times = instants(frames)
    found = []
    for v, numbers in enumerate(search.numbers):
        by_time = [int(k) for k in np.argsort(np.abs(times - times[v]), kind="stable") if k != v]
        own = [k for k in by_time if frames[k].camera_name == frames[v].camera_name]
        foreign = [k for k in by_time if frames[k].camera_name != frames[v].camera_name]
        found.append(mover_shadow(v, numbers > 0, cameras, own, foreign, gray, plain, search.ground))
    return tuple(found)


def _points(search: _Search) -> Mask:
    points = search.drive.points.positions
    boxes = [source for _, evidence, source in search.movers if evidence == "boxes"]
    found = points_in_boxes(search.drive.points, search.drive, boxes)
    ground = search.ground
    if ground is None:
        return found
    thin = tuple(k for k, n in enumerate(search.names) if n in THIN_CLASSES)
    upright = (*search.removable, *thin)
    visibility = [
        frame_visibility(f.camera, np.isin(label, search.behind_labels) & (n == 0), np.isin(label, upright) & (n == 0))
        for f, label, n in zip(search.drive.frames, search.labels, search.numbers, strict=True)
    ]
    in_time = np.argsort(instants(search.drive.frames), kind="stable")
    for k, (name, evidence, _) in enumerate(search.movers):
        if evidence == "boxes":
            continue
        body = search.body(search.names.index(name))
        track, heights = [], []
        for v in in_time:
            frame, mask = search.drive.frames[v], search.numbers[v] == k + 1
            if mask.any():
                contacts = find_contacts(mask, search.below(v), frame.camera, ground)
                found |= points_behind_contacts(points, mask, contacts, frame.camera, body, ground)
                if len(contacts) and np.median(contacts.error) < 2 * body.error_m:
                    # Of its places the second lies about in its middle.
                    middle = probe_points(contacts, frame.camera, replace(body, heights_m=(0.0,)), ground)[:, 1]
                    track.append(np.median(middle, axis=0))
                    heights.append(float(np.median(contacts.height)))
        if len(track) > 1:
            found |= points_along_track(points, np.array(track), max(heights), visibility, body, ground)
    return found

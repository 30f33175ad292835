"""The dynamic objects of a drive: a list, their pixels in every frame, their shadows, and the points that lie on them.

Where the drive has tracks of boxes, these decide. Otherwise an object is dynamic if other frames see through the place where a
frame shows it on the ground (``seen_through``), or if the ground contacts of one instance id wander. All others are static.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint, Kept
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, instants
from unveil_core.geometry.grid import PointGrid
from unveil_core.geometry.images import border_px
from unveil_core.ground.from_points import find_ground
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.boxes import box_pixels, moving_boxes, points_in_boxes
from unveil_core.movers.contacts import find_contacts
from unveil_core.movers.pixel_set import PixelMasks, PixelSet
from unveil_core.movers.points import points_along_track, points_behind_contacts
from unveil_core.movers.seen_through import (
    MASKED,
    SLIM,
    WIDE,
    Body,
    DriveVisibility,
    FrameVisibility,
    frame_visibility,
    probe_points,
)
from unveil_core.movers.shadows import mover_shadow
from unveil_core.movers.tracks import (
    Patch,
    arrays_of_patches,
    find_patches,
    instance_moves,
    link_patches,
    patches_of_arrays,
)
from unveil_core.semantics.classes import GROUND_CLASSES, REMOVABLE, SLIM_CLASSES, THIN_CLASSES
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels

__all__ = ["FoundMovers", "Mover", "find_movers"]

MOST_NEAR = 192
"""Frames that are looked at for a shadow at most, the nearest in time: later the car is elsewhere."""


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
    numbers: Sequence[NDArray[np.uint16]]
    shadows: Sequence[Mask]
    on_mover: Mask


class MoverPixels:
    """The dynamic objects that pixels show, by frame; most frames show few, so only their pixels are kept.

    Args:
        shapes: (H, W) of each frame.
    """

    def __init__(self, shapes: Sequence[tuple[int, int]]) -> None:
        self._shapes = shapes
        self._pixels: dict[int, list[tuple[PixelSet, int]]] = {}

    def put(self, frame: int, pixels: PixelSet, number: int) -> None:
        """Pixels show an object from now on."""
        self._pixels.setdefault(frame, []).append((pixels, number))

    def image(self, frame: int) -> NDArray[np.uint16]:
        """(H, W) numbers, 0 = none."""
        image = np.zeros(self._shapes[frame], np.uint16)
        for pixels, number in self._pixels.get(frame, ()):
            pixels.write(image, number)
        return image

    def frames(self) -> dict[int, list[int]]:
        """By number, the frames that show an object, rising."""
        found: dict[int, list[int]] = {}
        for v in sorted(self._pixels):
            for number in np.unique(self.image(v)):
                if number:
                    found.setdefault(int(number), []).append(v)
        return found


class _Search:
    """State of the search for dynamic objects in a drive."""

    def __init__(self, drive: Drive, scene: SceneLabels, cache: FrameCache) -> None:
        self.drive, self.names, self.cache = drive, scene.labels.names, cache
        self.cameras = [f.camera for f in drive.frames]
        frames = drive.frames
        self.labels = cache.frames(len(frames), lambda v: frame_labels(frames[v], scene).astype(np.int8))
        known = {*REMOVABLE, "remove"}
        self.removable = tuple(k for k, n in enumerate(self.names) if n in known)
        ground = tuple(k for k, n in enumerate(self.names) if n in GROUND_CLASSES)
        # Without classes all that is not to be removed may be ground.
        self.below_labels = ground or tuple(k for k, n in enumerate(self.names) if n == "keep")
        self.behind_labels = (*self.below_labels, *(k for k, n in enumerate(self.names) if n == "sky"))
        self.ground: HeightField | None = None
        if any(np.isin(label, self.removable).any() for label in self.labels):
            self.ground = find_ground(drive, self.labels, ground, self.removable)
        self.numbers = MoverPixels([(c.height, c.width) for c in self.cameras])
        self.movers: list[tuple[str, str, int]] = []
        """(class, evidence, source), the first has number 1."""

    def body(self, label: int) -> Body:
        if self.names[label] == "remove":
            return MASKED
        return SLIM if self.names[label] in SLIM_CLASSES else WIDE

    def below(self, frame: int) -> Mask:
        return np.isin(self.labels[frame], self.below_labels)

    def visibility(self) -> DriveVisibility:
        def of_frame(v: int) -> FrameVisibility:
            label = self.labels[v]
            return frame_visibility(np.isin(label, self.behind_labels), np.isin(label, self.removable))

        return DriveVisibility(self.cameras, self.cache.frames(len(self.cameras), of_frame))

    def add(self, class_name: str, evidence: str, source: int) -> int:
        self.movers.append((class_name, evidence, source))
        return len(self.movers)


def find_movers(
    drive: Drive,
    scene: SceneLabels,
    progress: Progress = no_progress,
    cache: FrameCache | None = None,
    kept: Kept | None = None,
) -> FoundMovers | None:
    """The dynamic objects of a drive, None where there are none.

    Args:
        drive: an imported drive; scene: its labels.
        progress: called per frame.
        cache: room for the frames.
        kept: where an interrupted call leaves what the next one goes on from.
    Raises:
        DriveError: a box of an unknown class.
    """
    search, kept = _Search(drive, scene, cache or FrameCache()), kept or Kept()
    boxed = _by_boxes(search)
    if search.ground is not None:
        visibility = search.visibility()
        _by_instances(search, boxed, visibility, kept.checkpoint("evidence"), progress)
        _by_patches(search, boxed, visibility, kept.checkpoint("patches"), progress)
    if not search.movers:
        return None
    shown = search.numbers.frames()
    movers = tuple(
        Mover(
            k + 1,
            name,
            evidence,
            source,
            tuple((drive.frames[v].camera_name, drive.frames[v].name) for v in shown.get(k + 1, ())),
        )
        for k, (name, evidence, source) in enumerate(search.movers)
    )
    numbers = Frames(len(drive.frames), search.numbers.image)
    points = kept.once("points", lambda: {"on_mover": _points(search, shown)})
    return FoundMovers(movers, numbers, _shadows(search), points["on_mover"])


def _by_boxes(search: _Search) -> Sequence[NDArray[np.int64]]:
    """Mark the pixels of moving boxes; returns (H, W) per frame the id of the box that each pixel belongs to, 0 = none."""
    moved, _ = moving_boxes(search.drive)
    number = {source: search.add(name, "boxes", source) for source, name in sorted(moved.items())}
    frames = search.drive.frames

    def owner_of(v: int) -> NDArray[np.int64]:
        if not frames[v].boxes:
            return np.zeros((search.cameras[v].height, search.cameras[v].width), np.int64)
        return box_pixels(frames[v], search.labels[v], search.removable, frame_instances(frames[v]))

    owners = search.cache.frames(len(frames), owner_of)
    for v, frame in enumerate(frames):
        for source in sorted({b.id for b in frame.boxes} & number.keys()):
            if (mask := owners[v] == source).any():
                search.numbers.put(v, PixelSet.of(mask), number[source])
    return owners


def _by_instances(
    search: _Search,
    boxed: Sequence[NDArray[np.int64]],
    visibility: DriveVisibility,
    checkpoint: Checkpoint,
    progress: Progress,
) -> None:
    """Objects with ids in the instance images that no box has."""
    assert search.ground is not None
    frames, count = search.drive.frames, len(search.cameras)

    def ids_of(v: int) -> NDArray[np.uint16]:
        ids = frame_instances(frames[v])
        if ids is None:
            return np.zeros((search.cameras[v].height, search.cameras[v].width), np.uint16)
        return np.where((boxed[v] > 0) | ~np.isin(search.labels[v], search.removable), 0, ids).astype(np.uint16)

    instances = search.cache.frames(count, ids_of)
    shown: dict[int, list[int]] = {}
    for v, frame in enumerate(frames):
        if frame.instance_path is not None:
            for source in np.unique(instances[v]):
                if source:
                    shown.setdefault(int(source), []).append(v)
    state = checkpoint.load()
    # By id: how it is known to move, or None.
    known: dict[str, str | None] = {} if state is None else state[1]["known"]
    for done, source in enumerate(sorted(shown)):
        pixels = {v: PixelSet.of(instances[v] == source) for v in shown[source]}
        masks = PixelMasks(pixels, [(c.height, c.width) for c in search.cameras])
        counts = np.zeros(len(search.names), np.int64)
        for v, mask in masks.items():
            counts += np.bincount(search.labels[v][mask], minlength=len(search.names))
        label = int(counts.argmax())
        if str(source) not in known:
            alone = DriveVisibility(search.cameras, _without_others(visibility.frames, masks))
            below, body = Frames(count, search.below), search.body(label)
            known[str(source)] = instance_moves(masks, below, alone, body, search.ground)
            if checkpoint.due():
                checkpoint.save({}, {"known": known})
        progress(done + 1, len(shown), "finding dynamic objects")
        evidence = known[str(source)]
        if evidence is not None:
            number = search.add(search.names[label], evidence, source)
            for v, of_frame in pixels.items():
                search.numbers.put(v, of_frame, number)


def _without_others(frames: Sequence[FrameVisibility], masks: Mapping[int, Mask]) -> Sequence[FrameVisibility]:
    """The visibility with the pixels (H, W) of one object alone as occupied, by the frames that show it."""

    def of_frame(v: int) -> FrameVisibility:
        view = frames[v]
        return FrameVisibility(view.open, masks[v] if v in masks else np.zeros_like(view.open))

    return Frames(len(frames), of_frame)


def _by_patches(
    search: _Search,
    boxed: Sequence[NDArray[np.int64]],
    visibility: DriveVisibility,
    checkpoint: Checkpoint,
    progress: Progress,
) -> None:
    """Objects without ids, frame by frame."""
    assert search.ground is not None
    wanted = {k: search.body(k) for k in search.removable}
    patches: dict[int, list[Patch]] = {}
    begun = 0
    if (state := checkpoint.load()) is not None:
        begun = state[1]["frames"]
        patches = {v: [] for v in state[1]["asked"]}
        for patch in patches_of_arrays(state[0]):
            patches[patch.frame].append(patch)
    for v, frame in enumerate(search.drive.frames[begun:], start=begun):
        if frame.instance_path is None:
            label = np.where(boxed[v] > 0, -1, search.labels[v]).astype(np.int8)
            patches[v] = find_patches(v, label, wanted, search.below(v), visibility, search.ground)
        if checkpoint.due():
            found = arrays_of_patches([p for of_frame in patches.values() for p in of_frame])
            checkpoint.save(found, {"frames": v + 1, "asked": list(patches)})
        progress(v + 1, len(search.cameras), f"finding dynamic objects, {frame.name}")
    cameras = list(dict.fromkeys(f.camera_name for f in search.drive.frames))
    tracks = [[v for v, f in enumerate(search.drive.frames) if f.camera_name == c] for c in cameras]
    link_patches(tracks, patches)
    moving = [p for v in sorted(patches) for p in patches[v] if p.number]
    name_of = {p.number: search.names[p.label] for p in reversed(moving)}
    number = {n: search.add(name_of[n], "seen through", 0) for n in dict.fromkeys(p.number for p in moving)}
    for patch in moving:
        search.numbers.put(patch.frame, patch.pixels, number[patch.number])


def _shadows(search: _Search) -> Sequence[Mask]:
    frames, ground = search.drive.frames, search.ground
    if ground is None:
        return Frames(len(frames), lambda v: np.zeros((search.cameras[v].height, search.cameras[v].width), dtype=bool))

    def gray(v: int) -> NDArray[np.uint8]:
        flat = cv2.cvtColor(read_image(frames[v].image_path), cv2.COLOR_RGB2GRAY)
        return cv2.GaussianBlur(flat, (0, 0), 0.8).astype(np.uint8)

    def plain(v: int) -> Mask:
        side = 2 * border_px(search.cameras[v].width) + 1
        shown = cv2.dilate((search.numbers.image(v) > 0).astype(np.uint8), np.ones((side, side), np.uint8))
        below: Mask = search.below(v) & ~shown.astype(bool)
        return below

    grays = search.cache.frames(len(frames), gray)
    plains = search.cache.frames(len(frames), plain)
    times = instants(frames)

    def shadow(v: int) -> Mask:
        by_time = [int(k) for k in np.argsort(np.abs(times - times[v]), kind="stable") if k != v][:MOST_NEAR]
        own = [k for k in by_time if frames[k].camera_name == frames[v].camera_name]
        foreign = [k for k in by_time if frames[k].camera_name != frames[v].camera_name]
        shown = search.numbers.image(v) > 0
        return mover_shadow(
            v, shown, search.cameras, own, foreign, lambda k: grays[k].astype(np.float32), plains.__getitem__, ground
        )

    return search.cache.frames(len(frames), shadow)


def _points(search: _Search, shown: Mapping[int, Sequence[int]]) -> Mask:
    """(P,) the drive's points on dynamic objects; ``shown``: the frames that show each."""
    points = search.drive.points.positions
    boxes = [source for _, evidence, source in search.movers if evidence == "boxes"]
    found = points_in_boxes(search.drive.points, search.drive, boxes)
    ground = search.ground
    if ground is None:
        return found
    thin = tuple(k for k, n in enumerate(search.names) if n in THIN_CLASSES)
    upright = (*search.removable, *thin)

    def static(v: int) -> FrameVisibility:
        label, still = search.labels[v], search.numbers.image(v) == 0
        return frame_visibility(np.isin(label, search.behind_labels) & still, np.isin(label, upright) & still)

    visibility = DriveVisibility(search.cameras, search.cache.frames(len(search.cameras), static))
    grid = PointGrid(points)
    turn = np.argsort(np.argsort(instants(search.drive.frames), kind="stable"))
    for k, (name, evidence, _) in enumerate(search.movers):
        if evidence == "boxes":
            continue
        body = search.body(search.names.index(name))
        track, heights = [], []
        for v in sorted(shown.get(k + 1, ()), key=lambda v: int(turn[v])):
            camera, mask = search.cameras[v], search.numbers.image(v) == k + 1
            contacts = find_contacts(mask, search.below(v), camera, ground)
            found[points_behind_contacts(points, grid, mask, contacts, camera, body, ground)] = True
            if len(contacts) and np.median(contacts.error) < 2 * body.error_m:
                # Of its places the second lies about in its middle.
                middle = probe_points(contacts, camera, replace(body, heights_m=(0.0,)), ground)[:, 1]
                track.append(np.median(middle, axis=0))
                heights.append(float(np.median(contacts.height)))
        if len(track) > 1:
            found[points_along_track(points, grid, np.array(track), max(heights), visibility, body, ground)] = True
    return found

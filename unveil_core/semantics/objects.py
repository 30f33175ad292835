"""The single objects of a drive, from its points, labels and instance images, before a scene is reconstructed.

Their ids are final: surfels are assigned to these objects later, so a choice made early stays valid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.errors import SelectionError
from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.boxes import TrackedBox, has_moved
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.marked import MarkedObject, matte
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.cloud import estimate_normals, thinned_to
from unveil_core.semantics.catalogue import Sighting, best_sighting, sightings_in_images, sightings_of_points
from unveil_core.semantics.instances import Box, cluster_points, fit_box, vote_instances
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels
from unveil_core.semantics.members import Members
from unveil_core.semantics.visibility import PointsInView, PointsNear
from unveil_core.semantics.votes import vote_labels

__all__ = ["ABOVE_GROUND_M", "FoundObjects", "SceneObject", "find_objects", "marked_box", "vote_mattes"]

MOST_POINTS = 300_000
"""Number of points of a drive that are labelled by votes, however long it is; if there are more, the others take the label of their
nearest labelled one. Each takes about a kilobyte: votes for 19 classes, and 13 neighbours while its normal is found."""
CLUSTER_M = 0.4
"""Points of removable classes nearer than this, metres, are one object where there are no instance images."""
ABOVE_GROUND_M = 0.1
"""Points lower than this over the floor of a marked box, metres, are the ground under the object."""


@dataclass(frozen=True, eq=False)
class SceneObject:
    """One object.

    Attributes:
        id: for ``--instances``.
        class_name: of the scene's labels, or as marked.
        source: "boxes" of the dataset, "images", "clusters", "box" or "mattes" by hand: where it comes from.
        box: the dataset's own, else around its points, None where it has none; in axes of ``geometry.axes.up_frame``.
        points: number of the drive's points on it.
        sightings: frames that show it, in the drive's order.
    """

    id: int
    class_name: str
    source: str
    box: Box | None
    points: int
    sightings: tuple[Sighting, ...]


@dataclass(frozen=True, eq=False)
class FoundObjects:
    """All objects of a drive, and class and object of its points.

    Attributes:
        objects: by id.
        point_labels: (P,) compact labels, -1 unknown.
        point_objects: (P,) ids, 0 = none.
    """

    objects: tuple[SceneObject, ...]
    point_labels: NDArray[np.int64]
    point_objects: NDArray[np.int64]


def marked_box(marked: TrackedBox, drive: Drive) -> Box:
    """A marked box in the drive's local coordinates and the axes of ``up_frame``.

    Its yaw counts from north, counterclockwise seen from above: from x, where z is up.
    """
    return _box(marked.to_local(drive.to_world))


def _box(tracked: TrackedBox) -> Box:
    """A box in local coordinates in the axes of ``up_frame``."""
    yaw = (tracked.yaw + np.pi / 2 + np.pi / 2) % np.pi - np.pi / 2
    return Box(tracked.centre, tracked.size, float(yaw))


def find_objects(
    drive: Drive,
    scene: SceneLabels,
    marked: Sequence[MarkedObject] = (),
    progress: Progress = no_progress,
    cache: FrameCache | None = None,
) -> FoundObjects:
    """Name the objects of a drive.

    Args:
        drive: an imported drive; scene: its labels.
        marked: objects by hand.
        progress: called per step.
        cache: room for the frames.
    Raises:
        SelectionError: a marked object has the id of another one.
        DriveError: a picture that cannot be read.
    """
    axes = up_frame(UP)
    positions = drive.points.positions
    some = thinned_to(positions, MOST_POINTS)
    cameras = [f.camera for f in drive.frames]
    normals, spacing = estimate_normals(positions[some], np.stack([c.centre for c in cameras]))
    placed = PointsNear(positions[some], spacing, normals)

    def seen_points(v: int) -> PointsInView:
        progress(v + 1, len(cameras), "seeing points")
        return placed.seen_by(cameras[v], near=NEAR_M)

    views: Sequence[PointsInView] = (cache or FrameCache()).frames(len(cameras), seen_points)
    sky = scene.labels.index("sky")

    def label_image(v: int) -> NDArray[np.int64]:
        label = frame_labels(drive.frames[v], scene)
        return label if sky is None else np.where(label == sky, -1, label)  # a point of the sky is no place

    labels, _ = vote_labels(len(some), views, label_image, len(scene.labels))
    removable = np.isin(labels, scene.removable_labels)
    images = Frames(len(cameras), lambda v: frame_instances(drive.frames[v]))
    ids = np.zeros(len(some), dtype=np.int64)
    by_image = any(f.instance_path is not None for f in drive.frames)
    if by_image:
        found_ids = vote_instances(
            positions[some][removable],
            spacing[removable],
            labels[removable],
            cameras,
            lambda v: images[v],
            near=NEAR_M,
        )
        sightings = sightings_in_images(images)
    else:
        found_ids = cluster_points(positions[some][removable], CLUSTER_M, minimum=20)
    ids[removable] = found_ids
    if not by_image:
        sightings = sightings_of_points(ids, views)
    all_labels, all_ids = labels, ids
    if len(some) < len(positions):
        nearest = cKDTree(positions[some]).query(positions)[1]
        all_labels, all_ids = labels[nearest], ids[nearest]
    classes = _image_classes(drive, scene, images) if by_image else {}
    boxes = tracked_boxes(drive, sightings) if by_image else {}
    members = Members(all_ids)
    found = [
        _object(
            drive,
            scene,
            number,
            "images" if by_image else "clusters",
            members[number],
            all_labels,
            seen,
            classes.get(number),
            axes,
            boxes.get(number),
        )
        for number, seen in sorted(sightings.items())
        # An object of which no pixel and no point has a class is none that could be chosen.
        if number in classes or (all_labels[members[number]] >= 0).any()
    ]
    sightings = {o.id: sightings[o.id] for o in found}
    all_ids[~np.isin(all_ids, list(sightings))] = 0
    taken = {o.id for o in found}
    for mark in marked:
        if mark.id in taken:
            raise SelectionError(
                f"the marked object {mark.id} has the id of another object", mend=f"use {max(taken) + 1} or more"
            )
        taken.add(mark.id)
        found.append(_marked(mark, drive, positions, some, views, axes))
    return FoundObjects(tuple(found), all_labels, all_ids)


def tracked_boxes(drive: Drive, sightings: Mapping[int, Sequence[Sighting]]) -> dict[int, Box]:
    """The dataset's boxes of those instance ids that are ids of boxes.

    An id is one if most of its sightings lie where the box of this id does: numbers of instances and tracks may be alike by
    chance. A static object has the median of its boxes, a moved one its box in the frame that shows it best.

    Args:
        drive: an imported drive.
        sightings: of each instance id.
    """
    of_frame = [{b.id: b for b in frame.boxes} for frame in drive.frames]
    found = {}
    for number, seen in sightings.items():
        there = [s for s in seen if _shows(s, of_frame[s.frame].get(number), drive)]
        if 2 * len(there) <= len(seen):
            continue
        boxes = [of_frame[s.frame][number] for s in there]
        best = of_frame[best_sighting(drive, there).frame][number]
        found[number] = _box(best if has_moved(boxes) else _median_box(boxes))
    return found


def _shows(sighting: Sighting, box: TrackedBox | None, drive: Drive) -> bool:
    """Whether the middle of a sighting lies where a box does."""
    if box is None:
        return False
    pixels, depth = drive.frames[sighting.frame].camera.project(box.corners())
    if (depth <= NEAR_M).any():  # beside the camera: the part before it may be anywhere at the picture's border
        return bool((depth > NEAR_M).any())
    x0, y0, x1, y1 = sighting.rectangle
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2])
    return bool((pixels.min(axis=0) <= middle).all() and (middle <= pixels.max(axis=0)).all())


def _median_box(boxes: Sequence[TrackedBox]) -> TrackedBox:
    """A static object's box; boxes that point forward and backward are the same."""
    x, y, z = (float(v) for v in np.median([b.centre for b in boxes], axis=0))
    length, width, height = (float(v) for v in np.median([b.size for b in boxes], axis=0))
    twice = 2 * np.array([b.yaw for b in boxes])
    yaw = float(np.arctan2(np.sin(twice).mean(), np.cos(twice).mean()) / 2)
    return replace(boxes[0], centre=(x, y, z), size=(length, width, height), yaw=yaw)


def _image_classes(drive: Drive, scene: SceneLabels, images: Sequence[NDArray[np.int64] | None]) -> dict[int, int]:
    """The label that most pixels of each id have."""
    counts: dict[int, NDArray[np.int64]] = {}
    for frame, image in zip(drive.frames, images, strict=True):
        if image is None or not image.any():
            continue
        label = frame_labels(frame, scene)
        use = (image > 0) & (label >= 0)
        pairs, how_many = np.unique(image[use] * len(scene.labels) + label[use], return_counts=True)
        for pair, n in zip(pairs, how_many, strict=True):
            number, k = divmod(int(pair), len(scene.labels))
            counts.setdefault(number, np.zeros(len(scene.labels), np.int64))[k] += n
    return {number: int(c.argmax()) for number, c in counts.items()}


def _object(
    drive: Drive,
    scene: SceneLabels,
    number: int,
    source: str,
    members: NDArray[np.int64],
    labels: NDArray[np.int64],
    sightings: Sequence[Sighting],
    label: int | None,
    axes: NDArray[np.float64],
    tracked: Box | None,
) -> SceneObject:
    if label is None:
        known = labels[members]
        label = int(np.bincount(known[known >= 0]).argmax())
    if tracked is not None:
        name = scene.labels.names[label]
        return SceneObject(number, name, "boxes", tracked, len(members), tuple(sightings))
    box = fit_box(drive.points.positions[members], axes, gap=1.0) if len(members) >= 5 else None
    return SceneObject(number, scene.labels.names[label], source, box, len(members), tuple(sightings))


def _marked(
    mark: MarkedObject,
    drive: Drive,
    positions: NDArray[np.float64],
    some: NDArray[np.int64],
    views: Sequence[PointsInView],
    axes: NDArray[np.float64],
) -> SceneObject:
    if mark.box is not None:
        box = marked_box(mark.box, drive)
        inside = box.contains(positions, axes, margin=0.0, above=ABOVE_GROUND_M)
        ids = np.where(inside[some], mark.id, 0)
        sightings = sightings_of_points(ids, views).get(mark.id) or _outlines(drive, box, axes)
        return SceneObject(mark.id, mark.class_name, "box", box, int(inside.sum()), tuple(sightings))
    mattes = Frames(len(drive.frames), lambda v: matte(mark, drive, drive.frames[v]))
    inside = vote_mattes(len(some), views, mattes)
    numbers = Frames(len(mattes), lambda v: None if (m := mattes[v]) is None else m.astype(np.int64))
    seen = sightings_in_images(numbers).get(1, [])
    members = positions[some][inside]
    fitted = fit_box(members, axes, gap=1.0) if len(members) >= 5 else None
    return SceneObject(mark.id, mark.class_name, "mattes", fitted, int(inside.sum()), tuple(seen))


def vote_mattes(
    count: int, views: Sequence[PointsInView], mattes: Sequence[NDArray[np.bool_] | None]
) -> NDArray[np.bool_]:
    """(P,) points that most views with a matte (H, W) show within it; ``count`` is P."""

    def image(v: int) -> NDArray[np.int64]:
        picture = mattes[v]
        assert picture is not None
        return picture.astype(np.int64)

    with_matte = [v for v, m in enumerate(mattes) if m is not None]
    voted, _ = vote_labels(count, subset(views, with_matte), lambda i: image(with_matte[i]), 2)
    inside: NDArray[np.bool_] = voted == 1
    return inside


def _outlines(drive: Drive, box: Box, axes: NDArray[np.float64]) -> list[Sighting]:
    """Where a box without points lies in the frames."""
    found = []
    for v, frame in enumerate(drive.frames):
        camera = frame.camera
        pixels, depth = camera.project(box.corners(axes))
        if (depth <= 0.1).any():
            continue
        low, high = np.floor(pixels.min(axis=0)).astype(int), np.ceil(pixels.max(axis=0)).astype(int)
        x0, y0, x1, y1 = max(0, low[0]), max(0, low[1]), min(camera.width, high[0]), min(camera.height, high[1])
        if x1 - x0 > 2 and y1 - y0 > 2:
            found.append(Sighting(v, (int(x0), int(y0), int(x1), int(y1))))
    return found

"""Held-out masks: a drive with virtual cars in front of street that the photographs show, and how well that is restored.

Real footage has no true empty street. But where a car-shaped mask hides visible street, the photograph itself is the truth: the
drive is written again as if a car had stood there, the whole pipeline removes it like any other, and the result inside the mask
is compared with the photograph. Nothing inside the pipeline knows about this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.output.scratch import scratch_folder
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.drive import Drive, Footage, Frame, PointCloud
from unveil_core.drives.importing.frames import at_work_size
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.photographs import seen_footage
from unveil_core.evaluate.holdout.placement import CarPixels, SceneView
from unveil_core.evaluate.holdout.virtual_cars import VirtualCar, cast_car, paint_car
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.geometry.reach import CameraViews
from unveil_core.semantics.classes import CITYSCAPES, GROUPS
from unveil_core.semantics.labels import SceneLabels

__all__ = ["AddedLabels", "added_labels", "moved_points", "seen_elsewhere", "write_holdout_drive"]


Indices = NDArray[np.int64]
DEPTH_SHARE, DEPTH_M = 0.04, 0.1
"""A point is visible in a frame if it lies behind the frame's depth by no more than this share of it, plus these metres."""


@dataclass(frozen=True)
class AddedLabels:
    """How the virtual cars are labelled.

    Attributes:
        disk_id: trainId of their class, None in a drive that knows only masks.
        first_instance: instance id of the first of them, None where the drive has no instances.
        choose_instances: whether the run has to name these ids to have the cars removed: it removes no class whole.
    """

    disk_id: int | None
    first_instance: int | None
    choose_instances: bool


def added_labels(drive: Drive, scene: SceneLabels) -> AddedLabels:
    """Labels for which this scene removes the virtual cars: a class that is removed anyway, preferably the car's."""
    used = [np.unique(read_instance_image(f.instance_path)) for f in drive.frames if f.instance_path is not None]
    first = _unused_ids(np.unique(np.concatenate(used))) if used else None
    if scene.source != "semantics":
        return AddedLabels(None, first, False)
    vehicles = [n for n in ("car", *GROUPS["vehicle"]) if n in scene.removed]
    name = (*vehicles, *scene.removed, "car")[0]
    return AddedLabels(CITYSCAPES.index(name), first, not scene.removed)


def _unused_ids(used: NDArray[np.uint16]) -> int:
    """First of enough consecutive ids that are not in use; the ids are 16 bits wide."""
    borders = np.concatenate([[0], used.astype(np.int64), [2**16]])
    room = np.diff(borders)
    return int(borders[len(room) - 1 - int((room[::-1] > 255).argmax())]) + 1


# ---------------------------------------------------------------------------------------------------------------- evidence


def seen_elsewhere(
    views: CameraViews[SceneView], cars: Sequence[CarPixels], *, far: float, cache: FrameCache | None = None
) -> Sequence[Mask]:
    """Per frame (H, W), found when it is asked for, pixels of its virtual cars behind which another frame shows the street, outside
    that frame's own cars.

    Args:
        views, cars: of all frames.
        far: the sky is taken to be this far away, metres.
        cache: room for masks.
    """
    cache = cache or FrameCache()

    def hides(i: int) -> Mask:
        number = cars[i].number
        return grow(number > 0, border_px(number.shape[1])) | views.frames[i].excluded

    hidden = cache.frames(len(cars), hides)

    def seen(i: int) -> Mask:
        mask = np.zeros(cars[i].number.shape, dtype=bool)
        rows, columns = np.nonzero(cars[i].number)
        if not len(rows):
            return mask
        camera = views.cameras[i]
        depth = np.minimum(views.frames[i].depth[rows, columns], far)
        points = camera.centre + depth[:, None] * camera.rays()[rows, columns]
        known = np.zeros(len(rows), dtype=bool)
        # Neighbours first: they see most, and what is found need not be looked for again.
        for other in views.by_distance(views.around(points, far * views.longest_ray), camera.centre):
            unknown = np.flatnonzero(~known)
            if other == i:
                continue
            if not len(unknown):
                break
            inside, row, column, z = _pixels_of(points[unknown], views.cameras[other], 0.2)
            if not len(inside):
                continue
            reach = _reach(views.frames[other], row, column)
            shown = ~hidden[other][row, column] & (np.minimum(z, far) <= reach)
            known[unknown[inside[shown]]] = True
        mask[rows[known], columns[known]] = True
        return mask

    return cache.frames(len(cars), seen)


def _pixels_of(
    points: NDArray[np.float64], camera: Camera, near: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Indices of the points (M, 3) that project into a picture, and their rows, columns and depths there."""
    pixel, depth = camera.project(points)
    index = np.flatnonzero(camera.in_picture(pixel, depth, nearest=near))
    return index, pixel[index, 1].astype(np.int64), pixel[index, 0].astype(np.int64), depth[index]


def _reach(view: SceneView, row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.float64]:
    """(M,) depth up to which points at some pixels are visible."""
    return view.farthest[row, column] * (1 + DEPTH_SHARE) + DEPTH_M  # type: ignore[return-value]


def moved_points(
    points: PointCloud, views: CameraViews[SceneView], pixels: Sequence[CarPixels], cars: Sequence[VirtualCar]
) -> PointCloud:
    """The points that would have been measured if the virtual cars had stood there.

    A point that some frame would see only through a car was never measured: in its place the ray from the nearest such camera
    measures the car. Points that no frame shows at all stay.
    """
    positions = points.positions
    blocked, seen = np.zeros(len(positions), dtype=bool), np.zeros(len(positions), dtype=bool)
    nearest, blocker = np.full(len(positions), np.inf), np.full(len(positions), -1)

    def behind_cars(v: int, row: Indices, column: Indices, depth: Float64) -> Mask:
        car = pixels[v]
        behind: Mask = (car.number[row, column] > 0) & (depth > car.depth[row, column] - DEPTH_M)
        return behind

    with_car = [v for v, own in enumerate(pixels) if own.number.any()]
    for v in with_car:
        index, row, column, depth = _pixels_of(positions, views.cameras[v], 0.2)
        behind = behind_cars(v, row, column, depth)
        through = index[behind]
        blocked[through] = True
        closer = depth[behind] < nearest[through]
        nearest[through[closer]], blocker[through[closer]] = depth[behind][closer], v
    asked = np.flatnonzero(blocked)
    for v, camera in enumerate(views.cameras):
        index, row, column, depth = _pixels_of(positions[asked], camera, 0.2)
        if len(index):
            # This view cannot measure what a car occludes; what is in front of the car or beside it, it can.
            shown = ~behind_cars(v, row, column, depth) & (depth <= _reach(views.frames[v], row, column))
            seen[asked[index[shown]]] = True
            asked = asked[~seen[asked]]
    gone = blocked & ~seen
    moved, colors = positions.copy(), None if points.colors is None else points.colors.copy()
    lost = np.zeros(len(positions), dtype=bool)
    for v in np.unique(blocker[gone]):
        which = np.flatnonzero(gone & (blocker == v))
        centre = views.cameras[v].centre
        rays = positions[which] - centre
        depth, paint = np.full(len(which), np.inf), np.zeros((len(which), 3), dtype=np.uint8)
        for car in cars:
            hits = cast_car(car, centre, rays)
            closer = hits.depth < depth
            depth[closer] = hits.depth[closer]
            paint[closer] = paint_car(car, centre, rays, hits)[closer]
        # At a pixel's corner a point may pass by the car that covers the pixel's middle.
        lost[which[~np.isfinite(depth)]] = True
        met = np.isfinite(depth)
        moved[which[met]] = centre + depth[met][:, None] * rays[met]
        if colors is not None:
            colors[which[met]] = paint[met]
    return PointCloud(moved[~lost], None if colors is None else colors[~lost])


# ------------------------------------------------------------------------------------------------------------------- drive


def write_holdout_drive(
    drive: Drive,
    pixels: Sequence[CarPixels],
    removed: Sequence[Mask],
    points: PointCloud,
    labels: AddedLabels,
    destination: Path,
    progress: Progress = no_progress,
) -> Drive:
    """The drive as it would be with the virtual cars, as a folder that :func:`unveil_core.drives.open_drive` opens.

    Photographs, semantics, instances and masks have the cars in them; poses, exposure and everything else are unchanged. A
    truth, which would show the street behind the cars, is not passed on.

    Args:
        drive: an imported drive.
        pixels: the cars in each frame; points: see :func:`moved_points`.
        removed: per frame (H, W) what is really removed there: in a drive of masks, the mask of a frame that has none.
        destination: a folder to make, or one that this made before; it appears whole or not at all.
    """
    with scratch_folder(destination.parent, "painted") as painted:
        frames = [
            _with_cars(f, p, r, labels, painted / f.camera_name)
            for f, p, r in zip(drive.frames, pixels, removed, strict=True)
        ]
        derived = replace(drive, frames=tuple(frames), points=points, truth_root=None)
        return import_drive(derived, destination, progress=progress)


def _footage_with_cars(footage: Footage, pixels: CarPixels, camera: Camera) -> Picture:
    """(H, W, 3) uint8 the footage with what the frame of working size shows of the cars, enlarged."""
    at = work_positions(footage, camera)
    across, down = at[..., 0] - 0.5, at[..., 1] - 0.5
    covered = cv2.remap((pixels.number > 0).astype(np.float32), across, down, cv2.INTER_LINEAR) > 0.5
    color = cv2.remap(pixels.color, across, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    picture: Picture = np.where(covered[..., None], color, seen_footage(footage))
    return picture


def _with_cars(frame: Frame, pixels: CarPixels, removed: Mask, labels: AddedLabels, folder: Path) -> Frame:
    """A frame whose files have the cars in them; without a car its own."""
    covered = pixels.number > 0
    if not covered.any():
        return frame
    changed = replace(frame, image_path=folder / "images" / f"{frame.name}.png")
    if frame.footage is None:
        image = np.where(covered[..., None], pixels.color, read_image(frame.image_path))
    else:
        own = _footage_with_cars(frame.footage, pixels, frame.camera)
        path = folder / "footage" / f"{frame.name}.png"
        write_image_atomic(path, own, like=frame.image_path)
        changed = replace(changed, footage=replace(frame.footage, path=path, plate=None))
        image = at_work_size(own, frame.footage, frame.camera)
    write_image_atomic(changed.image_path, image, like=frame.image_path)
    if frame.semantic_path is not None and labels.disk_id is not None:
        semantics = np.where(covered, labels.disk_id, read_label_image(frame.semantic_path)).astype(np.uint8)
        changed = replace(changed, semantic_path=folder / "semantics" / f"{frame.name}.png")
        write_image_atomic(changed.semantic_path, semantics)  # type: ignore[arg-type]
    if frame.instance_path is not None and labels.first_instance is not None:
        number = (labels.first_instance - 1 + pixels.number.astype(np.int64)).astype(np.uint16)
        changed = replace(changed, instance_path=folder / "instances" / f"{frame.name}.png")
        instances = np.where(covered, number, read_instance_image(frame.instance_path))
        write_image_atomic(changed.instance_path, instances)  # type: ignore[arg-type]
    if labels.disk_id is None:
        kept = read_label_image(frame.mask_path) if frame.mask_path is not None else np.where(removed, 0, 255)
        mask = np.where(covered, 0, kept).astype(np.uint8)
        changed = replace(changed, mask_path=folder / "masks" / f"{frame.name}.png")
        write_image_atomic(changed.mask_path, mask)  # type: ignore[arg-type]
    return changed

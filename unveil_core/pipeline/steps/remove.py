"""Stage ``remove``: which surfels and pixels go, and what of the street behind them nobody saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.files import write_image_atomic
from unveil_core.base.frame_cache import Frames
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.marked import MarkedObject, marked_objects, matte
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.files import read_ground
from unveil_core.ground.street import Ground
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.remove.behind import empty_street
from unveil_core.remove.cut_off import cut_off_pixels
from unveil_core.remove.floating import floating_ground
from unveil_core.remove.missed import missed_pixels
from unveil_core.remove.observed import SeenView, SeenViews, never_seen, seen_view
from unveil_core.remove.reaching import shortened
from unveil_core.remove.regions import region_map
from unveil_core.remove.remains import remains
from unveil_core.remove.selection import LONGEST_M, WIDEST_M, select_removed
from unveil_core.remove.unsupported import unsupported
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.instances import Box
from unveil_core.semantics.labels import SceneLabels, frame_instances, frame_labels
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import (
    frame_file,
    listed_objects,
    load_array,
    load_selection,
    save_array,
    save_mask,
)
from unveil_core.workspace.movers import ego_pixels, read_moving

__all__ = ["run"]

OWN_KINDS = 3
"""What a surfel is drawn as: stays, goes, goes as one that a person marked; then single objects."""
ON_GROUND_M = 0.15
"""Height over or under the ground within which a surfel lies on it, metres: what a fit along the whole street is off by."""
LOOSE_M = 0.5
"""How far from an object its loose ends may lie, metres."""
SEEN = 0.3
"""Alpha over which the scene has a depth."""
MOST_NAMED = 5
"""So many objects are named in a line of the log."""


def object_mask(frame: Frame, scene: SceneLabels, rendered: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels in which this frame shows something that goes.

    From the frame's own labels or instances where it has them, else from the rendered share of the removed surfels: so
    masks on some frames are carried to the others through the scene.
    """
    label = frame_labels(frame, scene)
    known = label >= 0
    mask = np.isin(label, scene.removed_labels)
    instances = frame_instances(frame)
    if scene.instances and instances is not None:
        mask |= np.isin(instances, scene.instances)
    elif scene.instances:
        mask |= rendered > 0.5
    return mask | (~known & (rendered > 0.5))


def single_object(frame: Frame, number: int, rendered: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W) pixels of one object: by the frame's own instances where these know it, and by its ``rendered`` share."""
    instances = frame_instances(frame)
    mask: NDArray[np.bool_] = rendered > 0.5
    return mask if instances is None else mask | (instances == number)


def working_px(frame: Frame, pixels: int) -> int:
    """Pixels of the working picture that are so many of the delivered one, at least one."""
    wide = frame.camera.width if frame.footage is None else frame.footage.camera.width
    return max(1, round(pixels * frame.camera.width / wide))


def marked_pixels(
    marked: Sequence[MarkedObject], drive: Drive, frame: Frame, rendered: NDArray[np.float32]
) -> NDArray[np.bool_]:
    """(H, W) pixels of marked objects: their mattes where this frame has them, else their ``rendered`` share (H, W)."""
    mattes = [None if m.mattes is None else matte(m, drive, frame) for m in marked]
    mask = np.zeros(rendered.shape, dtype=bool)
    for own in mattes:
        mask |= rendered > 0.5 if own is None else own
    return mask


def _loose_ends(drive: Drive, scene: SceneLabels, surfels: Surfels, gone: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) surfels that go because no masked frame backs them: masks drawn by hand are missing in some frames and loose in others,
    and where there are no classes, a surfel's label is no more than what most frames say."""
    masked = [f for f in drive.frames if (frame_labels(f, scene) >= 0).any()]
    masks = Frames(len(masked), lambda i: np.isin(frame_labels(masked[i], scene), scene.removed_labels))
    return unsupported(surfels.means.double().numpy(), gone, [f.camera for f in masked], masks, reach=LOOSE_M)


def _of_ground(surfels: Surfels, scene: SceneLabels, street: Ground) -> NDArray[np.bool_]:
    """(N,) surfels that are labelled as ground and lie on it."""
    over = street.over(street.path.to_street(surfels.means.double().numpy()))
    return np.isin(surfels.labels.numpy(), scene.labels.indices(GROUND_CLASSES)) & (np.abs(over) < ON_GROUND_M)


def _floating(drive: Drive, scene: SceneLabels, surfels: Surfels, street: Ground) -> NDArray[np.bool_]:
    """(N,) surfels labelled ground that float where objects are."""
    border = border_px(drive.frames[0].camera.width)
    masks = (grow(np.isin(frame_labels(f, scene), scene.removed_labels), border) for f in drive.frames)
    on_ground = np.isin(surfels.labels.numpy(), scene.labels.indices(GROUND_CLASSES))
    cameras = [f.camera for f in drive.frames]
    return floating_ground(surfels.means.double().numpy(), on_ground, street, cameras, masks)


def _vehicles_assumed(boxes: dict[int, Box], names: dict[int, str]) -> Assumption:
    """That boxes are those of single vehicles.

    Args:
        boxes: by id, those that are not; names: of objects' classes, by id.
    """
    told = []
    for number, box in sorted(boxes.items(), key=lambda entry: -max(entry[1].size[:2])):
        length, width = max(box.size[:2]), min(box.size[:2])
        why = "" if length > LONGEST_M else f" and {width:.1f} m wide" if width > WIDEST_M else " with a gap"
        told.append(f"{names.get(number, 'object')} {number}: {length:.1f} m long{why}")
    more = f", and {len(told) - MOST_NAMED} more" if len(told) > MOST_NAMED else ""
    return Assumption(
        f"each removed object is one vehicle of at most {LONGEST_M:g} m",
        not told,
        ", ".join(told[:MOST_NAMED]) + more if told else "all are",
        "its own points go, but nothing else that lies in its box",
    )


def run(context: StageContext) -> Facts:
    """surfels/removed.npy, masks/removed, masks/unobserved, regions. Returns what was assumed of the objects."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir, points=False)
    scene = load_selection(workspace)
    surfels = read_surfels(workspace.surfels_full)
    of_surfel = load_array(workspace.root / "surfels/instances.npy")
    on_ground = scene.labels.indices(GROUND_CLASSES)
    ground = read_ground(workspace.ground_npz)
    of_ground = _of_ground(surfels, scene, ground.street) if on_ground and ground.street is not None else None
    boxes: dict[int, Box] = {}
    gone = select_removed(
        surfels, of_surfel, scene, too_close=0.08, axes=up_frame(UP), ground=of_ground, not_one=boxes.__setitem__
    )
    if not on_ground:
        gone |= _loose_ends(drive, scene, surfels, gone)
    if on_ground and ground.street is not None:
        gone |= _floating(drive, scene, surfels, ground.street)
    by_hand = [m for m in marked_objects(context.settings.marked) if m.id in scene.instances]
    # No label or instance image tells where these are: they are drawn apart.
    kinds = torch.from_numpy(gone).long() + torch.from_numpy(gone & np.isin(of_surfel, [m.id for m in by_hand])).long()
    grown = context.settings.grown_px
    for kind, number in enumerate(grown, start=OWN_KINDS):  # drawn apart, too: their masks are enlarged
        kinds[torch.from_numpy(gone & (of_surfel == number))] = kind
    told = replace(surfels, labels=kinds)
    moving = read_moving(workspace.root)
    exposures = read_exposures(workspace.exposure_json)
    frames = drive.frames

    by_masks = scene.source == "masks"

    def look(i: int) -> tuple[NDArray[Any], ...]:
        frame = frames[i]
        planes = ("rgb", "alpha", "depth", "semantics")
        near = near_camera(told, frame.camera)
        full = rendered(near, frame.camera, planes, label_count=OWN_KINDS + len(grown), near=NEAR_M, far=FAR_M)
        share = array(full.semantics)
        single = {n: share[..., k] for k, n in enumerate(grown, start=OWN_KINDS)}
        marked, known = share[..., 2].copy(), share[..., 1].copy()
        for number, part in single.items():
            into = marked if number in {m.id for m in by_hand} else known
            into += part
        own = object_mask(frame, scene, known + marked) | moving.pixels(frame)
        own |= marked_pixels(by_hand, drive, frame, marked)
        photograph = exposures.read(frame)
        own |= missed_pixels(photograph, array(full.rgb), known, own)
        if by_masks and ground.street is not None:
            depth = array(full.depth) / np.maximum(array(full.alpha), SEEN)
            own |= cut_off_pixels(photograph, frame.camera, depth.astype(np.float64), own, ground.street)
        for number, part in single.items():
            pixels = own & single_object(frame, number, part)
            own |= grow(pixels, working_px(frame, grown[number])) if pixels.any() else False
        own &= ~ego_pixels(frame)
        label = frame_labels(frame, scene)
        # Pixels at the border of the sky are mixed.
        sky = ~grow(~np.isin(label, scene.labels.indices(("sky",))), border_px(frame.camera.width, 1))
        by_label = (label >= 0, np.isin(label, on_ground), sky) if on_ground else None
        return (seen_view(array(full.depth), array(full.alpha), own, by_label).depth,)

    stored = context.cache.stored(context.scratch("seen"), len(frames), look)
    views = SeenViews([f.camera for f in frames], Frames(len(frames), lambda i: SeenView(*stored[i])))
    for done, _ in enumerate(stored):
        context.progress(done + 1, 2 * len(frames), "finding what no frame shows")
    removed = Frames(len(frames), lambda i: grow(views.frames[i].hidden, border_px(frames[i].camera.width)))

    def find_remains() -> dict[str, NDArray[Any]]:
        so_far = context.kept.checkpoint("remains_so_far")
        return {"found": remains(surfels, gone, views.cameras, removed, so_far, context.progress)}

    gone |= context.kept.once("remains", find_remains)["found"]
    save_array(gone.astype(np.uint8), context.output("surfels/removed.npy"))
    short = shortened(surfels, ~gone, views)
    save_array(short.table(), context.output("surfels/shortened.npy"))
    empty = empty_street(short.of(surfels), gone, ground, on_ground)
    for done, frame in enumerate(frames):
        last = frame_file(context.output("regions"), frame)
        if not last.is_file():  # not written by an attempt that was interrupted
            hidden, mask = views.frames[done].hidden, removed[done]
            unseen = never_seen(frame.camera, hidden, empty.depth(frame.camera, hidden), views)
            save_mask(mask, frame_file(context.output("masks/removed"), frame))
            save_mask(unseen, frame_file(context.output("masks/unobserved"), frame))
            write_image_atomic(last, region_map(mask, hidden, unseen))
        context.progress(len(frames) + done + 1, 2 * len(frames), "finding what no frame shows")
    names = {int(entry["id"]): str(entry["class"]) for entry in listed_objects(workspace) if "class" in entry}
    return assumed([_vehicles_assumed(boxes, names)])

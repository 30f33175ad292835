"""Stage ``ground``: the street's path, its ground and the terrain around it, fitted once per scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_json_atomic
from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import read_exposures
from unveil_core.drives.imported import read_imported
from unveil_core.drives.scale_and_up import ESTIMATED_SCALES, ESTIMATED_UPS
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.files import write_ground
from unveil_core.ground.fit import DriveGround, GroundEvidence, fit_drive_terrain, measured_ground
from unveil_core.ground.one_place import LEAST_OWN, goes_round, share_of_own
from unveil_core.ground.path import StreetPath, fit_path, way_of
from unveil_core.ground.plain_fit import NOISY_M
from unveil_core.ground.street import Ground, as_far_as_shown
from unveil_core.ground.track import longest_track
from unveil_core.inpaint.chart.ahead import path_ahead
from unveil_core.inpaint.chart.rectify import LEAST_AGREEMENT, Rectified, rectified_path
from unveil_core.inpaint.chart.street_chart import READ_M, usable_pixels
from unveil_core.pipeline.stage import Facts, StageContext
from unveil_core.raster.picture import render_numpy
from unveil_core.semantics.classes import GROUND_CLASSES, LabelSet
from unveil_core.semantics.labels import SceneLabels, labels_of_frames
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.assumptions import Assumption, assumed
from unveil_core.workspace.files import load_labels
from unveil_core.workspace.movers import read_moving

__all__ = ["run"]

PLAIN = "frames are filled one by one, without charts"
HEIGHTS_M = (0.4, 4.5)
"""Heights of cameras over the street between which a drive's metres are believed, metres: a robot's, and the roof of a
double-decker bus."""


def _usable(
    drive: Drive,
    scene: SceneLabels,
    surfels: Surfels,
    hidden: Sequence[Mask] | None,
    ground: Ground,
    labels: Sequence[NDArray[np.int64]],
) -> Callable[[int], Mask]:
    """(H, W) of a frame, pixels that show ground: what could be removed hides it, whether it is chosen or not."""
    by_classes = bool(scene.labels.indices(GROUND_CLASSES))

    def usable(i: int) -> Mask:
        frame = drive.frames[i]
        barred, depth = np.isin(labels[i], scene.removable_labels), None
        if not by_classes:
            shown = render_numpy(surfels, frame.camera, near=NEAR_M, far=FAR_M, apart=scene.removable_labels)
            depth = shown["depth"]
            # Masks on some frames are carried to the others through the scene.
            barred |= (labels[i] < 0) & (shown["kinds"][..., 1] > 0.5)
        # As far as inpaint keeps away from what it removes: the border that goes with it, and a pixel more.
        width = frame.camera.width
        barred = grow(barred, border_px(width) + border_px(width, 1))
        if hidden is not None:
            barred |= hidden[i]
        return usable_pixels(ground, frame.camera, labels[i], scene.labels, barred, depth)

    return usable


def run(context: StageContext) -> Facts:
    """ground/ground.npz, and ground/ground.json on how it was fitted. Returns what was assumed of the drive."""
    workspace = context.workspace
    drive = read_imported(workspace.drive_dir)
    scene = load_labels(workspace)
    surfels = read_surfels(workspace.surfels_full)
    track = longest_track(drive)
    of_track = [drive.frames[i].camera for i in track]
    path = fit_path(of_track)
    own, orbits = share_of_own(path), goes_round(path)
    one_street = own >= LEAST_OWN and not orbits
    measured = measured_ground(drive.points, surfels, scene.labels)
    evidence = GroundEvidence(surfels, scene.labels, of_track, measured)
    street = evidence.fit(path) if one_street else None
    rectified: Rectified | None = None
    context.progress(1, 4, "fitting the ground")
    if street is not None:
        exposures = read_exposures(workspace.exposure_json)
        frames = drive.frames
        labels, cameras = labels_of_frames(frames, scene, context.cache), [f.camera for f in frames]
        kinds = scene.labels.indices(GROUND_CLASSES)

        def onward(fitted: Ground) -> Ground:
            if not on("ground_ahead"):
                return fitted
            return as_far_as_shown(fitted, cameras, labels, kinds, scene.removable_labels, READ_M)

        def along(way: StreetPath, otherwise: Ground) -> Ground:
            fitted = evidence.fit(way)
            return otherwise if fitted is None else onward(fitted)

        street = onward(street)
        hidden = read_moving(workspace.root).hidden(drive, context.cache)
        # The pieces of the street that are read share frames: both are cached.
        usable = context.cache.frames(len(frames), _usable(drive, scene, surfels, hidden, street, labels))
        images = context.cache.frames(len(frames), lambda i: exposures.read(frames[i]))
        frames_of = (cameras, images, labels, usable)
        walls = evidence.side_places(street)
        if on("path_ahead"):
            ahead = path_ahead(street, of_track, *frames_of, kinds=kinds, walls=walls)
            street = along(ahead, street)
        if on("rectified_path"):
            rectified = rectified_path(street, *frames_of, context.kept, context.progress)
            street = along(rectified.path, street)
        path = street.path
    context.progress(3, 4, "fitting the ground")
    terrain = fit_drive_terrain(measured, path.axes, street) if on("terrain") else None
    ground = DriveGround(path, street, terrain)
    write_ground(ground, context.output("ground/ground.npz"))
    centres = np.stack([c.centre for c in of_track])
    way = way_of(centres)
    write_json_atomic(
        context.output("ground/ground.json"),
        {
            "track": drive.frames[track[0]].camera_name,
            "frames": len(track),
            "way_m": round(way, 2),
            "street_from": _street_from(scene, street),
            "path_moved_by_m": 0.0 if rectified is None else round(rectified.moved_m, 3),
            "terrain": ground.terrain is not None,
        },
    )
    context.progress(4, 4, "fitting the ground")
    shape = "goes round in circles" if orbits else f"{own:.0%} of the places beside it are one place of it"
    found = [
        _metres_assumed(drive.scale_source, street, centres),
        Assumption(
            "up is known",
            drive.up_source not in ESTIMATED_UPS,
            f"by {drive.up_source}",
            "it was estimated from the scene",
        ),
        Assumption(
            "the camera drives", way > 0, f"{way:.1f} m of way", "where it looks is taken for the street's direction"
        ),
        Assumption("the way is one street", one_street, shape, PLAIN),
    ]
    if one_street:
        found += _street_assumed(scene.labels, street, rectified, evidence.noise(path))
    return assumed(found)


def _metres_assumed(source: str, street: Ground | None, centres: Float64) -> Assumption:
    """That lengths are in metres: where nothing tells, or cameras are as high as on no street, they are not.

    Args:
        source: of the drive's scale; centres: (F, 3) places of its cameras, metres.
    """
    if source in ESTIMATED_SCALES or street is None:
        known, found, instead = source not in ESTIMATED_SCALES, "", "the cameras were taken to be 1.6 m high"
    else:
        height = float(np.median(street.over(street.path.to_street(centres))))
        known, found = HEIGHTS_M[0] <= height <= HEIGHTS_M[1], f", cameras {height:.1f} m over the street"
        instead = "the drive's own scale is kept; --scale UNITS_PER_METRE decides"
    return Assumption("lengths are in metres", known, f"by {source}{found}", instead)


def _street_assumed(
    labels: LabelSet, street: Ground | None, rectified: Rectified | None, noise: float
) -> list[Assumption]:
    """What is assumed of a way that is one street; noise: spread of height of what its ground was fitted to, metres."""
    labelled = bool(labels.indices(GROUND_CLASSES))
    seen = "too little" if street is None else "by its labels" if labelled else "level surfels under the cameras"
    found = [Assumption("the ground was seen", street is not None, seen, PLAIN)]
    if street is not None:
        told = "so they do" if labelled else "no class of ground"
        found.append(Assumption("labels tell the ground", labelled, told, "level surfels do"))
        found.append(
            Assumption(
                "the ground's height is known to centimetres",
                noise <= NOISY_M,
                f"what lies beside each other differs by {100 * noise:.0f} cm",
                "the street is smooth along, and a parabola across, without kerbs",
            )
        )
    if rectified is not None:
        found.append(
            Assumption(
                "paint and kerbs run along the street",
                rectified.agreement >= LEAST_AGREEMENT,
                f"{rectified.agreement:.0%} of the contrast across it does",
                "the street is taken to lie as the car drove",
            )
        )
    return found


def _street_from(scene: SceneLabels, street: Ground | None) -> str | None:
    """What distinguished the street's ground from everything else; None where there is none."""
    if street is None:
        return None
    return "labels" if scene.labels.indices(GROUND_CLASSES) else "level surfels"

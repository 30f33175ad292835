"""An object whose shape its points do not tell: its outline itself goes from each frame to the next, by optical flow.

Between two frames a near object grows by a third and moves by its own width: no flow finds that. So the frame before is first
brought to the next one as if it showed a plane at the object's distance, and the flow finds what is left. The outline that it
gives is wrong by a few pixels at its border: there colours decide, as between an object's points and what is beside them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc, within
from unveil_core.labelling.outlines import joined
from unveil_core.marking.asked.prompts import Prompt, Prompts
from unveil_core.marking.outline import Outliner
from unveil_core.marking.seeds import Seeds, seeds_of
from unveil_core.marking.space.clustering import clicked_points
from unveil_core.marking.space.scene_points import ScenePoints

__all__ = ["followed"]

LEAST_PX = 30
"""An outline of fewer pixels is lost."""
BORDER = 0.06
"""Width of the border in which colours decide, on either side of an outline that came with the flow, a share of its size."""
AROUND = 0.5
"""Width of what is looked at around an object, so that colours beside it are learned, a share of its size."""
FEWEST_POINTS, NEAR_SIDE = 5, 0.4
"""Points from which on an object's distance is theirs: it is that of its near side, of this share of them."""
NEAREST_FOOT = 0.25
"""Of the distances at which the columns of an outline meet the ground, this share is nearer than where the object stands: a car is
seen by its near end, and columns without a wheel meet the ground farther away."""
LENGTH_M, COARSE = 6.5, 0.25
"""Points farther before or behind the clicked ones than this, metres, and than this share of the distance, are of something else:
no vehicle is longer but one that is clicked at both ends."""
DOT = 0.004
"""Radius of what such points take from an outline, a share of the picture's width; lone ones take nothing, for some are wrong."""
NEAREST_M = 1.0
"""Between frames the camera comes no nearer to the plane than this, metres."""


def followed(
    drive: Drive,
    image: Callable[[int], NDArray[np.uint8]],
    points: ScenePoints,
    prompts: Prompts,
    outline: Outliner,
    own: Mask | None = None,
    progress: Callable[[], None] = lambda: None,
) -> Sequence[Mask]:
    """(H, W) per frame the pixels of an object: from each frame that a person says something of, on and back along the way, up to
    the next such frame, or until the picture does not show it any more.

    Args:
        image: gives the photograph (H, W, 3) of a frame, by its index.
        points: of the scene; prompts: what the person says.
        outline: see :data:`~unveil_core.marking.outline.Outliner`.
        own: (P,) points of the object, as far as which it reaches; None = they do not tell.
        progress: called per frame.
    """
    found = [np.zeros((f.camera.height, f.camera.width), dtype=bool) for f in drive.frames]
    for v, prompt in prompts.frames.items():
        found[v] = outline(v, None, prompt)
        if prompt.matte is None:
            found[v] = _bounded(found[v], drive.frames[v].camera, points, v, prompt, own)
        progress()
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    for v in prompts.frames:
        track = next(t for t in tracks(drive) if v in t)
        place = track.index(v)
        for way in (track[place + 1 :], track[:place][::-1]):
            last, mask = v, found[v]
            depth = _distance(mask, drive.frames[v].camera, points, v)
            for k in way:
                if k in prompts.frames or mask.sum() < LEAST_PX:
                    break
                here, there = drive.frames[last].camera, drive.frames[k].camera
                came = _moved(mask, image(last), image(k), _by_plane(here, there, depth), engine)
                if came.sum() < LEAST_PX:
                    break
                mask = outline(k, _seeds(came), None)
                found[k] |= mask
                nearer = _distance(mask, there, points, k)
                if nearer is None and depth is not None:
                    nearer = max(NEAREST_M, depth - float((there.centre - here.centre) @ here.forward))
                last, depth = k, nearer
                progress()
    return found


def _bounded(mask: Mask, camera: Camera, points: ScenePoints, v: int, prompt: Prompt, own: Mask | None) -> Mask:
    """(H, W) an outline by colours without what points say is something else, and without what hangs on it by that alone.

    Args:
        own: (P,) see :func:`followed`.
    """
    said, seen = prompt.own(mask.shape), points.views[v]
    elsewhere = np.zeros(mask.shape, dtype=bool)
    hit, _ = clicked_points(points, seen, prompt.inside, camera.width)
    if len(hit):
        there = seen.depth[np.isin(seen.index, hit)]
        depth, length = float(np.median(there)), LENGTH_M + float(np.ptp(there))
        far = points.standing[seen.index] & (np.abs(seen.depth - depth) > max(length, COARSE * depth))
        elsewhere[seen.rows[far], seen.columns[far]] = True
        radius = DOT * camera.width
        elsewhere = cv2.morphologyEx(within(elsewhere, radius).astype(np.uint8), cv2.MORPH_OPEN, disc(2 * radius)) > 0
    seeds = None if own is None else seeds_of(camera, points, own, seen)
    if seeds is not None:
        reached = np.zeros(mask.shape, dtype=bool)
        reached[seeds.window] = within(seeds.likely, 1 + BORDER * seeds.size)
        elsewhere |= ~reached
    return joined(mask & (~elsewhere | said), said) if said.any() else mask


def _moved(
    mask: Mask,
    before: NDArray[np.uint8],
    image: NDArray[np.uint8],
    brought: Float64,
    engine: cv2.DISOpticalFlow,
) -> Mask:
    """(H, W) where a photograph shows what the one before shows on the pixels of a mask.

    Args:
        brought: (3, 3) homography between both, about.
    """
    height, width = image.shape[:2]
    was, now = (cv2.cvtColor(p, cv2.COLOR_RGB2GRAY) for p in (before, image))
    # What comes into the picture at its border belongs to what was there.
    edge = {"flags": cv2.INTER_LINEAR, "borderMode": cv2.BORDER_REPLICATE}
    flow = engine.calc(now, cv2.warpPerspective(was, brought, (width, height), **edge), None)
    own = cv2.warpPerspective(mask.astype(np.float32), brought, (width, height), **edge)
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.asarray(cv2.remap(own, columns + flow[..., 0], rows + flow[..., 1], cv2.INTER_LINEAR) > 0.5)


def _by_plane(here: Camera, there: Camera, depth: float | None) -> Float64:
    """(3, 3) from the pixels of a camera to those of another one, of a plane that faces the first; without a depth it stays."""
    found = None if depth is None else here.homography(there, np.array([0.0, 0.0, 1.0]), depth)
    return np.eye(3) if found is None else found


def _distance(mask: Mask, camera: Camera, points: ScenePoints, v: int) -> float | None:
    """Of an object from a camera, metres along its axis: by points on it, else by where its foot meets the ground; None where
    neither tells."""
    seen = points.views[v]
    own = mask[seen.rows, seen.columns] & points.standing[seen.index]
    if own.sum() >= FEWEST_POINTS:
        return float(np.quantile(seen.depth[own], NEAR_SIDE))
    if points.ground is None:
        return None
    rows, columns = np.nonzero(mask)
    lowest = np.full(mask.shape[1], -1)
    np.maximum.at(lowest, columns, rows)
    # Where the picture ends the foot is not seen.
    feet = np.flatnonzero((lowest >= 0) & (lowest < mask.shape[0] - 1))
    if not len(feet):
        return None
    rays = camera.rays_at(np.stack([feet + 0.5, lowest[feet] + 1.0], axis=1).astype(np.float64))
    met = points.ground.first_met(camera.centre, rays, near=NEAR_M, far=FAR_M)
    met = met[np.isfinite(met)]
    return float(np.quantile(met, NEAREST_FOOT)) if len(met) else None


def _seeds(came: Mask) -> Seeds:
    """What an outline that came with the flow says of a frame."""
    size = float(np.sqrt(came.sum()))
    near = within(came, 4 + AROUND * size)
    rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
    window = (slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1))
    own = np.ascontiguousarray(came[window])
    sure = cv2.erode(own.astype(np.uint8), disc(1 + BORDER * size), borderValue=1).astype(bool)
    nothing = np.zeros(own.shape, dtype=bool)
    return Seeds(window, sure, own, within(own, 1 + BORDER * size), nothing, nothing, size)

"""What moves, told by motion alone: where labels tell nothing, the flow between neighbouring frames does.

The static scene's flow follows from the cameras and its depth. Where the photographs flow otherwise, something moved, or the depth
is wrong: no point lies there. So each such patch is asked whether it could stand still at another depth: along the epipolar lines,
the same from both neighbours, and where its foot meets the ground. What could not, in several frames in a row, moves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import area_px, disc, scale_from_384
from unveil_core.ground.height_field import HeightField

__all__ = ["MovingThing", "things_that_move"]

APART_M, FARTHEST_STEP = 1.5, 4
"""Neighbours were taken this far away, metres, or so many frames before and after: what drives on ahead at the camera's speed
hardly flows from one frame to the next, whatever it does."""
OFF_PX = 0.8
"""A pixel flows otherwise than the static scene by more than so many pixels at 384 px."""
LEVELS, BETTER = 3.0, 0.85
"""Flow tells something where the static scene is off by so many levels of 255, and by this share less with it."""
AGREE_PX = 1.0
"""Flow to a neighbour and back ends no farther from where it began than this, pixels at 384 px, or nothing is known there."""
ASIDE_PX = 1.2
"""A patch that flows off the epipolar lines by more than this, pixels at 384 px, in the median, moves."""
STANDS = (0.65, 1.5)
"""A patch may stand still whose depth by its flow is between so many times the depth at which its foot meets the ground."""
LEAST_PX = 60
"""Pixels of a patch at 384x256: fewer are noise of the flow."""
LEAST_FRAMES = 3
"""A thing moves in so many frames in a row, or it is an error of one."""
OVERLAP = 0.25
"""Share of a patch, moved with the flow, that the next frame's patch covers, from which on both are one thing."""
LARGEST = 0.5
"""A patch of a larger share of the picture is none: the cameras' poses are wrong there."""


@dataclass(frozen=True, eq=False)
class MovingThing:
    """One thing that moves: its pixels (H, W) by the index of the frame."""

    masks: dict[int, Mask]


@dataclass(frozen=True, eq=False)
class _Flow:
    """Flow from a frame to a neighbour (H, W, 2); what the static scene does not explain (H, W), pixels; and where it is known."""

    to: int
    flow: Float32
    rest: Float32
    known: Mask


def things_that_move(
    cameras: Sequence[Camera],
    track: Sequence[int],
    image: Callable[[int], NDArray[np.uint8]],
    depth: Callable[[int], Float64],
    ground: HeightField,
    progress: Progress = no_progress,
) -> list[MovingThing]:
    """Find what moves along the track of one camera.

    Args:
        cameras: of all frames; track: indices of the camera's frames, in the order in which they were taken.
        image: gives the photograph (H, W, 3) of a frame.
        depth: gives that of the static scene (H, W), metres along the axis, inf where unknown.
        ground: the height of the ground.
    """
    grays = {v: cv2.cvtColor(image(v), cv2.COLOR_RGB2GRAY) for v in track}
    patches: dict[int, list[Mask]] = {}
    onward: dict[int, Float32] = {}
    for k, v in enumerate(track):
        far = depth(v)
        far = np.where(np.isfinite(far), far, 10 * FAR_M)
        patches[v] = []
        for step in sorted({1, _step(cameras, track, k)}):
            beside = [track[j] for j in (k - step, k + step) if 0 <= j < len(track)]
            flows = [_flow_to(grays[v], grays[u], cameras[v], cameras[u], u, far) for u in beside]
            if step == 1:
                onward.update((v, f.flow) for f in flows if k + 1 < len(track) and f.to == track[k + 1])
            if len(flows) == 2:
                patches[v] += _patches(cameras, v, flows, ground)
        patches[v] = _united(patches[v])
        progress(k + 1, len(track), "finding dynamic objects")
    return _linked(track, patches, onward)


def _united(patches: Sequence[Mask]) -> list[Mask]:
    """Patches that overlap as one."""
    if not patches:
        return []
    count, label = cv2.connectedComponents(np.any(patches, axis=0).astype(np.uint8), connectivity=8)
    return [label == k for k in range(1, count)]


def _step(cameras: Sequence[Camera], track: Sequence[int], k: int) -> int:
    """How many frames away neighbours are that the camera took from another place, so that depth shows."""
    own = cameras[track[k]].centre
    for step in range(1, FARTHEST_STEP):
        others = [cameras[track[j]].centre for j in (k - step, k + step) if 0 <= j < len(track)]
        if others and min(float(np.linalg.norm(o - own)) for o in others) >= APART_M:
            return step
    return FARTHEST_STEP


def _flow_to(
    gray: NDArray[np.uint8], other: NDArray[np.uint8], camera: Camera, there: Camera, to: int, depth: Float64
) -> _Flow:
    """Flow by what remains when the neighbour is brought to where the static scene would flow: of what stands still, nothing."""
    height, width = gray.shape
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    expected = _shift(camera, there, camera.rays(), depth)
    x, y = columns + expected[..., 0], rows + expected[..., 1]
    inside = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    brought = cv2.remap(other, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.uint8)
    method = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    rest: Float32 = method.calc(gray, brought, None)  # type: ignore[call-overload]
    back: Float32 = method.calc(brought, gray, None)  # type: ignore[call-overload]
    x, y = columns + rest[..., 0], rows + rest[..., 1]
    again = cv2.remap(back, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1e3, 1e3))
    scale = scale_from_384(width)
    apart = np.hypot(*np.moveaxis(rest, -1, 0))
    known = np.hypot(*np.moveaxis(rest + again, -1, 0)) < AGREE_PX * scale + 0.1 * apart
    # Where the neighbour looks as well without it, the flow tells nothing: a wall without texture.
    still = cv2.blur(np.abs(gray.astype(np.float32) - brought), (5, 5))
    moved = cv2.blur(np.abs(gray.astype(np.float32) - cv2.remap(brought, x, y, cv2.INTER_LINEAR)), (5, 5))
    tells = (still > LEVELS) & (moved < BETTER * still)
    flow = rest + cv2.remap(expected, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return _Flow(to, flow.astype(np.float32), np.where(tells, apart, 0.0).astype(np.float32), known & inside)


def _patches(cameras: Sequence[Camera], v: int, flows: Sequence[_Flow], ground: HeightField) -> list[Mask]:
    """Pixels (H, W) of each patch of a frame that could not stand still."""
    camera = cameras[v]
    scale = scale_from_384(camera.width)
    rays = camera.rays()
    off = np.ones(rays.shape[:2], dtype=bool)
    aside, inverse = [], []
    for f in flows:
        off &= f.known & (f.rest > OFF_PX * scale)
        across, closeness = _explained(camera, cameras[f.to], rays, f.flow)
        aside.append(across)
        inverse.append(closeness)
    shape = disc(1 + scale)
    drawn = cv2.morphologyEx(off.astype(np.uint8), cv2.MORPH_OPEN, disc(scale))
    drawn = cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, shape)
    count, label, stats, _ = cv2.connectedComponentsWithStats(drawn, connectivity=8)
    found = []
    for k in range(1, count):
        own = label == k
        area = int(stats[k, cv2.CC_STAT_AREA])
        if not area_px(own.shape, LEAST_PX) <= area <= LARGEST * own.size:
            continue
        seen = own & off
        moves_aside = max(float(np.median(np.abs(a[seen]))) for a in aside) > ASIDE_PX * scale
        if moves_aside or not _may_stand(own, seen, camera, inverse, ground):
            found.append(own)
    return found


def _shift(camera: Camera, other: Camera, rays: Float64, depth: Float64) -> Float32:
    """(H, W, 2) flow of a static scene at a depth (H, W)."""
    places = (camera.centre + depth[..., None] * rays).reshape(-1, 3)
    pixels, ahead = other.project(places)
    height, width = depth.shape
    own = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1).reshape(-1, 2)
    found = np.where((ahead > NEAR_M)[:, None], pixels - own, 0.0)
    return found.reshape(height, width, 2).astype(np.float32)


def _explained(camera: Camera, other: Camera, rays: Float64, flow: Float32) -> tuple[Float32, Float32]:
    """How far (H, W) flow leads aside of the epipolar lines, pixels, and the inverse depth (H, W) that it tells along them."""
    height, width = flow.shape[:2]
    infinite = _shift(camera, other, rays, np.full((height, width), 1e6))
    # A step of inverse depth along the epipolar line, at about the depths of a street.
    near = _shift(camera, other, rays, np.full((height, width), 10.0))
    line = near - infinite
    length = np.hypot(line[..., 0], line[..., 1])
    unit = line / np.maximum(length, 1e-6)[..., None]
    rest = flow - infinite
    along = (rest * unit).sum(axis=-1)
    across = np.where(
        length > 0.2, rest[..., 0] * unit[..., 1] - rest[..., 1] * unit[..., 0], np.hypot(rest[..., 0], rest[..., 1])
    )
    # Exact along the line: the displacement is homographic in inverse depth; near its middle the linear law is within a tenth.
    return across.astype(np.float32), (along / np.maximum(length, 1e-6) / 10.0).astype(np.float32)


def _may_stand(own: Mask, seen: Mask, camera: Camera, inverse: Sequence[Float32], ground: HeightField) -> bool:
    """Whether a patch could stand still where its foot meets the ground."""
    rows, columns = np.nonzero(own)
    lowest = np.full(own.shape[1], -1)
    np.maximum.at(lowest, columns, rows)
    feet = np.flatnonzero((lowest >= np.percentile(rows, 80)) & (lowest < own.shape[0] - 2))
    if len(feet) < 3:
        return True
    rays = camera.rays_at(np.stack([feet + 0.5, lowest[feet] + 1.0], axis=1).astype(np.float64))
    met = ground.first_met(camera.centre, rays, near=NEAR_M, far=FAR_M)
    met = met[np.isfinite(met)]
    if len(met) < 3:
        return True
    foot = float(np.median(met))
    told = [float(np.median(w[seen])) * foot for w in inverse]
    return any(1 / STANDS[1] <= t <= 1 / STANDS[0] for t in told)


def _linked(track: Sequence[int], patches: dict[int, list[Mask]], onward: dict[int, Float32]) -> list[MovingThing]:
    """Patches of one thing in frames that follow each other."""
    things: list[dict[int, Mask]] = []
    open_: list[dict[int, Mask]] = []
    for before, v in zip([None, *track[:-1]], track, strict=True):
        taken: list[dict[int, Mask]] = []
        left = list(patches[v])
        for thing in open_:
            if before is None or before not in onward:
                continue
            moved = _moved(thing[before], onward[before])
            shares = [float((moved & p).sum()) / max(min(int(moved.sum()), int(p.sum())), 1) for p in left]
            if shares and max(shares) > OVERLAP:
                thing[v] = left.pop(int(np.argmax(shares)))
                taken.append(thing)
        for patch in left:
            thing = {v: patch}
            things.append(thing)
            taken.append(thing)
        open_ = taken
    return [MovingThing(t) for t in things if len(t) >= LEAST_FRAMES]


def _moved(mask: Mask, flow: Float32) -> Mask:
    """A mask (H, W) moved with the flow (H, W, 2), closed."""
    rows, columns = np.nonzero(mask)
    x = np.round(columns + flow[rows, columns, 0]).astype(int)
    y = np.round(rows + flow[rows, columns, 1]).astype(int)
    inside = (x >= 0) & (y >= 0) & (x < mask.shape[1]) & (y < mask.shape[0])
    found = np.zeros(mask.shape, np.uint8)
    found[y[inside], x[inside]] = 1
    return cv2.morphologyEx(found, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)).astype(bool)

"""One frame as it is delivered: the footage's own pixels, and where something was removed the clean frame in full detail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.plates.colours import PlateColours
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.delivery.detail import FINER_THAN, BestSource, sensor_noise, with_detail
from unveil_core.delivery.lens import footage_positions, work_positions
from unveil_core.delivery.shifts import GroundShifts
from unveil_core.delivery.views import FINER, EmptyViews, choose_sources, nearest_depth, places_behind, sees
from unveil_core.drives.drive import Footage
from unveil_core.drives.exposure import Exposure
from unveil_core.geometry.images import resampled, sample_at
from unveil_core.ground.street import Ground

__all__ = ["CleanFrame", "FullSize", "as_color", "full_size_frame", "in_exposure", "put_colors"]

SOURCES = 6
"""Frames at most whose footage a frame takes detail from: more show little else, and each costs a look at its whole picture."""
GRAIN_SOURCES = 3
"""Other frames that are asked for the grain of the ground, where this one does not show the piece that it is taken from."""
DARKEST = 0.02
"""Level, of 1, that is added to both sides of a ratio of light: in black, noise is no light."""
AROUND_PX = 3
"""Pixels around a position that tell its colour."""
ENCODED = PlateColours("srgb")
"""Of footage that is no plate."""
RATIOS = (0.3, 4.0)
"""Least and largest change of light by a shadow that was taken away."""


@dataclass(frozen=True, eq=False)
class CleanFrame:
    """A frame of working size.

    Attributes:
        footage: that it was made of.
        photograph: (H, W, 3) uint8; clean: (H, W, 3) uint8, the empty street.
        removed: (H, W) bool, pixels of removed objects; relit: (H, W) bool, pixels from which only a shadow was taken.
    """

    footage: Footage
    photograph: NDArray[np.uint8]
    clean: NDArray[np.uint8]
    removed: Mask
    relit: Mask


@dataclass(frozen=True, eq=False)
class FullSize:
    """What is the same for all frames of a drive.

    Attributes:
        views: of all frames; footage: pictures of the frames' files as they are, by index.
        lenses: of all frames; exposures: of all frames.
        grain: (H, W) of a frame's file, by index and pixels of the Gaussian that it is finer than, see ``detail.grain_of``.
        ground: the street's, None where there is none; shifts: for its invented parts.
    """

    views: EmptyViews
    footage: Callable[[int], NDArray[Any]]
    lenses: Sequence[Footage]
    exposures: Sequence[Exposure]
    grain: Callable[[int, float], Float32]
    ground: Ground | None
    shifts: GroundShifts | None


def as_color(picture: NDArray[Any]) -> Float32:
    """(H, W, 3) float32 in [0, 1] of a file's picture, grey or colour, 8 or 16 bits, without its transparency; of a plate, float32,
    as it is."""
    if picture.dtype == np.float32:
        return picture
    color = (
        picture[..., :3] if picture.ndim == 3 and picture.shape[2] >= 3 else np.atleast_3d(picture).repeat(3, axis=2)
    )
    return color.astype(np.float32) / np.float32(np.iinfo(picture.dtype).max)


def put_colors(picture: NDArray[Any], mask: Mask, colors: Float32) -> None:
    """Write colours (N, 3) in [0, 1] into a file's picture where the mask (H, W) is, in its channels and bits; it is opaque there:
    who marks what is to go by transparency wants to see what is put in. A plate, float32, takes what is brighter, too."""
    if picture.dtype == np.float32:
        picture[mask] = colors
        return
    levels = np.clip(np.round(colors * np.iinfo(picture.dtype).max), 0, np.iinfo(picture.dtype).max)
    if picture.ndim == 2:
        picture[mask] = (levels @ np.array([0.299, 0.587, 0.114])).astype(picture.dtype)
    else:
        picture[..., :3][mask] = levels.astype(picture.dtype)
        if picture.shape[2] == 4:
            picture[..., 3][mask] = np.iinfo(picture.dtype).max


def full_size_frame(frame: CleanFrame, index: int, drive: FullSize, picture: NDArray[Any]) -> NDArray[Any]:
    """The delivered frame.

    Args:
        frame: of working size; index: its number in the drive.
        picture: the footage as its file has it, (H, W), (H, W, 3) or (H, W, 4), 8 or 16 bits; of a plate (H, W, 3) float32, see
            ``drives.photographs.read_footage``.
    Returns:
        the same shape and depth; outside of what was removed or relit the file's own pixels.
    """
    camera = drive.views.cameras[index]
    at = work_positions(frame.footage, camera)
    scale = frame.footage.camera.width / camera.width
    removed = resampled(frame.removed.astype(np.float32), at, cv2.INTER_LINEAR) > 0
    relit = (resampled(frame.relit.astype(np.float32), at, cv2.INTER_LINEAR) > 0) & ~removed
    if not (removed.any() or relit.any()):
        return picture
    rows, columns = _box(removed | relit, round(12 * scale))
    part = (rows, columns)
    removed, relit, at = removed[part], relit[part], np.ascontiguousarray(at[part])
    original = as_color(picture[part])
    result = original.copy()
    lit = original
    if relit.any():
        lit = _relit(frame, at, original)
        result[relit] = lit[relit]
    if removed.any():
        base = resampled(frame.clean.astype(np.float32) / 255, at, cv2.INTER_CUBIC)
        sharp = _sharpened(base, original, removed, at, index, drive, scale)
        inward = cv2.distanceTransform(removed.astype(np.uint8), cv2.DIST_L2, 3)
        share = np.clip(inward / (scale + 1.0), 0, 1)[..., None]
        result = np.where(removed[..., None], _mixed(lit, sharp, share, frame.footage.plate), result)
    changed = removed | relit
    out = picture.copy()
    put_colors(out[part], changed, result[changed])
    return out


def _mixed(below: Float32, above: Float32, share: Float32, plate: PlateColours | None) -> Float32:
    """(H, W, 3) a picture above another by its share (H, W, 1), in linear light as a lens mixes what it does not resolve."""
    colours = plate or ENCODED
    light = colours.linear(below) * (1 - share) + colours.linear(above) * share
    return colours.of_linear(light).astype(np.float32)


def _relit(frame: CleanFrame, at: Float32, original: Float32) -> Float32:
    """(H, W, 3) the footage ``original`` (H, W, 3) with the light that the relit pixels around its positions (H, W, 2) gained.

    Where they gained more than ``RATIOS`` allow, the colour is still theirs, and only the footage's detail is held back: with each
    channel held for itself the shade of a car, which is dark and blue, would stay blue.
    """
    before, after = (p.astype(np.float32) / 255 + DARKEST for p in (frame.photograph, frame.clean))
    weight = frame.relit[..., None].astype(np.float32)
    # Beside them lie pixels of removed objects, whose change is no light.
    share = np.atleast_3d(resampled(weight, at, cv2.INTER_LINEAR))
    some = np.maximum(share, 1e-3)
    change, dark, light = (
        resampled(plane * weight, at, cv2.INTER_LINEAR) / some
        for plane in (np.clip(after / before, *RATIOS) - 1, before, after)
    )
    lit = light + (original + DARKEST - dark) * (1 + change) - DARKEST
    return np.where(share > 1e-3, lit, original).astype(np.float32)


def _box(mask: Mask, margin: int) -> tuple[slice, slice]:
    """Rows and columns that hold a mask, with a margin."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return tuple(slice(max(0, int(i[0]) - margin), int(i[-1]) + margin + 1) for i in (rows, columns))  # type: ignore[return-value]


def _sharpened(
    base: Float32, original: Float32, removed: Mask, at: Float32, index: int, drive: FullSize, scale: float
) -> Float32:
    """(H, W, 3) the clean frame with all detail that is known of it.

    Args:
        base: (H, W, 3) enlarged; original: (H, W, 3) of the footage; removed: (H, W) bool.
        at: (H, W, 2) positions in the working picture.
    """
    camera = drive.views.cameras[index]
    rays = camera.rays_at(at[removed].astype(np.float64))
    of_scene = nearest_depth(drive.views.frames[index], at)[removed].astype(np.float64)
    behind = places_behind(camera, rays, of_scene, drive.ground)
    depth, points, on_ground, street = behind.depth, behind.points, behind.on_ground, behind.street
    known = depth > 0
    made = np.zeros(len(rays), dtype=bool)
    if drive.shifts is not None:
        made[on_ground] = drive.shifts.is_made(street[on_ground])
    elsewhere = known & ~made
    sources = choose_sources(points[elsewhere], index, drive.views, SOURCES)
    size = depth / camera.fx
    best = BestSource(base, scale)
    for j in sources if on("footage_detail") else ():
        colors, finer = _seen_in(points, elsewhere, j, drive, size)
        colors = in_exposure(colors, drive.exposures[j], drive.exposures[index])
        shown = _scattered(np.minimum(finer, FINER), removed)
        best.add(*with_detail(base, _scattered(colors, removed), shown > 0, scale), shown)
    result = base + best.believed[..., None] * (best.picture - base)
    bare = 1.0 - best.believed
    grain = _ground_grain(street, on_ground & (bare[removed] > 0), index, removed, drive, sources, scale)
    noise = sensor_noise(original, ~removed, scale, seed=index) if on("sensor_noise") else 0
    grain = np.where(np.isnan(grain), noise, grain)
    return result + (bare * grain)[..., None]


def _scattered(values: NDArray[np.generic], mask: Mask) -> Float32:
    plane = np.zeros((*mask.shape, *values.shape[1:]), np.float32)
    plane[mask] = values
    return plane


def _seen_in(
    points: Float64, asked: Mask, j: int, drive: FullSize, size: Float64
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Colours (N, 3) of world points in the footage of frame ``j``, and how many times finer it shows them (N,), 0 = not at all.

    Args:
        points: (N, 3); asked: (N,) those that are looked for; size: (N,) metres of a pixel there in the frame that asks.
    """
    found, finer = np.zeros((len(points), 3), np.float32), np.zeros(len(points), np.float32)
    some = np.flatnonzero(asked)
    seen, _, depth = sees(drive.views.frames[j], points[some])
    some = some[seen]
    if len(some):
        pixels, _ = footage_positions(drive.lenses[j], points[some])
        found[some] = _sampled(drive.footage(j), pixels)
        finer[some] = size[some] / (depth / drive.views.cameras[j].fx)
    return found, finer


def _sampled(picture: NDArray[Any], pixels: Float64) -> Float32:
    """(N, 3) colours of a file's picture at positions (N, 2), not rounded to its levels."""
    height, width = picture.shape[:2]
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - AROUND_PX, 0, (width - 1, height - 1))
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + AROUND_PX, 1, (width, height))
    part = as_color(picture[low[1] : max(high[1], low[1] + 1), low[0] : max(high[0], low[0] + 1)])
    return sample_at(part, pixels - low, cv2.INTER_CUBIC)


def in_exposure(colors: NDArray[np.float32], there: Exposure, here: Exposure) -> NDArray[np.float32]:
    """Colours (N, 3) in [0, 1] of one photograph as another would show them."""
    if there.is_identity and here.is_identity:
        return colors
    return ((colors - there.bias) / there.gain * here.gain + here.bias).astype(np.float32)


def _ground_grain(
    street: Float64, asked: Mask, index: int, removed: Mask, drive: FullSize, sources: Sequence[int], scale: float
) -> Float32:
    """(H, W) grain of ground that nobody saw, from ground of its kind a shift away; NaN where there is none.

    Args:
        street: (N, 3) street coordinates of the removed pixels; asked: (N,) bool, which of them are looked for.
    """
    grain = np.full(removed.shape, np.nan, np.float32)
    if drive.ground is None or drive.shifts is None or not asked.any() or not on("ground_grain"):
        return grain
    moved = np.full((len(street), 2), np.nan)
    moved[asked] = drive.shifts.at(street[asked])
    some = np.flatnonzero(np.isfinite(moved).all(axis=1))
    if not len(some):
        return grain
    s, t = (street[some, :2] + moved[some]).T
    points = drive.ground.path.to_world(np.stack([s, t, drive.ground.height_at(s, t)], axis=1))
    found = np.full(len(street), np.nan, np.float32)
    for j in (index, *sources[:GRAIN_SOURCES]):
        open_ = np.flatnonzero(np.isnan(found[some]))
        open_ = open_[sees(drive.views.frames[j], points[open_])[0]]
        if len(open_):
            pixels, _ = footage_positions(drive.lenses[j], points[open_])
            found[some[open_]] = sample_at(drive.grain(j, FINER_THAN * scale), pixels, cv2.INTER_CUBIC)[:, 0]
    grain[removed] = found
    return grain

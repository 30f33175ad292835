"""One frame as it is delivered: the footage's own pixels, and where something was removed the clean frame in full detail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.pictures.levels import colors_of
from unveil_core.base.plates.colours import PlateColours
from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.delivery.detail import FINER_THAN, BestSource, Detail, sensor_noise
from unveil_core.delivery.lens import footage_positions, work_positions
from unveil_core.delivery.moved_ground import ground_points
from unveil_core.delivery.seen_ground import SeenGround, seen_ground
from unveil_core.delivery.shifts import GroundShifts
from unveil_core.delivery.views import FINER, EmptyViews, choose_sources, ground_before, sees
from unveil_core.drives.drive import Footage
from unveil_core.drives.exposure import Exposure
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import resampled, sample_at
from unveil_core.ground.street import Ground

__all__ = ["CleanFrame", "FullSize", "as_color", "full_size_frame", "in_exposure", "put_colors", "reduced"]

SOURCES = 6
"""Frames at most whose footage a frame takes detail from: more show little else, and each costs a look at its whole picture."""
GRAIN_SOURCES = 3
"""Other frames that are asked for the grain of the ground, where this one does not show the piece that it is taken from."""
DARKEST = 0.0015
"""Light that is added to both sides of a ratio of light, five levels of 255: in black, noise is no light."""
AROUND_PX = 3
"""Pixels around a position that tell its colour."""
ENCODED = PlateColours("srgb")
"""Of footage that is no plate."""
RATIOS = (0.07, 21.0)
"""Least and largest change of light by a shadow that was taken away."""


@dataclass(frozen=True, eq=False)
class CleanFrame:
    """A frame of working size.

    Attributes:
        footage: that it was made of.
        photograph: (H, W, 3) levels of 255; clean: (H, W, 3) of the empty street, likewise.
        removed: (H, W) bool, pixels of removed objects; relit: (H, W) bool, pixels from which only a shadow was taken.
    """

    footage: Footage
    photograph: Levels
    clean: Levels
    removed: Mask
    relit: Mask


@dataclass(frozen=True, eq=False)
class FullSize:
    """What is the same for all frames of a drive.

    Attributes:
        views: of all frames; footage: pictures of the frames' files as they are, by index; coarse: the same, :func:`reduced`.
        lenses: of all frames; exposures: of all frames.
        grain: (H, W) of a frame's file, by index and pixels of the Gaussian that it is finer than, see ``detail.grain_of``.
        ground: the street's, None where there is none; shifts: for its invented parts.
    """

    views: EmptyViews
    footage: Callable[[int], NDArray[Any]]
    coarse: Callable[[int], Float32]
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


def _colors_at(picture: NDArray[Any], mask: Mask) -> Float32:
    """(N, 3) as :func:`as_color`, of the pixels of a mask (H, W) alone."""
    return as_color(picture[mask][:, None])[:, 0]


def put_colors(picture: NDArray[Any], mask: Mask, colors: Float32) -> None:
    """Write colours (N, 3) in [0, 1] into a file's picture where the mask (H, W) is, in its channels and bits; it is opaque there:
    who marks what is to go by transparency wants to see what is put in. A plate, float32, takes what is brighter, too."""
    if picture.dtype == np.float32:
        picture[mask] = colors
        return
    levels = colors * np.float32(np.iinfo(picture.dtype).max)
    np.clip(np.round(levels, out=levels), 0, np.iinfo(picture.dtype).max, out=levels)
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
    part = _box(removed | relit, round(12 * scale))
    removed, relit, at = removed[part], relit[part], at[part]
    original, out = picture[part], picture.copy()
    inside = out[part]
    if relit.any():
        put_colors(inside, relit, _relit(frame, at[relit].astype(np.float64), _colors_at(original, relit)))
    if removed.any():
        put_colors(
            inside, removed, _filled(frame, original, removed, at[removed].astype(np.float64), index, drive, scale)
        )
    return out


def _filled(
    frame: CleanFrame, original: NDArray[Any], removed: Mask, at: Float64, index: int, drive: FullSize, scale: float
) -> Float32:
    """(N, 3) colours of the removed pixels of a box of the footage: the clean frame in full detail, with a seam along the footage.

    Args:
        original: (H, W…) the box as the file has it; removed: (H, W) bool; at: (N, 2) their positions in the working picture.
    """
    colors = _sharpened(frame, original, removed, at, index, drive, scale)
    inward = cv2.distanceTransform(removed.astype(np.uint8), cv2.DIST_L2, 3)[removed]
    border = inward < scale + 1.0
    share = (inward[border] / np.float32(scale + 1.0))[:, None]
    seam = removed.copy()
    seam[removed] = border
    below = _colors_at(original, seam)
    if frame.relit.any():  # beside the object its shadow went, too
        below = _relit(frame, at[border], below)
    colors[border] = _mixed(below, colors[border], share, frame.footage.plate)
    return colors


def _mixed(below: Float32, above: Float32, share: Float32, plate: PlateColours | None) -> Float32:
    """(N, 3) colours above others by their share (N, 1), in linear light as a lens mixes what it does not resolve."""
    colours = plate or ENCODED
    light = colours.linear(below) * (1 - share) + colours.linear(above) * share
    return colours.of_linear(light).astype(np.float32)


def _relit(frame: CleanFrame, at: Float64, original: Float32) -> Float32:
    """(N, 3) colours ``original`` (N, 3) of the footage with the light that the relit pixels around their positions (N, 2) gained.

    Where they gained more than ``RATIOS`` allow, the colour is still theirs, and only the footage's detail is held back: with each
    channel held for itself the shade of a car, which is dark and blue, would stay blue.
    """
    colours = frame.footage.plate or ENCODED
    before, after = (colours.linear(colors_of(p)).astype(np.float32) + DARKEST for p in (frame.photograph, frame.clean))
    weight = frame.relit[..., None].astype(np.float32)
    # Beside them lie pixels of removed objects, whose change is no light.
    share = sample_at(weight, at)
    some = np.maximum(share, 1e-3)
    change, dark, light = (
        sample_at(plane * weight, at) / some for plane in (np.clip(after / before, *RATIOS) - 1, before, after)
    )
    lit = light + (colours.linear(original) + DARKEST - dark) * (1 + change) - DARKEST
    return np.where(share > 1e-3, colours.of_linear(lit), original).astype(np.float32)


def _box(mask: Mask, margin: int) -> tuple[slice, slice]:
    """Rows and columns that hold a mask, with a margin."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return tuple(slice(max(0, int(i[0]) - margin), int(i[-1]) + margin + 1) for i in (rows, columns))  # type: ignore[return-value]


def _sharpened(
    frame: CleanFrame, original: NDArray[Any], removed: Mask, at: Float64, index: int, drive: FullSize, scale: float
) -> Float32:
    """(N, 3) the clean frame at removed pixels, with all detail that is known of it; arguments as of :func:`_filled`."""
    view = drive.views.frames[index]
    # A pixel of the footage lies between four of working size, one of which is removed.
    asked = cv2.dilate(frame.removed.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    ground = seen_ground(view.camera, asked, drive.ground)
    detail, sources = _detail(frame, asked, ground, index, drive)
    colors = sample_at(colors_of(frame.clean), at, cv2.INTER_CUBIC)
    depth = sample_at(view.depth, at, cv2.INTER_NEAREST)[:, 0].astype(np.float64)
    met = ground.met(at)
    on_ground = ground_before(met[:, 0], depth)
    depth = np.where(on_ground, met[:, 0], depth)
    source, difference, believed = detail.at(at)
    for k, j in enumerate(sources):
        mine = np.flatnonzero(source == k)
        if len(mine):
            points = view.camera.centre + depth[mine, None] * view.camera.rays_at(at[mine])
            pixels, _ = footage_positions(drive.lenses[j], points)
            fine = in_exposure(_sampled(drive.footage(j), pixels), drive.exposures[j], drive.exposures[index])
            colors[mine] += believed[mine, None] * (fine + difference[mine] - colors[mine])
    grain = _ground_grain(met[:, 1:], on_ground & (believed < 1), index, drive, sources, scale)
    if on("sensor_noise"):
        noise = sensor_noise(original, ~removed, scale, seed=index)[removed]
        grain = np.where(np.isnan(grain), noise, grain)
    else:
        grain = np.nan_to_num(grain)
    colors += ((1 - believed) * grain)[:, None]
    return colors


def _detail(
    frame: CleanFrame, asked: Mask, ground: SeenGround, index: int, drive: FullSize
) -> tuple[Detail, list[int]]:
    """Where the detail of a clean frame comes from, and the frames that it numbers, the best first.

    Args:
        asked: (h, w) bool, pixels of working size.
    """
    camera, view = drive.views.cameras[index], drive.views.frames[index]
    where: tuple[NDArray[np.int64], ...] = np.nonzero(asked)
    at = np.stack([where[1], where[0]], axis=1).astype(np.float64) + 0.5
    met, depth = ground.met(at), view.depth[asked].astype(np.float64)
    on_ground = ground_before(met[:, 0], depth)
    depth = np.where(on_ground, met[:, 0], depth)
    known = depth > 0
    if drive.shifts is not None:
        known[on_ground] &= ~drive.shifts.is_made(met[on_ground, 1:])
    where, depth = tuple(i[known] for i in where), depth[known]
    points = camera.centre + depth[:, None] * camera.rays_at(at[known])
    sources = choose_sources(points, index, drive.views, SOURCES)
    part = _box(asked, round(4 * FINER_THAN)) if asked.any() else np.s_[:, :]
    best = BestSource(colors_of(frame.clean[part]))
    for k, j in enumerate(sources if on("footage_detail") else ()):
        seen, _, there = sees(drive.views.frames[j], points)
        if len(seen):
            picture, finer = np.zeros((*asked.shape, 3), np.float32), np.zeros(asked.shape, np.float32)
            pixel = tuple(i[seen] for i in where)
            coarse, of_file = drive.coarse(j), drive.lenses[j].camera
            pixels, _ = footage_positions(drive.lenses[j], points[seen])
            colors = sample_at(coarse, pixels * (coarse.shape[1] / of_file.width, coarse.shape[0] / of_file.height))
            picture[pixel] = in_exposure(colors, drive.exposures[j], drive.exposures[index])
            finer[pixel] = np.minimum(depth[seen] / camera.fx / (there / drive.views.cameras[j].fx), FINER)
            best.add(k, picture[part], finer[part])
    found = best.found
    whole = Detail(
        np.full(asked.shape, -1, np.int32), np.zeros((*asked.shape, 3), np.float32), np.zeros(asked.shape, np.float32)
    )
    whole.source[part], whole.difference[part], whole.believed[part] = found.source, found.difference, found.believed
    return whole, sources


def reduced(picture: NDArray[Any], footage: Footage, camera: Camera) -> Float32:
    """(h, w, 3) float32 a footage's picture, in its own lens, no finer than its working picture.

    Args:
        camera: of working size.
    """
    factor = min(1.0, camera.width / footage.camera.width)
    size = tuple(max(1, round(side * factor)) for side in picture.shape[1::-1])
    return as_color(picture if factor == 1.0 else cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


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
    street: Float64, asked: Mask, index: int, drive: FullSize, sources: Sequence[int], scale: float
) -> Float32:
    """(N,) grain of ground that nobody saw, from ground of its kind a shift away; NaN where there is none.

    Args:
        street: (N, 2) street coordinates of the removed pixels; asked: (N,) bool, which of them are looked for.
    """
    found = np.full(len(street), np.nan, np.float32)
    if drive.ground is None or drive.shifts is None or not asked.any() or not on("ground_grain"):
        return found
    some = np.flatnonzero(asked)
    moved = drive.shifts.at(street[some])
    known = np.isfinite(moved[:, 0])
    some = some[known]
    points = ground_points(drive.ground, street[some] + moved[known])
    for j in (index, *sources[:GRAIN_SOURCES]):
        seen = sees(drive.views.frames[j], points)[0]
        if len(seen):
            pixels, _ = footage_positions(drive.lenses[j], points[seen])
            found[some[seen]] = sample_at(drive.grain(j, FINER_THAN * scale), pixels, cv2.INTER_CUBIC)[:, 0]
            left = np.ones(len(some), dtype=bool)
            left[seen] = False
            some, points = some[left], points[left]
    return found

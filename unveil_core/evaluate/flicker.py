"""Flicker: how much a cleaned region changes from one frame to the next where the street itself does not.

The temporal warping error of Lai et al., *Learning blind video temporal consistency* (ECCV 2018), section 4.2: consecutive
frames, one warped into the other, mean squared difference over the pixels that both show. They warp by optical flow of the
input; here the street stands still and its depth is known, so the warp follows from depth and cameras, and never from the
pictures that are judged. What a warp costs by itself (it interpolates between pixels) shows in the true pictures, measured
in the same way: their value is the floor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_instance_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Frame
from unveil_core.geometry.camera import Camera

__all__ = ["DepthGrid", "Matches", "differences", "match_pixels", "measure_flicker", "read_depth"]


AGREEMENT = 0.03
"""Depths within this share of each other are of one surface."""
STEPS_A_METRE = 256
"""Of depth images, as KITTI keeps them."""


@dataclass(frozen=True, eq=False)
class DepthGrid:
    """Depth of every n-th pixel of a picture.

    Attributes:
        camera: of the whole picture.
        depth: (h, w) along the optical axis, metres; 0 where there is none.
        step: n; sample k belongs to pixel ``step * k + step - 1``, along rows and columns alike.
    """

    camera: Camera
    depth: NDArray[np.floating]
    step: int = 1

    def pixels(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows (h,) and columns (w,) of the picture that the samples belong to."""
        return tuple(self.step * np.arange(n) + self.step - 1 for n in self.depth.shape)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class Matches:
    """M pixels of one picture, and where another shows the same surface.

    Attributes:
        rows, columns: (M,) int64 in the one.
        x, y: (M,) float64 in the other, pixel centres at + 0.5.
    """

    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


def read_depth(path: Path, camera: Camera) -> DepthGrid:
    """A 16-bit depth image with 256 steps a metre and 0 for none.

    As large as the picture or a whole number of times smaller it is used as it is; of another size it is read between its
    samples where these are of one surface.

    Args:
        camera: of the picture.
    Raises:
        DriveError: it cannot be read.
    """
    depth = read_instance_image(path).astype(np.float64) / STEPS_A_METRE
    step = max(1, camera.width // depth.shape[1])
    if (camera.height / step, camera.width / step) != depth.shape:
        step = 1
        depth = _at_size(depth, camera.height, camera.width)
    return DepthGrid(camera, depth, step)


def _at_size(depth: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """(height, width) of a depth image (h, w) at pixel centres: between samples of one surface inverse depth, which is linear
    over a plane; across an edge, or beside a sample without depth, the nearest sample."""
    rows, columns = (
        (np.arange(n) + 0.5) * have / n - 0.5 for n, have in zip((height, width), depth.shape, strict=True)
    )
    near = depth[np.clip(np.round(rows), 0, None).astype(int)[:, None], np.clip(np.round(columns), 0, None).astype(int)]
    v, u = (p.ravel() for p in np.meshgrid(rows, columns, indexing="ij"))
    inverse = np.where(depth > 0, 1.0 / np.where(depth > 0, depth, 1.0), np.nan)
    around = np.stack([inverse, inverse**2], axis=-1)
    mean, square = _sampled(around, u, v).reshape(height, width, 2).transpose(2, 0, 1)
    with np.errstate(invalid="ignore"):
        # One surface: the neighbours lie within what two frames may disagree by, on either side of their mean.
        alike = square - mean**2 < (AGREEMENT * mean) ** 2
        return np.where(alike, 1.0 / np.where(alike, mean, 1.0), near)


def match_pixels(one: DepthGrid, other: DepthGrid, region: Mask) -> Matches:
    """Which pixels inside ``region`` (H, W) of one picture the other shows too, by both depths.

    Only pixels with a depth of their own count. The depth of the other is interpolated as inverse depth, which is linear
    over a plane; across an edge that agrees with neither side, so what is hidden there, or half hidden, does not count.
    """
    rows, columns = one.pixels()
    row, column = np.meshgrid(rows, columns, indexing="ij")
    good = region[row, column] & (one.depth > 0) & np.isfinite(one.depth)
    row, column = row[good], column[good]
    points = one.camera.centre + one.depth[good][:, None] * one.camera.rays()[row, column]
    pixel, depth = other.camera.project(points)
    x, y = pixel[:, 0], pixel[:, 1]
    with np.errstate(invalid="ignore"):
        inside = (depth > 0) & (x >= 0.5) & (x <= other.camera.width - 0.5)
        inside &= (y >= 0.5) & (y <= other.camera.height - 0.5)
    row, column, x, y, depth = row[inside], column[inside], x[inside], y[inside], depth[inside]
    there = (other.depth > 0) & np.isfinite(other.depth)
    inverse = np.where(there, 1.0 / np.where(there, other.depth, 1.0), np.nan)
    # In samples, whose centres lie at whole numbers; pixels beyond the outermost sample's centre use the outermost.
    u, v = ((p - 0.5 - (other.step - 1)) / other.step for p in (x, y))
    with np.errstate(invalid="ignore"):
        seen = np.abs(depth * _sampled(inverse[..., None], u, v)[:, 0] - 1) < AGREEMENT
    return Matches(row[seen], column[seen], x[seen], y[seen])


def differences(one: Picture, other: Picture, matches: Matches) -> NDArray[np.float64]:
    """(M, 3) what the other picture shows less what the one shows, levels of 255."""
    warped = _sampled(other.astype(np.float64), matches.x - 0.5, matches.y - 0.5)
    return warped - one[matches.rows, matches.columns]


def _sampled(values: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """(M, C) of values (H, W, C), bilinear at columns x and rows y, whose pixel centres are whole numbers."""
    height, width = values.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, top = np.minimum(x.astype(np.int64), max(0, width - 2)), np.minimum(y.astype(np.int64), max(0, height - 2))
    right, low = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    a, b = (x - left)[:, None], (y - top)[:, None]
    # A neighbour of no weight must not spoil the sum where it has no value.
    parts = [
        np.where(weight > 0, weight * values[r, c], 0.0)
        for r, c, weight in (
            (top, left, (1 - a) * (1 - b)), (top, right, a * (1 - b)), (low, left, (1 - a) * b), (low, right, a * b),
        )
    ]  # fmt: skip
    return parts[0] + parts[1] + parts[2] + parts[3]


# ------------------------------------------------------------------------------------------------------------- whole drive


@dataclass
class _Sums:
    absolute: float = 0.0
    squared: float = 0.0
    values: int = 0
    pairs: int = 0


@dataclass(frozen=True, eq=False)
class _View:
    grid: DepthGrid
    region: Mask
    pictures: Mapping[str, Picture]


def measure_flicker(
    frames: Sequence[Frame],
    depth_of: Callable[[Frame], DepthGrid | None],
    region_of: Callable[[Frame], Mask | None],
    pictures_of: Callable[[Frame], Mapping[str, Picture]],
    progress: Progress = no_progress,
    checkpoint: Checkpoint | None = None,
) -> dict[str, Any]:
    """The warping error of several methods over the consecutive frames of each camera, warped into each other both ways.

    Args:
        frames: in the order of time per camera.
        depth_of: depth of the *empty* street as a frame sees it, None where it is not known.
        region_of: (H, W) pixels that count, None or all False for none.
        pictures_of: (H, W, 3) by method; a method that lacks either frame of a pair is not measured there.
        progress: called per frame.
        checkpoint: of the sums; a call that was interrupted goes on with them.
    Returns:
        ``pairs`` of frames, ``pixels`` compared, and per method of ``methods`` the means over pixels and channels
        ``absolute`` (levels of 255) and ``squared`` (levels squared) with its own number of ``pairs``. Empty where no two
        frames show the same place of the region.
    """
    sums: dict[str, _Sums] = {}
    first = pairs = pixels = 0
    checkpoint = checkpoint or Checkpoint()
    if saved := checkpoint.load():
        first, pairs, pixels = (saved[1][name] for name in ("first", "pairs", "pixels"))
        sums = {name: _Sums(**values) for name, values in saved[1]["sums"].items()}
    views = _neighbours(frames, first, depth_of, region_of, pictures_of)
    for done, (before, now) in enumerate(views, start=first):
        progress(done + 1, len(frames), "measuring flicker")
        if checkpoint.due():
            by_method = {name: asdict(of) for name, of in sums.items()}
            checkpoint.save({}, {"first": done, "pairs": pairs, "pixels": pixels, "sums": by_method})
        if before is None or now is None:
            continue
        found = [(before, now, match_pixels(before.grid, now.grid, before.region))]
        found += [(now, before, match_pixels(now.grid, before.grid, now.region))]
        count = sum(len(m.rows) for _, _, m in found)
        if not count:
            continue
        pairs, pixels = pairs + 1, pixels + count
        for method in before.pictures.keys() & now.pictures.keys():
            own = sums.setdefault(method, _Sums())
            own.pairs += 1
            for one, other, matches in found:
                change = differences(one.pictures[method], other.pictures[method], matches)
                own.absolute += float(np.abs(change).sum())
                own.squared += float(np.square(change).sum())
                own.values += change.size
    if not pairs:
        return {}
    methods = {
        name: {"absolute": s.absolute / s.values, "squared": s.squared / s.values, "pairs": s.pairs}
        for name, s in sorted(sums.items())
    }
    return {"pairs": pairs, "pixels": pixels, "methods": methods}


def _neighbours(
    frames: Sequence[Frame],
    first: int,
    depth_of: Callable[[Frame], DepthGrid | None],
    region_of: Callable[[Frame], Mask | None],
    pictures_of: Callable[[Frame], Mapping[str, Picture]],
) -> Iterator[tuple[_View | None, _View | None]]:
    """Each frame with the one before it of the same camera; only two frames' pictures are held at a time.

    Args:
        first: of them, camera after camera, to begin with.
    """
    in_order = [f for camera in dict.fromkeys(f.camera_name for f in frames) for f in frames if f.camera_name == camera]

    def view(frame: Frame) -> _View | None:
        region, grid = region_of(frame), depth_of(frame)
        return None if region is None or grid is None else _View(grid, region, pictures_of(frame))

    before: _View | None = view(in_order[first - 1]) if first else None
    for k in range(first, len(in_order)):
        if k and in_order[k].camera_name != in_order[k - 1].camera_name:
            before = None
        now = view(in_order[k])
        yield before, now
        before = now

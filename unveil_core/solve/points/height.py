"""Height of the cameras above the street, by the plane on which two frames show the same.

Points on smooth asphalt are few, and flow across it follows whatever it is begun from. But a piece of street ahead of the camera,
seen from two places, has grain enough as a whole: brought onto the right plane both frames agree, on any other they do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.geometry.camera import Camera
from unveil_core.solve.points.cloud import compared_frames
from unveil_core.solve.points.flow import Looked

__all__ = ["street_height", "swept_height"]

PAIRS = 12
"""Pairs of frames that are looked at, over the whole way."""

LENGTHS = 5.0
"""Of the piece of street, from where both frames show it, in heights of the camera."""
FARTHEST = 8.0
"""Where it begins at most."""
ASIDE = 0.7
"""Of it to either side of the way."""
CELLS = (72, 24)
"""Places on it, along and across."""
TRIED = np.linspace(0.8, 1.25, 46)
"""Heights that are tried, of the rough one."""
SLOPES = np.radians(np.linspace(-2.5, 2.5, 21))
"""Slopes of the street against what is level that are tried, for all frames: up is known to a degree or so."""
LEAST = 0.25
"""Correlation that the best plane reaches at least, at the mean over pairs."""


def street_height(
    cameras: Sequence[Camera],
    tracks: Sequence[Sequence[int]],
    picture: Callable[[int], tuple[Picture, Mask | None]],
    up: Float64,
    roughly: float,
) -> float | None:
    """Height of the cameras of a drive above the street, in units of their positions; None where no plane is clearly better.

    Args:
        cameras, tracks, picture, up: as :func:`unveil_core.solve.points.cloud.dense_points` takes them; roughly: the height.
    """
    chosen = [(i, others[-1]) for track in tracks[:1] for i, others in compared_frames(cameras, track, roughly)]
    chosen = chosen[:: max(1, len(chosen) // PAIRS)]

    def looked(i: int) -> Looked:
        return Looked(cameras[i], cv2.cvtColor(picture(i)[0], cv2.COLOR_RGB2GRAY))

    return swept_height([(looked(a), looked(b)) for a, b in chosen], up, roughly)


def swept_height(pairs: Sequence[tuple[Looked, Looked]], up: Float64, roughly: float) -> float | None:
    """Height of the cameras above the street ahead, in units of their positions; None where no plane is clearly better.

    Args:
        pairs: frames and a neighbour each, a height or so apart; up: (3,) unit; roughly: the height.
    """
    scores = [s for a, b in pairs if (s := _scores(a, b, up, roughly)) is not None]
    if len(scores) < 3:
        return None
    mean = np.mean(scores, axis=0)
    k, slope = np.unravel_index(int(np.argmax(mean)), mean.shape)
    by_height = mean[:, slope]
    if by_height[k] < LEAST or not 0 < k < len(TRIED) - 1:
        return None
    before, here, after = by_height[k - 1 : k + 2]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(roughly * (TRIED[int(k)] + shift * (TRIED[1] - TRIED[0])))


def _scores(first: Looked, second: Looked, up: Float64, roughly: float) -> Float64 | None:
    """(heights, slopes) correlation of two frames on each plane; None where they do not both show the street ahead."""
    ahead = second.camera.centre - first.camera.centre
    if ahead @ first.camera.forward < 0:
        first, second, ahead = second, first, -ahead
    ahead = ahead - (ahead @ up) * up
    if np.linalg.norm(ahead) < 0.1 * roughly:
        return None
    ahead = ahead / np.linalg.norm(ahead)
    aside = np.cross(ahead, up)
    starts = np.arange(1.0, FARTHEST, 0.25) * roughly
    begin = next((s for s in starts if _shown(first.camera, second.camera, up, ahead, aside, s, roughly)), None)
    if begin is None:
        return None
    along = np.linspace(begin, begin + LENGTHS * roughly, CELLS[0])
    across = np.linspace(-ASIDE, ASIDE, CELLS[1]) * roughly
    level = along[:, None, None] * ahead + across[None, :, None] * aside
    found = np.zeros((len(TRIED), len(SLOPES)))
    for i, share in enumerate(TRIED):
        for j, slope in enumerate(SLOPES):
            drop = share * roughly - along * np.tan(slope)
            places = (first.camera.centre + level - drop[:, None, None] * up).reshape(-1, 3)
            found[i, j] = _alike(_seen(first, places), _seen(second, places))
    return found


def _shown(
    first: Camera, second: Camera, up: Float64, ahead: Float64, aside: Float64, start: float, height: float
) -> bool:
    """Whether both cameras show the near edge of the piece."""
    edge = np.stack([first.centre + start * ahead + s * ASIDE * height * aside - height * up for s in (-1, 1)])
    return all(bool(c.in_picture(*c.project(edge)).all()) for c in (first, second))


def _seen(looked: Looked, places: Float64) -> Float64:
    """(along, across) grey of places; the slow change of light is taken out."""
    pixels, _ = looked.camera.project(places)
    at = (pixels - 0.5).astype(np.float32).reshape(*CELLS, 2)
    grey = cv2.remap(looked.grey, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    grey = grey.astype(np.float64)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), 4))


def _alike(first: Float64, second: Float64) -> float:
    size = float(np.sqrt((first**2).sum() * (second**2).sum()))
    return float((first * second).sum()) / size if size > 0 else 0.0

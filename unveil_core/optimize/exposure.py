"""Exposure and white balance of every photograph, fitted before the scene is.

What is not explained here would be explained by floaters before single cameras and by seams where a frame's hole is filled
from others. The drive's points tell it: one point has one colour, whichever frame shows it. Gains and biases of the frames
and colours of the points are fitted together, robustly, as in panorama stitching (Brown and Lowe 2007, section 6) with an
affine model in place of the gain; a drive whose camera held still keeps its photographs as they are, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from unveil_core.base.files import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposure, Exposures
from unveil_core.semantics.visibility import points_in_view
from unveil_core.surfels.initialize import estimate_normals, thin_points

__all__ = ["affine_between", "fit_exposures"]

HIDING_POINTS = 40_000
"""Number of points at most that are tested for occluding each other."""
SAMPLES, SAMPLES_PER_VIEW = 60_000, 250
"""About how many samples are used for a drive, and for each view of a long one."""
DARKEST, BRIGHTEST = 3, 250
"""Samples at or beyond these levels of 255 may be clipped and are not used for the gain."""
FEWEST_SAMPLES = 30
"""A frame with fewer gets its exposure from its neighbours in time."""
GAIN_PRIOR, BIAS_PRIOR = 1.0, 20.0
"""Pull towards gain 1 and bias 0, in samples of white. Cameras change their gain; a bias is rare, and small."""
BLUR_SHARE = 1 / 400
"""Poses and points are off by about this share of the image's width, at most two pixels: so much it is blurred."""
ROUNDS, SMALL_STEP = 12, 3e-4
CAP = 0.1
"""A residual of more than this is an occlusion or a reflection, and counts no more than this, in [0, 1]."""
LEAST_GAIN, LEAST_SPREAD = 0.10, 0.02
"""The model is used where it takes more than this share of the error away, and where mid grey differs by more than this."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """What the views show of the points: colours (M, 3) in [0, 1], point (M,) and view (M,) of each."""

    color: Float64
    point: NDArray[np.int64]
    view: NDArray[np.int64]

    def where(self, keep: NDArray[np.bool_]) -> _Samples:
        return _Samples(self.color[keep], self.point[keep], self.view[keep])


def _sampled(drive: Drive, hidden: Sequence[NDArray[np.bool_]] | None, progress: Progress) -> _Samples:
    """Colours of points that at least two views see well exposed."""
    positions = drive.points.positions
    cell = 0.02
    while len(positions) > HIDING_POINTS:
        positions = positions[thin_points(positions, cell)]
        cell *= 1.3
    cameras = [f.camera for f in drive.frames]
    normals, spacing = estimate_normals(positions, np.stack([c.centre for c in cameras]))
    spacing = np.minimum(spacing, 4 * np.median(spacing))
    found = []
    for v, frame in enumerate(drive.frames):
        seen = points_in_view(positions, spacing, frame.camera, near=NEAR_M, normals=normals)
        blur = min(2.0, BLUR_SHARE * frame.camera.width)
        color = cv2.GaussianBlur(read_image(frame.image_path), (0, 0), blur)[seen.rows, seen.columns]
        good = (color > DARKEST).all(axis=1) & (color < BRIGHTEST).all(axis=1)
        if hidden is not None:
            good &= ~hidden[v][seen.rows, seen.columns]
        found.append(_Samples(color[good] / 255.0, seen.index[good], np.full(int(good.sum()), v)))
        progress(v + 1, len(cameras), "comparing exposures")
    every = _Samples(*(np.concatenate([getattr(s, n) for s in found]) for n in ("color", "point", "view")))
    times = np.bincount(every.point, minlength=len(positions))
    shared = np.flatnonzero(times > 1)
    enough = max(SAMPLES, SAMPLES_PER_VIEW * len(cameras))
    shared = shared[:: max(1, round(int(times[shared].sum()) / enough))]
    number = np.full(len(positions), -1)
    number[shared] = np.arange(len(shared))
    return _Samples(every.color, number[every.point], every.view).where(number[every.point] >= 0)


def _robust(residual: Float64) -> Float64:
    """Huber's weights, with the scale of most residuals."""
    scale = max(0.005, 1.4826 * float(np.median(np.abs(residual))))
    weight: Float64 = np.minimum(1.0, 1.345 * scale / np.maximum(np.abs(residual), 1e-12))
    return weight


def _point_colors(
    value: Float64, samples: _Samples, gain: Float64, bias: Float64, rounds: int = 3
) -> tuple[Float64, Float64]:
    """Colours of the points in one channel for given exposures, and the robust weights (M,) of the samples."""
    g = gain[samples.view]
    weight = np.ones(len(value))
    color = np.zeros(0)
    for _ in range(rounds):
        above = np.bincount(samples.point, weight * g * (value - bias[samples.view]))
        color = above / np.maximum(np.bincount(samples.point, weight * g * g), 1e-12)
        weight = _robust(g * color[samples.point] + bias[samples.view] - value)
    return color, weight


def _fitted_channel(value: Float64, samples: _Samples, views: int) -> tuple[Float64, Float64]:
    """Gain (V,) and bias (V,) of one channel, by Gauss-Newton steps with the points' colours eliminated.

    A drive is a chain of views, each of which overlaps with the next few: to alternate between views and points would carry
    a change along it one link at a time.
    """
    gain, bias = np.ones(views), np.zeros(views)
    count = len(value)
    row = np.arange(count)
    for _ in range(ROUNDS):
        color, weight = _point_colors(value, samples, gain, bias)
        g, c = gain[samples.view], color[samples.point]
        residual = value - g * c - bias[samples.view]
        of_view = csr_array(
            (
                np.concatenate([c, np.ones(count)]),
                (np.concatenate([row, row]), np.concatenate([samples.view, samples.view + views])),
            ),
            shape=(count, 2 * views),
        )
        of_point = csr_array((g, (row, samples.point)), shape=(count, len(color)))
        weighted = of_view.multiply(weight[:, None]).tocsr()
        cross = (weighted.T @ of_point).tocsr()
        inverse = 1.0 / np.maximum(np.bincount(samples.point, weight * g * g, minlength=len(color)), 1e-12)
        normal = (weighted.T @ of_view - cross.multiply(inverse[None]) @ cross.T).toarray()
        prior = np.repeat([GAIN_PRIOR, BIAS_PRIOR], views)
        right = weighted.T @ residual - cross @ (inverse * (of_point.T @ (weight * residual)))
        right -= prior * np.concatenate([gain - 1, bias])
        step = np.linalg.solve(normal + np.diag(prior), right)
        before = gain
        gain, bias = np.clip(gain + step[:views], 0.05, 20.0), bias + step[views:]
        # Scale and shift of the canonical colours are free: mean log gain and mean bias are nought.
        gain = gain / np.exp(np.log(gain).mean())
        bias = bias - gain * (bias.mean() / gain.mean())
        if np.abs(gain - before).max() < SMALL_STEP:
            break
    # What a solver's last bits are hangs on its threads; the colours of a scene must not.
    return gain.round(5), bias.round(5)


def _fitted(samples: _Samples, views: int) -> tuple[Float64, Float64, NDArray[np.bool_]]:
    """Gains (V, 3), biases (V, 3), and which views (V,) had samples enough for their own."""
    enough = np.bincount(samples.view, minlength=views) >= FEWEST_SAMPLES
    gain, bias = np.ones((views, 3)), np.zeros((views, 3))
    used = samples.where(enough[samples.view])
    if enough.sum() < 2:
        return gain, bias, np.zeros(views, bool)
    dense = _Samples(used.color, used.point, (np.cumsum(enough) - 1)[used.view])
    for channel in range(3):
        own = _fitted_channel(np.ascontiguousarray(dense.color[:, channel]), dense, int(enough.sum()))
        gain[enough, channel], bias[enough, channel] = own
    return gain, bias, enough


def _error(samples: _Samples, gain: Float64, bias: Float64) -> float:
    """RMS of the residuals in [0, 1], none counted beyond ``CAP``, with the points' best colours."""
    squares = []
    for channel in range(3):
        value, g, b = samples.color[:, channel], gain[:, channel], bias[:, channel]
        color, _ = _point_colors(value, samples, g, b)
        residual = g[samples.view] * color[samples.point] + b[samples.view] - value
        squares.append(np.minimum(residual**2, CAP**2))
    return float(np.sqrt(np.mean(squares)))


def fit_exposures(
    drive: Drive, *, hidden: Sequence[NDArray[np.bool_]] | None = None, progress: Progress = no_progress
) -> Exposures:
    """Gain and bias of every photograph, or the identity for all where these explain little.

    Half of the points are fitted; the other half decide.

    Args:
        drive: an imported drive.
        hidden: (H, W) per frame, pixels that show what does not stand; None = no such pixels.
        progress: called per frame.
    Returns:
        exposures of all frames, none where the identity was chosen. ``figures`` has ``used``, ``points``, ``samples``, and
        where there were samples enough ``rms_without`` and ``rms_with`` (of the points that decide, sRGB in [0, 1]) and
        ``spread`` (brightest over darkest photograph of mid grey, less 1).
    """
    views = len(drive.frames)
    samples = _sampled(drive, hidden, progress)
    facts: dict[str, object] = {"used": False, "points": len(np.unique(samples.point)), "samples": len(samples.point)}
    first = samples.point % 2 == 0
    gain, bias, enough = _fitted(samples.where(first), views)
    judges = samples.where(~first & enough[samples.view])
    if not len(judges.point):
        return Exposures({}, facts)
    without, with_model = _error(judges, np.ones_like(gain), np.zeros_like(bias)), _error(judges, gain, bias)
    grey = np.maximum(0.5 * gain + bias, 1e-3)[enough]
    spread = float((grey.max(axis=0) / grey.min(axis=0)).max() - 1)
    facts |= {"rms_without": round(without, 5), "rms_with": round(with_model, 5), "spread": round(spread, 4)}
    if with_model > (1 - LEAST_GAIN) * without or spread < LEAST_SPREAD:
        return Exposures({}, facts)
    gain, bias, enough = _fitted(samples, views)
    known = {}
    for name in dict.fromkeys(f.camera_name for f in drive.frames):
        track = np.array([v for v, f in enumerate(drive.frames) if f.camera_name == name])
        own = track[enough[track]]
        for v in track:
            if len(own):
                g, b = (np.array([np.interp(v, own, x[own, c]) for c in range(3)]) for x in (gain, bias))
            else:
                g, b = np.ones(3), np.zeros(3)
            known[name, drive.frames[v].name] = Exposure(g, b)
    return Exposures(known, facts | {"used": True})


def affine_between(canonical: Float64, photograph: NDArray[np.uint8]) -> tuple[Float64, Float64]:
    """Gain (3,) and bias (3,) that bring a picture nearest to a photograph, by least squares over what is not clipped.

    Args:
        canonical: (H, W, 3) in [0, 1]; photograph: (H, W, 3) uint8.
    """
    gain, bias = np.ones(3), np.zeros(3)
    good = ((photograph > DARKEST) & (photograph < BRIGHTEST)).all(axis=2)
    for channel in range(3):
        x, y = canonical[good, channel], photograph[good, channel] / 255.0
        if len(x) >= FEWEST_SAMPLES and np.ptp(x) > 0:
            gain[channel] = np.cov(x, y, bias=True)[0, 1] / x.var()
            bias[channel] = y.mean() - gain[channel] * x.mean()
    return gain, bias

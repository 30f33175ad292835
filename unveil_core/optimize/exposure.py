"""Exposure and white balance of every photograph, fitted before the scene is.

What is not explained here would be explained by floaters before single cameras and by seams where a frame's hole is filled
from others. The drive's points tell it: one point has one colour, whichever frame shows it. Gains and biases of the frames
and colours of the points are fitted together, robustly, as in panorama stitching (Brown and Lowe 2007, section 6) with an
affine model in place of the gain; a drive whose camera held still keeps its photographs as they are, bit for bit.

A camera of a rig that held still has one exposure for all its photographs: what a side camera shares with the others is little,
and enough for that; frame by frame it would not be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, tracks
from unveil_core.drives.exposure import Exposure, Exposures
from unveil_core.geometry.fields.robust import MAD_TO_DEVIATION
from unveil_core.optimize.shared_colours import (
    BRIGHTEST,
    DARKEST,
    Samples,
    camera_numbers,
    sample_colours,
    seen_by_several,
)

__all__ = ["affine_between", "fit_exposures"]

FEWEST_SAMPLES = 30
"""A frame with fewer gets its exposure from its neighbours in time."""
GAIN_PRIOR, BIAS_PRIOR = 1.0, 20.0
"""Pull towards gain 1 and bias 0, in samples of white. Cameras change their gain; a bias is rare, and small."""
ROUNDS, SMALL_STEP = 12, 3e-4
CAP = 0.1
"""A residual of more than this is an occlusion or a reflection, and counts no more than this, in [0, 1]."""
LEAST_GAIN, LEAST_SPREAD = 0.10, 0.02
"""The model is used where it takes more than this share of the error away, and where mid grey differs by more than this."""


def _robust(residual: Float64) -> Float64:
    """Huber's weights, with the scale of most residuals."""
    scale = max(0.005, MAD_TO_DEVIATION * float(np.median(np.abs(residual))))
    weight: Float64 = np.minimum(1.0, 1.345 * scale / np.maximum(np.abs(residual), 1e-12))
    return weight


def _point_colors(
    value: Float64, samples: Samples, gain: Float64, bias: Float64, rounds: int = 3
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


def _fitted_channel(value: Float64, samples: Samples, views: int) -> tuple[Float64, Float64]:
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
        normal = weighted.T @ of_view - cross.multiply(inverse[None]) @ cross.T
        prior = np.repeat([GAIN_PRIOR, BIAS_PRIOR], views)
        right = weighted.T @ residual - cross @ (inverse * (of_point.T @ (weight * residual)))
        right -= prior * np.concatenate([gain - 1, bias])
        # Only views that see the same points have an entry together: the cost is linear in the length of the drive.
        step = splu(csc_array(normal + diags_array(prior)), permc_spec="MMD_AT_PLUS_A").solve(right)
        before = gain
        gain, bias = np.clip(gain + step[:views], 0.05, 20.0), bias + step[views:]
        # Scale and shift of the canonical colours are free: mean log gain and mean bias are nought.
        gain = gain / np.exp(np.log(gain).mean())
        bias = bias - gain * (bias.mean() / gain.mean())
        if np.abs(gain - before).max() < SMALL_STEP:
            break
    # What a solver's last bits are hangs on its threads; the colours of a scene must not.
    return gain.round(5), bias.round(5)


@dataclass(frozen=True, eq=False)
class _Model:
    """Gains (V, 3) and biases (V, 3), and which views (V,) had samples enough for them."""

    gain: Float64
    bias: Float64
    enough: NDArray[np.bool_]


def _fitted(samples: Samples, group: NDArray[np.int64]) -> _Model:
    """One exposure for each group of views; ``group``: (V,) numbers from 0."""
    count = int(group.max()) + 1
    enough = np.bincount(group[samples.view], minlength=count) >= FEWEST_SAMPLES
    gain, bias = np.ones((count, 3)), np.zeros((count, 3))
    if enough.sum() < 2:
        return _Model(gain[group], bias[group], np.zeros(len(group), bool))
    used = samples.where(enough[group[samples.view]])
    dense = Samples(used.color, used.point, (np.cumsum(enough) - 1)[group[used.view]])
    for channel in range(3):
        own = _fitted_channel(np.ascontiguousarray(dense.color[:, channel]), dense, int(enough.sum()))
        gain[enough, channel], bias[enough, channel] = own
    return _Model(gain[group], bias[group], enough[group])


def _error(samples: Samples, gain: Float64, bias: Float64) -> float:
    """RMS of the residuals in [0, 1], none counted beyond ``CAP``, with the points' best colours."""
    squares = []
    for channel in range(3):
        value, g, b = samples.color[:, channel], gain[:, channel], bias[:, channel]
        color, _ = _point_colors(value, samples, g, b)
        residual = g[samples.view] * color[samples.point] + b[samples.view] - value
        squares.append(np.minimum(residual**2, CAP**2))
    return float(np.sqrt(np.mean(squares)))


def _judged(samples: Samples, group: NDArray[np.int64], counts: NDArray[np.bool_] | None = None) -> dict[str, Any]:
    """How much an exposure for each group of views (V,) explains: half of the points are fitted, the other half decide.

    Args:
        counts: (M,) samples that may decide; None = all.
    Returns:
        the figures of :func:`fit_exposures`; empty where nothing decides.
    """
    first = samples.point % 2 == 0
    model = _fitted(samples.where(first), group)
    deciding = ~first & model.enough[samples.view]
    judges = samples.where(deciding if counts is None else deciding & counts)
    if not len(judges.point):
        return {}
    without = _error(judges, np.ones_like(model.gain), np.zeros_like(model.bias))
    with_model = _error(judges, model.gain, model.bias)
    grey = np.maximum(0.5 * model.gain + model.bias, 1e-3)[model.enough]
    spread = float((grey.max(axis=0) / grey.min(axis=0)).max() - 1)
    return {"rms_without": round(without, 5), "rms_with": round(with_model, 5), "spread": round(spread, 4)}


def _explains(figures: dict[str, Any]) -> bool:
    return (
        bool(figures)
        and figures["rms_with"] <= (1 - LEAST_GAIN) * figures["rms_without"]
        and figures["spread"] >= LEAST_SPREAD
    )


def fit_exposures(
    drive: Drive, *, hidden: Sequence[NDArray[np.bool_]] | None = None, progress: Progress = no_progress
) -> Exposures:
    """Gain and bias of every photograph, or the identity for all where these explain little.

    Half of the points are fitted; the other half decide, for each camera whether its photographs have an exposure each, and for
    the cameras of a rig whether they have different ones.

    Args:
        drive: an imported drive.
        hidden: (H, W) per frame, pixels that show what does not stand; None = no such pixels.
        progress: called per frame.
    Returns:
        exposures of all frames, none where the identity was chosen. ``figures`` has ``used``, ``points``, ``samples``,
        ``by_frame`` (cameras whose photographs have an exposure each), and where there were samples enough ``rms_without`` and
        ``rms_with`` (of the points that decide, sRGB in [0, 1]; of a rig those that several cameras see) and ``spread``
        (brightest over darkest photograph of mid grey, less 1).
    """
    samples = sample_colours(drive, hidden, progress)
    facts: dict[str, Any] = {"used": False, "points": len(np.unique(samples.point)), "samples": len(samples.point)}
    camera = camera_numbers(drive)
    of_camera = camera[samples.view]
    varying, figures = [], {}
    for number, track in enumerate(tracks(drive)):
        figures = _of_one_camera(samples.where(of_camera == number), np.array(track))
        varying += [number] if _explains(figures) else []
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    facts["by_frame"] = [names[number] for number in varying]
    views = np.arange(len(camera))
    group = np.unique(np.where(np.isin(camera, varying), views, len(views) + camera), return_inverse=True)[1].ravel()
    if len(names) > 1:
        joins = seen_by_several(samples.point, of_camera, int(samples.point.max(initial=0)) + 1)
        figures = _judged(samples, group, joins[samples.point])
    facts |= figures
    if not varying and not (len(names) > 1 and _explains(figures)):
        return Exposures({}, facts)
    model = _fitted(samples, group)
    known = {}
    for track in tracks(drive):
        own = np.array(track)[model.enough[track]]
        for v in track:
            if len(own):
                g, b = (np.array([np.interp(v, own, x[own, c]) for c in range(3)]) for x in (model.gain, model.bias))
            else:
                g, b = np.ones(3), np.zeros(3)
            known[drive.frames[v].camera_name, drive.frames[v].name] = Exposure(g, b)
    return Exposures(known, facts | {"used": True})


def _of_one_camera(samples: Samples, track: NDArray[np.int64]) -> dict[str, Any]:
    """How much an exposure for each photograph of one camera explains, by what these share.

    Args:
        samples: of this camera; track: (F,) its views, in order.
    """
    times = np.bincount(samples.point)
    samples = samples.where(times[samples.point] > 1)
    return _judged(replace(samples, view=np.searchsorted(track, samples.view)), np.arange(len(track)))


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

"""From a drive to the full semantic scene: the start, the schedule, the two stages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.kernels.device import current_device
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept, facts_array, facts_of
from unveil_core.base.types import Levels
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.optimize.course import Course
from unveil_core.optimize.presets import MANY_FRAMES, ReconstructSettings
from unveil_core.optimize.start import SKY_ROWS, random_scene, start_scene, start_sky
from unveil_core.optimize.training.card_memory import StepSize, largest_step, place_for, trial_of_degrees
from unveil_core.optimize.training.density import DensitySettings
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import TrainingView, training_view, views_on
from unveil_core.semantics.labels import SceneLabels, labels_of_frames
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import FLATNESS, Surfels, as_ellipsoids

__all__ = ["Reconstruction", "reconstruct", "sky_of_labels"]


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """What :func:`reconstruct` gives.

    Attributes:
        surfels: the scene; sky: behind it.
        choices: JSON-able, what was chosen by which numbers.
    """

    surfels: Surfels
    sky: Sky
    choices: dict[str, Any]


def reconstruct(
    drive: Drive,
    scene: SceneLabels,
    settings: ReconstructSettings,
    *,
    exposures: Exposures | None = None,
    hidden: Sequence[NDArray[np.bool_]] | None = None,
    sky: Sky | None = None,
    own_frames: int = 0,
    seed: int = 0,
    cache: FrameCache | None = None,
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Reconstruction:
    """Fit the full scene, with everything that is to be removed still in it, on the device of the run (``base.kernels.device``).

    Args:
        drive: an imported drive.
        scene: its labels.
        settings: see there.
        exposures: of the photographs, see ``optimize.exposure``; the scene gets their canonical colours.
        hidden: (H, W) per frame, pixels that show what does not stand and count for nothing; None = no such pixels.
        sky: to begin with; None = from these frames.
        own_frames: how many of the frames count for the amount of work; 0 = all.
        seed: order of the views.
        cache: room for the frames.
        kept: where the start and checkpoints are kept, so that an interrupted call is continued by the next.
        progress: called per step with loss and the number of surfels.
    """
    settings = settings.scaled(own_frames or len(drive.frames))
    exposures = exposures or Exposures()
    cache, kept = cache or FrameCache(), kept or Kept()
    images, labels = _pictures(drive, scene, exposures, hidden, cache)

    def start() -> dict[str, NDArray[np.generic]]:
        if settings.random_start:
            return random_scene(drive, scene, labels, settings.start.budget, seed=seed).arrays()
        given = settings.start
        made = start_scene(drive, scene, images, labels, given, hidden=hidden, cache=cache, progress=progress)
        return {**made.surfels.arrays(), "ground": facts_array(made.ground)}

    begun = kept.once("start", start)
    ground = facts_of(begun["ground"]) if "ground" in begun else {}
    surfels = Surfels.from_arrays(begun)
    if settings.ellipsoids:
        surfels = as_ellipsoids(surfels, FLATNESS)
    rows = _sky_rows(settings)
    sky_choice: dict[str, Any] = {}
    if sky is None:
        sky, sky_choice = start_sky(drive, scene, images, labels, surfels, rows, hidden, cache)

    def steps() -> tuple[StepSize, ...]:
        most, cameras = max(len(surfels), settings.budget), [f.camera for f in drive.frames]
        step = largest_step(most, settings.sh_degree, cameras, len(scene.labels))
        return (step,) if "sh_degree" in settings.given else (step, trial_of_degrees(step, len(surfels)))

    place = place_for(current_device(), steps)
    if place.why:
        progress(0, settings.iterations, place.why)
    there = torch.device(place.device.name)
    fine, coarse = (
        views_on(_views(drive, images, labels, hidden, sky, factor, cache), sky, there, room)
        for factor, room in ((1.0, place.fine_bytes), (0.5, place.coarse_bytes))
    )
    training = TrainSettings(
        weights=settings.weights,
        soft_labels=settings.soft_labels,
        prune_opacity=settings.prune_opacity,
        density=DensitySettings(budget=settings.budget),
        near=NEAR_M,
        far=FAR_M,
        kernels=settings.kernels,
        backend=place.device.backend,
    )
    state = Optimization(
        surfels.to(there),
        sky,
        training,
        LearningRates(means=0.004),
        label_count=len(scene.labels),
        sky_label=scene.labels.index("sky"),
        spared_labels=scene.labels.indices(settings.spared),
        seed=seed,
    )
    course = Course(state, fine, coarse, settings, kept.checkpoint("training"), progress)
    surfels, sky = course.run()
    return Reconstruction(
        surfels.to("cpu"),
        sky.to("cpu"),
        {"given": sorted(settings.given), "sky": sky_choice, "ground": ground, **course.choices},
    )


def sky_of_labels(
    drive: Drive,
    scene: SceneLabels,
    settings: ReconstructSettings,
    exposures: Exposures,
    hidden: Sequence[NDArray[np.bool_]] | None,
    cache: FrameCache,
) -> tuple[Sky | None, dict[str, Any]]:
    """The start of the sky from pixels labelled sky, see ``optimize.start.start_sky``; None where nothing labels it.

    Of long drives some frames are enough: a block adds what only it saw.
    """
    if scene.labels.index("sky") is None:
        return None, {}
    some = range(0, len(drive.frames), max(1, len(drive.frames) // MANY_FRAMES))
    part = replace(drive, frames=tuple(drive.frames[i] for i in some))
    without = None if hidden is None else subset(hidden, some)
    images, labels = _pictures(part, scene, exposures, without, cache)
    return start_sky(part, scene, images, labels, None, _sky_rows(settings), without, cache)


def _sky_rows(settings: ReconstructSettings) -> tuple[int, ...]:
    return SKY_ROWS if "sky" not in settings.given else (settings.sky_rows,)


def _pictures(
    drive: Drive,
    scene: SceneLabels,
    exposures: Exposures,
    hidden: Sequence[NDArray[np.bool_]] | None,
    cache: FrameCache,
) -> tuple[Sequence[Levels], Sequence[NDArray[np.int64]]]:
    """Images (H, W, 3) in canonical colours and labels (H, W) of the frames, -1 where ``hidden``."""
    frames = drive.frames
    images = cache.frames(len(frames), lambda i: exposures.read(frames[i]))
    labels = labels_of_frames(frames, scene, cache)
    if hidden is None:
        return images, labels
    return images, Frames(len(frames), lambda i: np.where(hidden[i], -1, labels[i]))


def _views(
    drive: Drive,
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    hidden: Sequence[NDArray[np.bool_]] | None,
    sky: Sky,
    factor: float,
    cache: FrameCache,
) -> Sequence[TrainingView]:
    def view(i: int) -> TrainingView:
        weight = None if hidden is None or not hidden[i].any() else (~hidden[i]).astype(np.float32)
        return training_view(drive.frames[i].camera, images[i], labels[i], weight, sky, factor=factor)

    return cache.frames(len(images), view)

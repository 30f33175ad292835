"""From a drive to the full semantic scene: the start, the schedule, the two stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.optimize.adapt import CHOICES, AdaptSettings, Course, choose_sh_degree
from unveil_core.optimize.density import DensitySettings
from unveil_core.optimize.losses import LossWeights
from unveil_core.optimize.parameters import LearningRates
from unveil_core.optimize.probes import hide, probed_frames
from unveil_core.optimize.scene_range import scene_range
from unveil_core.optimize.schedule import Phase, run_phase
from unveil_core.optimize.start import StartSettings, start_scene, start_sky
from unveil_core.optimize.trainer import Optimization, TrainSettings
from unveil_core.optimize.views import TrainingView, training_view
from unveil_core.progress import Progress, no_progress
from unveil_core.semantics.segment import SceneLabels, frame_labels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["PRESETS", "ReconstructSettings", "Reconstruction", "reconstruct"]

STABLE, FALLEN = 0.5, 1.2
"""How much of the fall of the step sizes is done in the first stage, and at the end of the second: large steps as long as
they help, then smaller and smaller ones (Hu et al., *MiniCPM*, 2024, section 4). So the first stage may end at any time."""


@dataclass(frozen=True)
class ReconstructSettings:
    """How much work a reconstruction may be. Numbers are limits of what is chosen while it runs (see ``adapt``).

    Attributes:
        iterations: steps in all at most; the second stage takes ``geometry_share`` of those that are taken.
        geometry_share: share of the second stage.
        coarse_share: share of the steps that run at half resolution, at most.
        sh_degree: of the surfels' colour.
        sky_rows: of the panorama of the sky.
        start: how fine the start is.
        budget: at most how many surfels density control may reach.
        adapt: when more is worth it.
        given: choices (see ``CHOICES``) that the limit itself decides: the user's, or all of them for a fixed recipe.
        weights: of the losses, the paper's by default.
        spared: class names that opacity pruning leaves alone (the paper: sky and vegetation).
    """

    iterations: int = 2000
    geometry_share: float = 0.35
    coarse_share: float = 0.3
    sh_degree: int = 2
    sky_rows: int = 128
    start: StartSettings = field(default_factory=StartSettings)
    budget: int = 150_000
    adapt: AdaptSettings = field(default_factory=AdaptSettings)
    given: frozenset[str] = frozenset()
    weights: LossWeights = field(default_factory=LossWeights)
    spared: tuple[str, ...] = ("vegetation",)


PRESETS: dict[str, ReconstructSettings] = {
    "draft": ReconstructSettings(
        iterations=450, sh_degree=1, start=StartSettings(budget=40_000), budget=60_000, adapt=AdaptSettings(least_gain=0.3)
    ),
    "standard": ReconstructSettings(),
    "high": ReconstructSettings(
        iterations=6000, sh_degree=3, start=StartSettings(budget=90_000), budget=300_000,
        adapt=AdaptSettings(least_gain=0.03),
    ),
}  # fmt: skip


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
    seed: int = 0,
    progress: Progress = no_progress,
) -> Reconstruction:
    """Fit the full scene, with everything that is to be removed still in it.

    Args:
        drive: an imported drive.
        scene: its labels.
        settings: see there.
        exposures: of the photographs, see ``optimize.exposure``; the scene gets their canonical colours.
        seed: order of the views.
        progress: called per step with loss and the number of surfels.
    """
    limits = scene_range(drive)
    exposures = exposures or Exposures()
    images = [exposures.read(f) for f in drive.frames]
    labels = [frame_labels(f, scene) for f in drive.frames]
    surfels = start_scene(drive, scene, images, labels, settings.start, progress=progress)
    sky = start_sky(drive, scene, images, labels, surfels, limits)
    fine, coarse = (_views(drive, images, labels, sky, factor) for factor in (1.0, 0.5))
    training = TrainSettings(
        weights=settings.weights,
        density=DensitySettings(budget=settings.budget, max_scale=3.0 * limits.unit),
        near=limits.near,
        far=limits.far,
    )
    spared = [k for k, n in enumerate(scene.labels.names) if n in settings.spared]
    state = Optimization(
        surfels, sky, training, LearningRates(means=0.004 * limits.unit),
        label_count=len(scene.labels), sky_label=scene.labels.index("sky"), spared_labels=spared, seed=seed,
    )  # fmt: skip
    return _optimize(state, fine, coarse, settings, progress)


def _views(
    drive: Drive, images: Sequence[NDArray[np.uint8]], labels: Sequence[NDArray[np.int64]], sky: Sky, factor: float
) -> list[TrainingView]:
    return [training_view(f.camera, images[i], labels[i], None, sky, factor=factor) for i, f in enumerate(drive.frames)]


def _optimize(
    state: Optimization, fine: list[TrainingView], coarse: list[TrainingView], settings: ReconstructSettings,
    progress: Progress,
) -> Reconstruction:  # fmt: skip
    """Both stages, as far as each step of them pays."""
    free = frozenset(CHOICES) - settings.given
    probed = probed_frames(len(fine)) if free else []
    course = Course(settings.adapt, {"coarse": [coarse[i] for i in probed], "fine": [fine[i] for i in probed]})
    choices: dict[str, Any] = {}
    taken, most = 0, settings.iterations

    def shown(views: list[TrainingView]) -> list[TrainingView]:
        return [hide(v) if i in probed else v for i, v in enumerate(views)]

    def told(state: Optimization, phase: Phase, turn: int) -> bool:
        progress(taken + turn, most, phase.name, loss=state.loss, surfels=float(len(state)))
        return False

    def run(phase: Phase, ends: Callable[[Optimization], bool]) -> int:
        course.begin()

        def watch(state: Optimization, phase: Phase, turn: int) -> bool:
            told(state, phase, turn)
            return bool(probed) and course.look(state, phase, turn) and ends(state)

        return run_phase(state, phase, watch)

    def first_stage(name: str, views: list[TrainingView], steps: int, *, grow_every: int = 0) -> Phase:
        return Phase(name, shown(views), steps, False, STABLE, STABLE, grow_every=grow_every)

    def grown(state: Optimization) -> bool:
        """Whether the phase ends: first density control stops when it does not pay, then the phase."""
        if course.pays():
            return False
        if "budget" in free and state.density is not None:
            state.density = None
            choices["budget"] = {"chosen": len(state), "most": settings.budget, "gain": course.gain()}
            course.begin()
            return False
        return "iterations" in free

    most_coarse = round(most * settings.coarse_share)
    if most_coarse:
        phase = first_stage("coarse", coarse, most_coarse)
        taken = run(phase, lambda _: "coarse" in free and not course.pays())
        choices["coarse"] = {"chosen": taken, "most": most_coarse, "gain": course.gain()}
    if "sh_degree" in free:
        steps = max(40, 2 * len(fine))
        state, choices["sh_degree"] = choose_sh_degree(state, phase, steps, settings.sh_degree, course)
        taken += steps
    else:
        state.trainable.raise_sh_degree(settings.sh_degree)
    left = round(most * (1 - settings.geometry_share)) - taken
    phase = first_stage("fine", fine, left, grow_every=settings.adapt.every)
    taken += run(phase, grown)
    # What was hidden is shown again, and the second stage is as long as the first deserves.
    second = round(taken * settings.geometry_share / (1 - settings.geometry_share))
    most = taken + second
    choices["iterations"] = {"chosen": most, "most": settings.iterations, "gain": course.gain()}
    state.density = None
    phase = Phase("geometry", fine, second, True, STABLE, FALLEN, prune_every=max(50, second // 3))
    run_phase(state, phase, told)
    return Reconstruction(*state.result(), {"given": sorted(settings.given), **choices, "looks": course.record})

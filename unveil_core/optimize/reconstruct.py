"""From a drive to the full semantic scene: the start, the schedule, the two stages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.kernels.device import current_device
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint, Kept, facts_array, facts_of
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.drives.exposure import Exposures
from unveil_core.optimize.adaptation.choices import CHOICES, AdaptSettings, Looks
from unveil_core.optimize.adaptation.colour_degree import choose_sh_degree
from unveil_core.optimize.adaptation.probes import hide, probed_frames
from unveil_core.optimize.start import SKY_ROWS, StartSettings, random_scene, start_scene, start_sky
from unveil_core.optimize.training.card_memory import StepSize, largest_step, place_for, trial_of_degrees
from unveil_core.optimize.training.density import DensitySettings
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.schedule import Phase, run_phase
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import TrainingView, training_view, views_on
from unveil_core.semantics.labels import SceneLabels, labels_of_frames
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import FLATNESS, Surfels, as_ellipsoids

__all__ = ["PRESETS", "ReconstructSettings", "Reconstruction", "reconstruct", "sky_of_labels"]

MANY_FRAMES = 100
STABLE, FALLEN = 0.5, 1.2
"""How much of the fall of the step sizes is done in the first stage, and at the end of the second: large steps as long as
they help, then smaller and smaller ones (Hu et al., *MiniCPM*, 2024, section 4). So the first stage may end at any time."""

COARSE, FINE, GEOMETRY = range(3)
"""The phases in their order."""


@dataclass(frozen=True)
class ReconstructSettings:
    """How much work a reconstruction may be. Numbers are limits of what is chosen while it runs (see ``adapt``).

    They stand for drives of up to ``MANY_FRAMES`` frames; of longer ones steps and surfels may be more in proportion.

    Attributes:
        iterations: steps in all at most; the second stage takes ``geometry_share`` of those that are taken.
        geometry_share: share of the second stage.
        coarse_share: share of the steps that run at half resolution, at most.
        sh_degree: of the surfels' colour.
        sky_rows: of the panorama of the sky, where that is given.
        start: how fine the start is.
        budget: at most how many surfels density control may reach.
        adapt: when more is worth it.
        given: choices (see ``CHOICES``) that the limit itself decides: the user's, or all of them for a fixed recipe.
        weights: of the losses, the paper's by default.
        prune_opacity: surfels fainter than this are removed in the second stage (paper: 0.3).
        ellipsoids: 3D Gaussians instead of discs; soft_labels: trainable probabilities instead of hard labels; random_start:
            surfels thrown into the points' box; all three for comparison only.
        kernels: of the losses and Adam, "auto" by the device, else see ``training.arithmetic``; for comparison only, too.
        spared: class names that opacity pruning leaves alone (the paper: sky and vegetation).
    """

    iterations: int = 2000
    geometry_share: float = 0.35
    coarse_share: float = 0.15
    sh_degree: int = 2
    sky_rows: int = 64
    start: StartSettings = field(default_factory=StartSettings)
    budget: int = 80_000
    adapt: AdaptSettings = field(default_factory=AdaptSettings)
    given: frozenset[str] = frozenset()
    weights: LossWeights = field(default_factory=LossWeights)
    prune_opacity: float = 0.3
    ellipsoids: bool = False
    soft_labels: bool = False
    random_start: bool = False
    kernels: str = "auto"
    spared: tuple[str, ...] = ("vegetation",)

    def scaled(self, frames: int) -> ReconstructSettings:
        """These limits for a number of frames."""
        factor = max(1.0, frames / MANY_FRAMES)
        more = {
            name: round(factor * getattr(self, name)) for name in ("iterations", "budget") if name not in self.given
        }
        start = replace(self.start, budget=round(factor * self.start.budget))
        return replace(self, start=start, **more)  # type: ignore[arg-type]


PRESETS: dict[str, ReconstructSettings] = {
    "draft": ReconstructSettings(
        iterations=450,
        sh_degree=1,
        start=StartSettings(budget=40_000),
        budget=60_000,
        adapt=AdaptSettings(least_gain=0.3),
    ),
    "standard": ReconstructSettings(),
    "high": ReconstructSettings(
        iterations=6000,
        sh_degree=3,
        start=StartSettings(budget=90_000),
        budget=300_000,
        adapt=AdaptSettings(least_gain=0.03),
    ),
}


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
    course = _Course(state, fine, coarse, settings, kept.checkpoint("training"), progress)
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
) -> tuple[Sequence[NDArray[np.uint8]], Sequence[NDArray[np.int64]]]:
    """Images (H, W, 3) in canonical colours and labels (H, W) of the frames, -1 where ``hidden``."""
    frames = drive.frames
    images = cache.frames(len(frames), lambda i: exposures.read(frames[i]))
    labels = labels_of_frames(frames, scene, cache)
    if hidden is None:
        return images, labels
    return images, Frames(len(frames), lambda i: np.where(hidden[i], -1, labels[i]))


def _views(
    drive: Drive,
    images: Sequence[NDArray[np.uint8]],
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


class _Course:
    """Both stages, each part of them as long as it pays.

    Attributes:
        choices: what was chosen by which numbers.
    """

    def __init__(
        self,
        state: Optimization,
        fine: Sequence[TrainingView],
        coarse: Sequence[TrainingView],
        settings: ReconstructSettings,
        checkpoint: Checkpoint,
        progress: Progress,
    ) -> None:
        self.state, self.settings, self.progress = state, settings, progress
        self.checkpoint = checkpoint
        self.fine, self.coarse = fine, coarse
        self.free = frozenset(CHOICES) - settings.given
        self.probed = probed_frames(len(fine)) if self.free else []
        self.looks = Looks(settings.adapt, {"coarse": self._of_probed(coarse), "fine": self._of_probed(fine)})
        self.choices: dict[str, Any] = {}
        self.taken, self.most = 0, settings.iterations
        self.at, self.begun, self.stopped = COARSE, 0, False

    def run(self) -> tuple[Surfels, Sky]:
        """Take all steps, from the last checkpoint on where there is one."""
        s = self.settings
        first = round(s.iterations * (1 - s.geometry_share))
        if not self._resumed():
            self.state.trainable.set_sh_degree(s.sh_degree)
        if self.at == COARSE:
            self._coarse(round(s.iterations * s.coarse_share))
            self._next(FINE)
        if self.at == FINE:
            self._fine(first - self.taken)
            self._next(GEOMETRY)
        second = self._second()
        phase = Phase("geometry", self.fine, second, True, STABLE, FALLEN, prune_every=max(50, second // 3))
        self._run(phase, lambda: False)
        return self.state.result()

    def _second(self) -> int:
        """Steps of the second stage, and what comes before its first."""
        s = self.settings
        if self.begun:
            return self.most - self.taken
        # The second stage is as long as the first deserved, and sees what was hidden.
        second = round(self.taken * s.geometry_share / (1 - s.geometry_share))
        self.most = self.taken + second
        stopped = "the gain" if self.taken < round(s.iterations * (1 - s.geometry_share)) else "the limit"
        self.choices["iterations"] = {
            "chosen": self.most,
            "most": s.iterations,
            "gain": self.looks.gain(),
            "least_gain": s.adapt.least_gain,
            "stopped_by": stopped,
        }
        self.choices["looks"] = self.looks.record
        # Faint ones go at once: the geometric terms cost per surfel, and what they sharpen should stay.
        self.state.prune()
        return second

    def _next(self, at: int) -> None:
        self.at, self.begun = at, 0

    def _resumed(self) -> bool:
        """Go on from the last checkpoint, where there is one."""
        found = self.checkpoint.load()
        if found is None:
            return False
        arrays, facts = found
        self.state.restore(arrays, facts["state"])
        self.at, self.begun, self.stopped = facts["at"], facts["begun"], facts["stopped"]
        self.taken, self.most, self.choices = facts["taken"], facts["most"], facts["choices"]
        self.looks.work, self.looks.record = facts["work"], facts["record"]
        self.looks.seen = [(float(work), float(psnr)) for work, psnr in facts["seen"]]
        return True

    def _pause(self, turn: int) -> None:
        """Save a checkpoint where it is time to."""
        if self.checkpoint.due():
            arrays, state = self.state.checkpoint()
            looks = {"work": self.looks.work, "record": self.looks.record, "seen": self.looks.seen}
            here = {"at": self.at, "begun": turn, "stopped": self.stopped, "taken": self.taken, "most": self.most}
            self.checkpoint.save(arrays, {"state": state, **looks, **here, "choices": self.choices})

    def _coarse(self, steps: int) -> None:
        """The first steps at half size, without growth: what is there suffices for so few pixels. Then colour's degree."""
        phase = Phase("coarse", self._shown(self.coarse), steps, False, STABLE, STABLE)
        taken = self._run(phase, lambda: "coarse" in self.free and not self.looks.pays())
        self.choices["coarse"] = {"chosen": taken, "most": steps, "gain": self.looks.gain()}
        trial = min(len(self.fine), steps // 8)
        # In fewer steps no degree has had its time: colour by direction would always look useless.
        if self.settings.sh_degree and "sh_degree" in self.free and trial >= max(1, len(self.fine) // 2):
            self.state, self.choices["sh_degree"] = choose_sh_degree(self.state, phase, trial, self.looks)

    def _fine(self, steps: int) -> None:
        """At full size: density control until it does not pay, then steps until they do not."""
        phase = Phase(
            "fine", self._shown(self.fine), steps, False, STABLE, STABLE, grow_every=self.settings.adapt.every
        )

        def ends() -> bool:
            if self.looks.pays():
                return False
            if "budget" in self.free and not self.stopped:
                self.stopped, self.state.density = True, None
                self.choices["budget"] = {
                    "chosen": len(self.state),
                    "most": self.settings.budget,
                    "gain": self.looks.gain(),
                }
                self.looks.begin()
                return False
            return "iterations" in self.free

        self._run(phase, ends)
        self.choices.setdefault("budget", {"chosen": len(self.state), "most": self.settings.budget})
        self.state.density = None

    def _run(self, phase: Phase, ends: Callable[[], bool]) -> int:
        if not self.begun:
            self.looks.begin()

        def watch(state: Optimization, phase: Phase, turn: int) -> bool:
            self.progress(self.taken + turn, self.most, phase.name, loss=state.loss, surfels=float(len(state)))
            return bool(self.probed) and not phase.geometry and self.looks.look(state, phase, turn) and ends()

        taken = run_phase(self.state, phase, watch, begun=self.begun, pause=self._pause)
        self.taken += taken
        return taken

    def _of_probed(self, views: Sequence[TrainingView]) -> Sequence[TrainingView]:
        return subset(views, self.probed)

    def _shown(self, views: Sequence[TrainingView]) -> Sequence[TrainingView]:
        return Frames(len(views), lambda i: hide(views[i]) if i in self.probed else views[i])

"""From a drive to the full semantic scene: the start, the schedule, the two stages."""

from __future__ import annotations

from dataclasses import dataclass, field

from unveil_core.drives.drive import Drive
from unveil_core.files import read_image
from unveil_core.optimize.density import DensitySettings
from unveil_core.optimize.losses import LossWeights
from unveil_core.optimize.parameters import LearningRates
from unveil_core.optimize.scene_range import scene_range
from unveil_core.optimize.schedule import Phase, run_phase
from unveil_core.optimize.start import StartSettings, start_scene, start_sky
from unveil_core.optimize.trainer import Optimization, TrainSettings
from unveil_core.optimize.views import TrainingView, training_view
from unveil_core.progress import Progress, no_progress
from unveil_core.semantics.segment import SceneLabels, frame_labels
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels, with_sh_degree

__all__ = ["PRESETS", "ReconstructSettings", "reconstruct"]


@dataclass(frozen=True)
class ReconstructSettings:
    """How much work a reconstruction may be.

    Attributes:
        iterations: steps in all; the second stage takes the last ``geometry_share`` of them.
        geometry_share: share of the second stage.
        coarse_share: share of the steps that run at half resolution.
        sh_degree: of the surfels' colour.
        start: how fine the start is.
        budget: at most how many surfels density control may reach.
        weights: of the losses, the paper's by default.
        spared: class names that opacity pruning leaves alone (the paper: sky and vegetation).
    """

    iterations: int = 1000
    geometry_share: float = 0.35
    coarse_share: float = 0.3
    sh_degree: int = 1
    start: StartSettings = field(default_factory=StartSettings)
    budget: int = 90_000
    weights: LossWeights = field(default_factory=LossWeights)
    spared: tuple[str, ...] = ("vegetation",)


PRESETS: dict[str, ReconstructSettings] = {
    "draft": ReconstructSettings(iterations=350, sh_degree=0, start=StartSettings(budget=40_000), budget=50_000),
    "standard": ReconstructSettings(),
    "high": ReconstructSettings(
        iterations=4000, sh_degree=2, start=StartSettings(budget=90_000), budget=200_000, coarse_share=0.2
    ),
}


def reconstruct(
    drive: Drive,
    scene: SceneLabels,
    settings: ReconstructSettings,
    *,
    seed: int = 0,
    progress: Progress = no_progress,
) -> tuple[Surfels, Sky]:
    """Fit the full scene, with everything that is to be removed still in it.

    Args:
        drive: an imported drive.
        scene: its labels.
        settings: see there.
        seed: order of the views and of splits.
        progress: called per step with loss and the number of surfels.
    """
    limits = scene_range(drive)
    images = [read_image(f.image_path) for f in drive.frames]
    labels = [frame_labels(f, scene) for f in drive.frames]
    surfels = start_scene(drive, scene, images, labels, settings.start, progress=progress)
    surfels = with_sh_degree(surfels, settings.sh_degree)
    sky = start_sky(drive, scene, images, labels, surfels, limits)

    def views(factor: float) -> list[TrainingView]:
        return [
            training_view(f.camera, images[i], labels[i], None, sky, factor=factor) for i, f in enumerate(drive.frames)
        ]

    total = settings.iterations
    switch, second = round(total * settings.coarse_share), round(total * (1 - settings.geometry_share))
    every = max(50, total // 12)
    phases = [
        Phase("coarse", views(0.5) if switch else [], switch, False, 0.0, switch / total, grow_every=every),
        Phase("fine", views(1.0), second - switch, False, switch / total, second / total, grow_every=every),
        Phase("geometry", views(1.0), total - second, True, second / total, 1.0, prune_every=max(50, total // 8)),
    ]
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
    taken = 0

    def watch(state: Optimization, phase: Phase, turn: int) -> bool:
        progress(taken + turn, total, phase.name, loss=state.loss, surfels=float(len(state)))
        return False

    for phase in phases:
        taken += run_phase(state, phase, watch)
    return state.result()

"""How much work a reconstruction may be, by quality."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from unveil_core.optimize.adaptation.choices import AdaptSettings
from unveil_core.optimize.start import StartSettings
from unveil_core.optimize.training.losses import LossWeights

__all__ = ["MANY_FRAMES", "PRESETS", "ReconstructSettings"]

MANY_FRAMES = 100
"""Frames up to which a drive has the same number of steps and surfels."""


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

"""The optimization, shared by reconstruction and re-optimization.

Two stages as in *3D StreetUnveiler*: first colour and labels with density control, then the geometric terms
(L_d, L_n, L_ds) with opacity pruning. Who calls decides how many steps of which kind are taken.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from unveil_core.optimize.training.adam import Adam
from unveil_core.optimize.training.arithmetic import arithmetic_for
from unveil_core.optimize.training.density import DensityControl, DensitySettings
from unveil_core.optimize.training.losses import LossWeights, depth_prior
from unveil_core.optimize.training.parameters import LearningRates, TrainableSurfels
from unveil_core.optimize.training.soft_labels import render_soft_labels
from unveil_core.optimize.training.views import TrainingView
from unveil_core.raster import Rendered, render
from unveil_core.raster.near_camera import REACH_M
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

__all__ = ["Optimization", "TrainSettings"]

READ_EVERY = 20
"""Steps between two looks at the loss where to look means to wait for the device: a look a second or so is enough to follow it."""


@dataclass(frozen=True)
class TrainSettings:
    """What a step does.

    Attributes:
        weights: of the losses.
        density: density control, None = the set of surfels is fixed.
        prune_opacity: fainter surfels are pruned (paper: 0.3), except ``spared_labels``.
        sky_rate: Adam step of the sky panorama, 0 = fixed.
        soft_labels: whether labels are probabilities that are trained; for comparison.
        near, far: metres; the range that distortion is measured in.
        kernels: of the losses and Adam: "auto", by the surfels' device; "fused" or "torch", see ``arithmetic``.
        backend: of the rasterizer, see ``render``.
    """

    weights: LossWeights = field(default_factory=LossWeights)
    density: DensitySettings | None = None
    prune_opacity: float = 0.3
    sky_rate: float = 2e-3
    soft_labels: bool = False
    near: float = 0.2
    far: float = 100.0
    kernels: str = "auto"
    backend: str = "auto"


class Optimization:
    """Surfels and a sky on their way to fit views, on the device of the surfels.

    Args:
        surfels: the start, N surfels; all else is brought to where they are, but the views, see ``views.views_on``.
        sky: the sky; its texture is trained unless ``sky_rate`` is 0.
        settings, rates: see there.
        label_count: K.
        sky_label: compact label of the sky or None.
        spared_labels: labels that opacity pruning leaves alone.
        moving: (N,) bool, surfels that may change; None = all. Then the set of surfels is fixed.
        seed: order of the views.
    """

    def __init__(
        self,
        surfels: Surfels,
        sky: Sky,
        settings: TrainSettings,
        rates: LearningRates,
        *,
        label_count: int,
        sky_label: int | None,
        spared_labels: Sequence[int] = (),
        moving: Tensor | None = None,
        seed: int = 0,
    ) -> None:
        self.settings, self.label_count, self.sky_label, self.device = settings, label_count, sky_label, surfels.device
        self.moving = None if moving is None else moving.to(self.device)
        self.spared = torch.tensor(list(spared_labels), dtype=torch.int64, device=self.device)
        self.arithmetic = arithmetic_for(settings.kernels, self.device)
        soft = label_count if settings.soft_labels else 0
        self.trainable = TrainableSurfels(surfels, rates, soft_labels=soft, arithmetic=self.arithmetic)
        sky = self.sky = sky.to(self.device)
        self.texture = sky.texture.clone().requires_grad_(settings.sky_rate > 0)
        self._sky_adam = Adam(self.texture, settings.sky_rate) if settings.sky_rate > 0 else None
        fixed = settings.density is None or moving is not None
        self.density = (
            None if fixed else DensityControl(settings.density, len(surfels), self.device)  # type: ignore[arg-type]
        )
        self._generator = np.random.default_rng(seed)
        self._order: list[int] = []
        self.loss = float("nan")
        """Exponential mean over the steps; of those up to the last look at it, where it stays on the device meanwhile."""
        self._mean: Tensor | None = None
        self._since = 0

    def __len__(self) -> int:
        return len(self.trainable)

    def copy(self) -> Optimization:
        """A copy of the state, for a trial that may be discarded."""
        twin = copy(self)
        twin.trainable = self.trainable.copy()
        twin.texture = self.texture.detach().clone().requires_grad_(self.settings.sky_rate > 0)
        twin._sky_adam = None if self._sky_adam is None else self._sky_adam.copy(twin.texture)
        twin.density, twin._generator = deepcopy(self.density), deepcopy(self._generator)
        twin._order = list(self._order)
        twin._mean = None if self._mean is None else self._mean.clone()
        return twin

    def checkpoint(self) -> tuple[dict[str, NDArray[np.generic]], dict[str, Any]]:
        """The state as arrays and as facts that JSON can hold: with them the same steps come to the same end."""
        arrays = {**self.trainable.arrays(), "texture": self.texture.detach().cpu().numpy()}
        self._look()
        facts: dict[str, Any] = {
            "order": self._order,
            "random": self._generator.bit_generator.state,
            "loss": None if np.isnan(self.loss) else self.loss,
            "grows": self.density is not None,
        }
        if self._sky_adam is not None:
            moments = {"sky.first": self._sky_adam.first, "sky.second": self._sky_adam.second}
            arrays |= {name: moment.cpu().numpy() for name, moment in moments.items()}
            facts["sky_turn"] = self._sky_adam.turn
        if self.density is not None:
            arrays |= {f"density.{name}": t.cpu().numpy() for name, t in self.density.tensors().items()}
        return arrays, facts

    def restore(self, arrays: Mapping[str, NDArray[np.generic]], facts: Mapping[str, Any]) -> None:
        """Go on from what :meth:`checkpoint` gave, in an optimization that was begun alike."""
        self.trainable.restore(arrays)
        self.texture = torch.from_numpy(arrays["texture"]).to(self.device).requires_grad_(self.settings.sky_rate > 0)
        if self._sky_adam is not None:
            self._sky_adam = Adam(self.texture, self.settings.sky_rate)
            self._sky_adam.first, self._sky_adam.second = (
                torch.from_numpy(arrays[f"sky.{name}"]).to(self.device) for name in ("first", "second")
            )
            self._sky_adam.turn = int(facts["sky_turn"])
        if not facts["grows"]:
            self.density = None
        if self.density is not None:
            self.density.restore({name: torch.from_numpy(arrays[f"density.{name}"]) for name in self.density.tensors()})
        self._generator.bit_generator.state = facts["random"]
        self._order = [int(i) for i in facts["order"]]
        self.loss = float("nan") if facts["loss"] is None else float(facts["loss"])
        self._mean = None

    def step(self, views: Sequence[TrainingView], *, geometry: bool, done: float) -> None:
        """One view, one change; all views have their turn before one comes again.

        Args:
            views: the targets; their number stays the same, their resolution may not.
            geometry: whether the terms of the second stage count (L_d, L_n, L_ds, L_alpha).
            done: how much of the schedule is over, 0 to 1.
        """
        if not self._order:
            self._order = self._generator.permutation(len(views)).tolist()
        view = views[self._order.pop()]
        current = self.trainable.surfels
        out = self._render(current, view, geometry)
        loss = self._loss(out, current, view, geometry)
        loss.backward()  # type: ignore[no-untyped-call]
        self._note(loss)
        if self.density is not None:
            _observe(self.density, out, current, view)
        self.trainable.step(self.moving, done=done)
        if self._sky_adam is not None:
            self._sky_adam.step()

    def _note(self, loss: Tensor) -> None:
        """Take a step's loss into the mean."""
        if self.arithmetic.at_once:
            value = loss.item()
            self.loss = value if np.isnan(self.loss) else 0.95 * self.loss + 0.05 * value
            return
        there = loss.detach()
        if self._mean is None:
            self._mean = there.clone() if np.isnan(self.loss) else there * 0.05 + 0.95 * self.loss
            self._since = READ_EVERY  # the first is looked at, so that there is a loss to tell
        else:
            self._mean.mul_(0.95).add_(there, alpha=0.05)
            self._since += 1
        if self._since >= READ_EVERY:
            self._look()

    def _look(self) -> None:
        """Bring the mean from the device, which waits for it."""
        if self._mean is not None:
            self.loss, self._since = float(self._mean), 0

    def _render(self, current: Surfels, view: TrainingView, geometry: bool) -> Rendered:
        w, s = self.settings.weights, self.settings
        planes = ["rgb", "alpha"]
        if w.semantic > 0 and view.label_image is not None and not s.soft_labels:
            planes.append("semantics")
        if geometry:
            planes += ["normal"] if w.normal > 0 else []
            planes += ["depth"] if w.normal > 0 or (w.depth > 0 and view.depth is not None) else []
            planes += ["distortion"] if w.distortion > 0 else []
            planes += ["label_distortion"] if w.label_distortion > 0 else []
        # Where a check waits for the device, it is made with each look at the loss.
        check = self.arithmetic.at_once or self._mean is None or self._since + 1 >= READ_EVERY
        return render(
            current,
            view.camera,
            planes,
            label_count=self.label_count,
            near=s.near,
            far=s.far,
            backend=s.backend,
            check=check,
        )

    def _loss(self, out: Rendered, current: Surfels, view: TrainingView, geometry: bool) -> Tensor:
        w, by = self.settings.weights, self.arithmetic
        assert out.rgb is not None and out.alpha is not None
        image = out.rgb + (1 - out.alpha)[..., None] * self.sky.sample(view.sky_positions(self.sky), self.texture)
        loss = by.l1_dssim(image, view.image, view.weight, dssim=w.dssim)
        semantics, labels = out.semantics, view.labels
        if self.settings.soft_labels and w.semantic > 0 and labels is not None:
            logits, s = self.trainable.leaves["label_logits"], self.settings
            semantics = render_soft_labels(current, logits, view.camera, near=s.near, far=s.far, backend=s.backend)
        if semantics is not None and labels is not None:
            loss = loss + w.semantic * by.semantic_cross_entropy(
                semantics, out.alpha, labels, sky_label=self.sky_label, weight=view.weight
            )
        if out.distortion is not None:
            loss = loss + w.distortion * out.distortion.mean()
        if out.label_distortion is not None:
            loss = loss + w.label_distortion * out.label_distortion.mean()
        if out.normal is not None and out.depth is not None:
            loss = loss + w.normal * by.normal_consistency(out.normal, out.depth, out.alpha, view.rays, view.weight)
        if geometry and w.depth > 0 and view.depth is not None and out.depth is not None:
            loss = loss + w.depth * depth_prior(out.depth, out.alpha, view.depth)
        if geometry and w.opacity > 0:
            loss = loss + w.opacity * torch.sigmoid(current.opacity_logits).mean()
        return loss

    def _settle_labels(self) -> None:
        """Of soft labels the likeliest is the surfel's."""
        if self.settings.soft_labels:
            self.trainable.labels = self.trainable.leaves["label_logits"].detach().argmax(dim=1)

    def grow(self) -> None:
        """Density control acts, where there is any."""
        self._settle_labels()
        if self.density is not None:
            self.density.act(self.trainable)

    def prune(self) -> None:
        """Remove faint surfels, and those that are wider than what a camera sees of a street: they explain some sky, and cut
        through the street where an object hides that they do."""
        self._settle_labels()
        opacity = torch.sigmoid(self.trainable.leaves["opacity_logits"].detach())
        wide = self.trainable.leaves["log_scales"].detach().amax(dim=1) > math.log(REACH_M)
        keep = ((opacity >= self.settings.prune_opacity) | torch.isin(self.trainable.labels, self.spared)) & ~wide
        if not bool(keep.all()):
            self.trainable.keep(keep)
            if self.density is not None:
                self.density.clear(len(self.trainable))

    def result(self) -> tuple[Surfels, Sky]:
        """The surfels and the sky as they are now, detached."""
        self._settle_labels()
        return self.trainable.surfels.detach(), Sky(self.texture.detach().clone(), self.sky.axes)


def _observe(density: DensityControl, out: Rendered, surfels: Surfels, view: TrainingView) -> None:
    with torch.no_grad():
        camera, row = view.camera, view.forward
        # Element by element: a matrix product may round differently with the memory's alignment, and splits hang on it.
        depth = ((surfels.means.detach() * row[:3]).sum(dim=1) + row[3]).clamp_min(1e-3)
        width = surfels.log_scales.detach().amax(dim=1).exp() * camera.fx / depth
        density.observe(out.screen_gradients(), out.visible, max(camera.width, camera.height) / 2, width)

"""Trainable surfels: moments follow their surfels, density control changes what it should."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from unveil_core.optimize.density import DensityControl, DensitySettings
from unveil_core.optimize.parameters import LearningRates, TrainableSurfels
from unveil_core.surfels.surfels import Surfels, rotations


def some(count: int, degree: int = 1) -> Surfels:
    g = torch.Generator().manual_seed(count)
    return Surfels(
        torch.randn(count, 3, generator=g), torch.randn(count, 4, generator=g),
        torch.randn(count, 2, generator=g) * 0.1 - 3, torch.randn(count, generator=g),
        torch.randn(count, (degree + 1) ** 2, 3, generator=g), torch.arange(count) % 4,
    )  # fmt: skip


def take_step(trainable: TrainableSurfels) -> None:
    s = trainable.surfels
    (s.means.square().sum() + s.sh.sum() + s.opacity_logits.sum() + s.quats.sum() + s.log_scales.sum()).backward()
    trainable.step()


def test_values_survive_a_round_trip() -> None:
    surfels = some(7)
    current = TrainableSurfels(surfels, LearningRates(means=0.1)).surfels
    assert torch.equal(current.sh, surfels.sh)
    assert torch.equal(current.labels, surfels.labels)


def test_moments_follow_their_surfels() -> None:
    trainable = TrainableSurfels(some(10), LearningRates(means=0.1))
    take_step(trainable)
    before = trainable.first["means"].clone()
    keep = torch.arange(10) % 2 == 0
    trainable.rebuild(keep, some(3))
    assert len(trainable) == 8
    assert torch.equal(trainable.first["means"][:5], before[keep])
    assert float(trainable.first["means"][5:].abs().max()) == 0
    take_step(trainable)


@pytest.mark.parametrize("moving", [None, torch.ones(200, dtype=torch.bool)])
@pytest.mark.parametrize("degree", [0, 1, 3])
def test_steps_are_those_of_torch(degree: int, moving: torch.Tensor | None) -> None:
    start, rates = some(200, degree), LearningRates(means=0.1, sh_base=0.03, sh_rest=0.002)
    trainable = TrainableSurfels(start, rates)
    names = {"means": 0.1, "quats": rates.quats, "log_scales": rates.log_scales, "opacity_logits": rates.opacity_logits}
    theirs = {name: getattr(start, name).double().requires_grad_(True) for name in (*names, "sh")}
    base, rest = theirs["sh"].detach()[:, :1].clone(), theirs["sh"].detach()[:, 1:].clone()
    groups = [{"params": [theirs[name]], "lr": rate} for name, rate in names.items()]
    groups += [{"params": [base], "lr": 0.03}, {"params": [rest], "lr": 0.002}]
    optimizer = torch.optim.Adam(groups, eps=1e-15)
    g = torch.Generator().manual_seed(1)
    for _ in range(5):
        for name, leaf in trainable.leaves.items():
            gradient = torch.randn(leaf.shape, generator=g) * (10.0 ** torch.randint(-9, 3, leaf.shape, generator=g))
            leaf.grad = gradient.clone()
            theirs[name].grad = gradient.double()
        base.grad, rest.grad = theirs["sh"].grad[:, :1].clone(), theirs["sh"].grad[:, 1:].clone()
        trainable.step(moving)
        optimizer.step()
    for name in names:
        assert torch.allclose(trainable.leaves[name].double(), theirs[name], rtol=1e-5, atol=1e-6), name
    assert torch.allclose(trainable.leaves["sh"].double(), torch.cat([base, rest], dim=1), rtol=1e-5, atol=1e-6)


def test_surfels_that_do_not_move_keep_values_and_moments() -> None:
    trainable = TrainableSurfels(some(10), LearningRates(means=0.1))
    take_step(trainable)
    values = {name: leaf.detach().clone() for name, leaf in trainable.leaves.items()}
    moments = {name: m.clone() for name, m in trainable.first.items()}
    s = trainable.surfels
    (s.means.square().sum() + s.sh.sum()).backward()
    moving = torch.arange(10) < 4
    trainable.step(moving)
    for name, leaf in trainable.leaves.items():
        assert torch.equal(leaf[~moving], values[name][~moving])
        assert torch.equal(trainable.first[name][~moving], moments[name][~moving])
    assert not torch.equal(trainable.leaves["means"][moving], values["means"][moving])
    assert trainable.leaves["means"].grad is None


@pytest.mark.parametrize("scales", [2, 3])
def test_density_control_splits_clones_and_drops(scales: int) -> None:
    surfels = some(6)
    surfels = replace(surfels, log_scales=torch.cat([surfels.log_scales, surfels.log_scales[:, :1] - 1], 1)[:, :scales])
    surfels.opacity_logits[5] = -8.0  # invisible: goes
    trainable = TrainableSurfels(surfels, LearningRates(means=0.1))
    control = DensityControl(DensitySettings(gradient_threshold=1.0, split_scale_px=3.0, min_opacity=0.02), 6, seed=0)
    gradients = torch.zeros(6, 2)
    gradients[0, 0] = gradients[1, 0] = 1.0
    width = torch.tensor([10.0, 1.0, 10.0, 1.0, 1.0, 1.0])
    control.observe(gradients, torch.ones(6, dtype=torch.bool), half_size_px=10.0, width_px=width)
    labels = surfels.labels.clone()
    added, dropped = control.act(trainable)
    assert (added, dropped) == (3, 2)  # one clone, two halves; the parent of the halves and the invisible one
    assert len(trainable) == 7
    assert trainable.labels.tolist() == [*labels[1:5].tolist(), int(labels[1]), int(labels[0]), int(labels[0])]
    halves = trainable.surfels.detach().log_scales[-2:]
    assert torch.allclose(halves, surfels.log_scales[0] - torch.log(torch.tensor(1.6)))


@pytest.mark.parametrize("scales", [2, 3])
def test_halves_are_spread_as_their_parents(scales: int) -> None:
    """Over many, the children's offsets have the covariance of the parent's disc or ellipsoid."""
    log_scales = torch.tensor([0.5, -0.5, 0.1])[:scales]
    one = replace(some(1), means=torch.zeros(1, 3), log_scales=log_scales[None])
    parents = one.select(torch.zeros(40_000, dtype=torch.int64))
    children = DensityControl(DensitySettings(), 1, seed=0)._halves(parents)
    axes = rotations(one.quats)[0, :, :scales] * log_scales.exp()
    for child in children:
        assert torch.equal(child.labels, parents.labels)
        assert float((child.means.T @ child.means / 40_000 - axes @ axes.T).abs().max()) < 0.05


def test_budget_is_kept() -> None:
    trainable = TrainableSurfels(some(20), LearningRates(means=0.1))
    control = DensityControl(DensitySettings(gradient_threshold=0.0, budget=23, min_opacity=0.0), 20, seed=0)
    control.observe(torch.rand(20, 2), torch.ones(20, dtype=torch.bool), 10.0, torch.zeros(20))
    control.act(trainable)
    assert len(trainable) == 23

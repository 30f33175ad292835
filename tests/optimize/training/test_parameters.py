"""Trainable surfels: moments follow their surfels, density control changes what it should."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from unveil_core.optimize.training.adam import Adam
from unveil_core.optimize.training.density import DensityControl, DensitySettings, cut_in_two
from unveil_core.optimize.training.parameters import LearningRates, TrainableSurfels
from unveil_core.surfels.surfels import Surfels, rotations


def some(count: int, degree: int = 1) -> Surfels:
    g = torch.Generator().manual_seed(count)
    return Surfels(
        torch.randn(count, 3, generator=g),
        torch.randn(count, 4, generator=g),
        torch.randn(count, 2, generator=g) * 0.1 - 3,
        torch.randn(count, generator=g),
        torch.randn(count, (degree + 1) ** 2, 3, generator=g),
        torch.arange(count) % 4,
    )


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
    control = DensityControl(DensitySettings(gradient_threshold=1.0, split_scale_px=3.0, min_opacity=0.02), 6)
    gradients = torch.zeros(6, 2)
    gradients[0, 0] = gradients[1, 0] = 1.0
    width = torch.tensor([10.0, 1.0, 10.0, 1.0, 1.0, 1.0])
    control.observe(gradients, torch.ones(6, dtype=torch.bool), half_size_px=10.0, width_px=width)
    labels = surfels.labels.clone()
    added, dropped = control.act(trainable)
    assert (added, dropped) == (3, 2)  # one clone, two halves; the parent of the halves and the invisible one
    assert len(trainable) == 7
    assert trainable.labels.tolist() == [*labels[1:5].tolist(), int(labels[1]), int(labels[0]), int(labels[0])]
    # The clone and what it was cloned from let as much through together as that did alone.
    through = 1 - torch.sigmoid(trainable.surfels.detach().opacity_logits)
    own = 1 - torch.sigmoid(surfels.opacity_logits)
    assert torch.allclose(through[0] * through[4], own[1], rtol=1e-5)
    assert torch.allclose(through[1:4], own[2:5])
    halves = trainable.surfels.detach().log_scales[-2:]
    assert bool((halves < surfels.log_scales[0]).all())


@pytest.mark.parametrize("scales", [2, 3])
def test_children_lie_side_by_side_within_their_parent(scales: int) -> None:
    parents = some(50)
    log_scales = torch.cat([parents.log_scales, parents.log_scales[:, :1] - 1], 1)[:, :scales]
    parents = replace(parents, log_scales=log_scales)
    first, second = cut_in_two(parents)
    longest = log_scales.argmax(dim=1)
    axis = rotations(parents.quats)[torch.arange(50), :, longest]
    apart = first.means - second.means
    assert torch.allclose((first.means + second.means) / 2, parents.means, atol=1e-6)
    assert torch.allclose(apart, axis * (apart * axis).sum(1, keepdim=True), atol=1e-6), "along the longest axis"
    for child in (first, second):
        assert torch.equal(child.labels, parents.labels) and torch.equal(child.sh, parents.sh)
        # Both together reach no farther than the parent, and leave no gap between them.
        reach = (child.means - parents.means).norm(dim=1) + child.log_scales.gather(1, longest[:, None])[:, 0].exp()
        assert bool((reach <= 1.15 * log_scales.amax(dim=1).exp()).all())
        assert bool((apart.norm(dim=1) < 2 * child.log_scales.gather(1, longest[:, None])[:, 0].exp()).all())


def test_a_copy_goes_its_own_way() -> None:
    trainable = TrainableSurfels(some(9), LearningRates(means=0.1))
    take_step(trainable)
    twin = trainable.copy()
    before = trainable.surfels.detach().means.clone()
    take_step(twin)
    assert torch.equal(trainable.surfels.means.detach(), before)
    take_step(trainable)
    for name in trainable.leaves:
        assert torch.equal(trainable.leaves[name], twin.leaves[name]) and torch.equal(
            trainable.second[name], twin.second[name]
        )


def test_degrees_of_colour_come_and_go() -> None:
    trainable = TrainableSurfels(some(9, degree=1), LearningRates(means=0.1))
    take_step(trainable)
    sh, moment = trainable.leaves["sh"].detach().clone(), trainable.first["sh"].clone()
    trainable.set_sh_degree(2)
    assert torch.equal(trainable.leaves["sh"][:, :4], sh) and not bool(trainable.leaves["sh"][:, 4:].any())
    take_step(trainable)
    trainable.set_sh_degree(0)
    assert trainable.leaves["sh"].shape == trainable.first["sh"].shape == (9, 1, 3)
    assert trainable.first["sh"].shape != moment.shape
    take_step(trainable)


def test_step_sizes_fall_as_told() -> None:
    rates = LearningRates(means=0.1, quats=0.2, final=0.25, final_means=0.01)
    assert rates.at("means", 0.0) == 0.1 and rates.at("quats", 0.0) == 0.2
    assert rates.at("means", 0.5) == pytest.approx(0.01) and rates.at("quats", 0.5) == pytest.approx(0.1)


def test_soft_labels_follow_their_surfels_and_learn() -> None:
    surfels = some(12)
    trainable = TrainableSurfels(surfels, LearningRates(means=0.1), soft_labels=4)
    logits = trainable.leaves["label_logits"]
    assert torch.equal(logits.argmax(1), surfels.labels)
    (-torch.log_softmax(logits, 1)[:, 2].sum()).backward()
    trainable.step()
    after = trainable.leaves["label_logits"].detach().clone()
    assert bool((torch.softmax(after, 1)[:, 2] > torch.softmax(logits, 1)[:, 2] - 1e-7).all())
    keep = torch.arange(12) % 3 > 0
    trainable.rebuild(keep, some(5))
    assert torch.equal(trainable.leaves["label_logits"][:8], after[keep]) and len(trainable.first["label_logits"]) == 13


def test_budget_is_kept() -> None:
    trainable = TrainableSurfels(some(20), LearningRates(means=0.1))
    control = DensityControl(DensitySettings(gradient_threshold=0.0, budget=23, min_opacity=0.0), 20)
    control.observe(torch.rand(20, 2), torch.ones(20, dtype=torch.bool), 10.0, torch.zeros(20))
    control.act(trainable)
    assert len(trainable) == 23


def test_one_tensor_s_steps_are_those_of_torch_bit_for_bit() -> None:
    g = torch.Generator().manual_seed(4)
    mine = torch.rand(3, 8, 16, generator=g).requires_grad_(True)
    theirs = mine.detach().clone().requires_grad_(True)
    adam, optimizer = Adam(mine, 2e-3), torch.optim.Adam([theirs], lr=2e-3)

    def both(mine: torch.Tensor, adam: Adam) -> None:
        gradient = torch.randn(3, 8, 16, generator=g) * torch.tensor([1.0, 1e-9, 0.0])[:, None, None]
        mine.grad, theirs.grad = gradient.clone(), gradient.clone()
        adam.step()
        optimizer.step()
        assert mine.grad is None and torch.equal(mine, theirs)

    for _ in range(4):
        both(mine, adam)
    adam.step()  # without a gradient nothing moves, and no step is counted
    twin = mine.detach().clone().requires_grad_(True)
    both(twin, adam.copy(twin))
    assert adam.turn == 4 and not torch.equal(mine, twin)

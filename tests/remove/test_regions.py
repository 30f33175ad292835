"""Selection and the ideal mask."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.images import grow
from unveil_core.remove import selection
from unveil_core.remove.regions import NOTHING, OBSERVED, SEEN_ELSEWHERE, UNOBSERVED, region_map
from unveil_core.remove.selection import MARGIN_M, near_removed, select_removed
from unveil_core.semantics.classes import LabelSet
from unveil_core.semantics.instances import Box, fit_box, without_strays
from unveil_core.semantics.labels import SceneLabels
from unveil_core.surfels.surfels import Surfels


def surfels_at(means: np.ndarray, labels: np.ndarray) -> Surfels:
    count = len(means)
    return Surfels(
        torch.from_numpy(means).float(),
        torch.ones(count, 4),
        torch.zeros(count, 2),
        torch.zeros(count),
        torch.zeros(count, 1, 3),
        torch.from_numpy(labels),
    )


def row_of_surfels(labels: list[int]) -> Surfels:
    means = np.zeros((len(labels), 3))
    means[:, 0] = np.arange(len(labels)) * 0.1
    return surfels_at(means, np.array(labels))


def scene(removed: tuple[str, ...], instances: tuple[int, ...] = ()) -> SceneLabels:
    return SceneLabels(LabelSet.cityscapes([0, 11, 13]), "semantics", removed, instances, (10, 10, 10))


def test_classes_instances_and_what_is_too_close() -> None:
    surfels = row_of_surfels([0, 0, 2, 2, 0, 1, 0, 0])
    none = np.zeros(8, dtype=np.int64)
    assert select_removed(surfels, none, scene(("car",)), too_close=0.0).removed.tolist() == [0, 0, 1, 1, 0, 0, 0, 0]
    close = select_removed(surfels, none, scene(("car",)), too_close=0.15).removed
    assert close.tolist() == [0, 1, 1, 1, 1, 0, 0, 0]
    ids = np.array([0, 0, 7, 8, 0, 9, 0, 0])
    assert select_removed(surfels, ids, scene((), (8,)), too_close=0.0).removed.tolist() == [0, 0, 0, 1, 0, 0, 0, 0]


def bus_seen_from_close_by(floor: float) -> tuple[Surfels, np.ndarray]:
    """The rear of a bus, from ``floor`` upwards, of which every fifth surfel was taken for road; and ground, at 0."""
    y, z = (g.ravel() for g in np.meshgrid(np.arange(-1, 1, 0.05), np.arange(floor, floor + 1, 0.05)))
    rear = np.column_stack([np.zeros(y.size), y, z])
    x, y = (g.ravel() for g in np.meshgrid(np.arange(-1, 1, 0.1), np.arange(-2, 2, 0.1)))
    means = np.concatenate([rear, np.column_stack([x, y, np.zeros(x.size)])])
    labels = np.zeros(len(means), np.int64)
    labels[: len(rear)] = np.where(np.arange(len(rear)) % 5 == 0, 0, 2)
    count = len(means)
    return surfels_at(means, labels), np.arange(count) < len(rear)


def test_of_an_object_whose_foot_nobody_saw_nothing_stays_but_the_ground() -> None:
    surfels, rear = bus_seen_from_close_by(1.2)
    ids = np.where(surfels.labels.numpy() == 2, 1, 0)
    gone = select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed
    assert gone[rear].all() and not gone[~rear].any()
    # Where it stands on the ground what lies at its foot is the ground's.
    surfels, rear = bus_seen_from_close_by(0.0)
    ids = np.where(surfels.labels.numpy() == 2, 1, 0)
    gone = select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed
    assert not gone[~rear].any() and not gone[rear & (surfels.means[:, 2].numpy() < 0.1) & (ids == 0)].any()


def long_vehicle(gap: float) -> tuple[Surfels, np.ndarray]:
    """18 m of boxes, 2.5 m wide and 3 m high, whose middle has a gap; and poles, badly named, within them and in the gap."""
    x, z = (g.ravel() for g in np.meshgrid(np.arange(0, 18, 0.1), np.arange(0.2, 3, 0.2)))
    solid = np.abs(x - 9) > gap / 2
    across = np.linspace(-1.25, 1.25, 26)
    sides = [np.column_stack([x[solid], np.full(solid.sum(), y), z[solid]]) for y in across]
    poles = np.array(
        [[4.0, 0.1, h] for h in np.arange(0.5, 2.5, 0.2)] + [[9.0, 0.1, h] for h in np.arange(0.5, 2.5, 0.2)]
    )
    means = np.concatenate([*sides, poles])
    count = len(means)
    surfels = surfels_at(means, np.where(np.arange(count) < count - len(poles), 2, 0))
    return surfels, np.arange(count) >= count - len(poles)


@pytest.mark.parametrize(("gap", "whole"), [(0.0, True), (0.7, False)])
def test_a_lorry_is_taken_whole_and_a_row_of_cars_is_not(gap: float, whole: bool) -> None:
    surfels, poles = long_vehicle(gap)
    ids = np.where(surfels.labels.numpy() == 2, 1, 0)
    gone = select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed
    assert gone[~poles].all()
    assert gone[poles].all() == whole
    assert gone[poles].any() == whole


def test_what_belongs_to_no_object_gets_no_box(monkeypatch: pytest.MonkeyPatch) -> None:
    boxed: list[int] = []

    def counting(positions: np.ndarray, *rest: np.ndarray, **more: float) -> Box:
        boxed.append(len(positions))
        return fit_box(positions, *rest, **more)

    monkeypatch.setattr(selection, "fit_box", counting)
    surfels = row_of_surfels([2] * 20_000)
    none = np.zeros(20_000, np.int64)
    assert select_removed(surfels, none, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed.all()
    assert boxed == []
    ids = np.where(np.arange(20_000) < 30, 7, 0)
    assert select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed.all()
    assert boxed == [30]


def car_with_strays(generator: np.random.Generator) -> tuple[Surfels, np.ndarray, np.ndarray]:
    """A car on a road, one of whose surfels in twenty lies up to 3 m beside it and under the road; and which are the road's."""
    x, y, z = (
        g.ravel() for g in np.meshgrid(np.arange(0, 4.3, 0.15), np.arange(0, 1.8, 0.15), np.arange(0.1, 1.5, 0.15))
    )
    shell = (x < 0.1) | (x > 4.1) | (y < 0.1) | (y > 1.6) | (z > 1.3)
    car = np.column_stack([x, y, z])[shell]
    strays = generator.uniform([-0.5, -3, -1.5], [4.5, 0, -0.2], (len(car) // 20, 3))
    x, y = (g.ravel() for g in np.meshgrid(np.arange(-2, 6, 0.1), np.arange(-4, 4, 0.1)))
    road = np.column_stack([x, y, np.zeros(x.size)])
    labels = np.repeat([2, 0], [len(car) + len(strays), len(road)])
    return surfels_at(np.concatenate([car, strays, road]), labels), (labels == 2).astype(np.int64), labels == 0


def test_a_few_strays_do_not_make_a_car_as_wide_as_the_road() -> None:
    surfels, ids, road = car_with_strays(np.random.default_rng(0))
    means, gone = (
        surfels.means.numpy(),
        select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=np.eye(3)).removed,
    )
    assert gone[~road].all()
    beside = road & ((means[:, 1] < -0.3) | (means[:, 1] > 2.1))
    assert not gone[beside].any()
    box = fit_box(means[~road].astype(float), np.eye(3), gap=1.0)
    assert box.contains(means[beside], np.eye(3), margin=MARGIN_M, above=MARGIN_M).any(), "the strays alone took it"


def test_no_box_takes_what_lies_on_known_ground() -> None:
    """A car of which only what lies under the road's surface was found: its box would begin there."""
    surfels, ids, road = car_with_strays(np.random.default_rng(0))
    lower = Surfels(surfels.means - torch.tensor([0.0, 0.0, 1.0]) * torch.from_numpy(~road)[:, None], *(
        getattr(surfels, n) for n in ("quats", "log_scales", "opacity_logits", "sh", "labels")))  # fmt: skip
    plain, spared = (
        select_removed(lower, ids, scene(("car",)), too_close=0.0, axes=np.eye(3), ground=known).removed
        for known in (None, road)
    )
    assert plain[road].any() and not spared[road].any()
    assert np.array_equal(plain[~road], spared[~road])


def all_against_all(surfels: Surfels, ids: np.ndarray, chosen_scene: SceneLabels) -> np.ndarray:
    """The same by comparing each object with all surfels."""
    labels, means, axes = surfels.labels.numpy(), surfels.means.double().numpy(), up_frame(UP)
    chosen, removable = (np.isin(labels, a) for a in (chosen_scene.removed_labels, chosen_scene.removable_labels))
    for instance in np.unique(ids[chosen])[np.unique(ids[chosen]) > 0]:
        own = means[chosen & (ids == instance)]
        box = fit_box(without_strays(own), axes, gap=1.0)
        if selection._is_one(box, own, axes):
            above = -MARGIN_M if selection._hangs(box, means[~removable], axes) else MARGIN_M
            chosen |= box.contains(means, axes, margin=MARGIN_M, above=above) & ~removable
    return chosen


@pytest.mark.parametrize("seed", range(6))
def test_looking_near_each_object_finds_what_looking_everywhere_does(seed: int) -> None:
    """Forty cars at all angles, some high over the ground, some touching, among 6,000 surfels of road; ids on some of the road too,
    as marked objects have them."""
    generator = np.random.default_rng(seed)
    cars = np.column_stack([generator.uniform(-60, 60, (40, 2)), generator.choice([0.1, 1.0], 40)])
    own = generator.uniform(-1, 1, (40, 60, 3)) * [2.2, 0.9, 0.7] + [0, 0, 0.7]
    turn = generator.uniform(0, np.pi, 40)
    x, y = (own[..., 0] * np.cos(turn)[:, None] - own[..., 1] * np.sin(turn)[:, None],
            own[..., 0] * np.sin(turn)[:, None] + own[..., 1] * np.cos(turn)[:, None])  # fmt: skip
    means = (np.stack([x, y, own[..., 2]], axis=-1) + cars[:, None]).reshape(-1, 3)
    road = generator.uniform(-65, 65, (6000, 3)) * [1, 1, 0.03]
    labels = np.repeat([2, 0], [len(means), len(road)])
    ids = np.concatenate([np.repeat(np.arange(1, 41), 60), np.where(generator.random(6000) < 0.01, 7, 0)])
    surfels = surfels_at(np.concatenate([means, road]), labels)
    found = select_removed(surfels, ids, scene(("car",)), too_close=0.0, axes=up_frame(UP)).removed
    assert np.array_equal(found, all_against_all(surfels, ids, scene(("car",))))
    assert found[len(means) :].any()


def test_near_removed_leaves_out_the_removed() -> None:
    surfels = row_of_surfels([0, 0, 2, 0, 0])
    removed = np.array([False, False, True, False, False])
    assert near_removed(surfels, removed, 0.11).tolist() == [False, True, False, True, False]
    assert not near_removed(surfels, np.zeros(5, bool), 1.0).any()


def test_region_map() -> None:
    own = np.zeros((9, 9), bool)
    own[3:6, 3:6] = True
    removed = grow(own, 1)
    hole = np.zeros((9, 9), bool)
    hole[4, 4] = True
    regions = region_map(removed, own, hole)
    assert regions[0, 0] == NOTHING
    assert regions[2, 4] == OBSERVED
    assert regions[3, 3] == SEEN_ELSEWHERE
    assert regions[4, 4] == UNOBSERVED

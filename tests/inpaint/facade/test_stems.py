"""Trunks and posts that go on down to the ground behind a parked car, on a street whose geometry is known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from tests.inpaint.facade.test_continued import FAR, street, view
from tests.inpaint.sunny_street import box_surfels
from unveil_core.inpaint.facade.facade_chart import FacadeView
from unveil_core.inpaint.facade.stems import carried_down
from unveil_core.surfels.surfels import Surfels, concatenate

PLANT, POST = 0, 1


def stem(
    low: float, high: float, at: tuple[float, float] = (11.0, 4.0), half: float = 0.1, label: int = PLANT
) -> Surfels:
    x, y = at
    box = box_surfels(np.array([[x - half, y - half, low], [x + half, y + half, high]]), spacing=0.07)
    return replace(box, labels=torch.full_like(box.labels, label))


def views(*, seen_through: bool = False) -> list[FacadeView]:
    """The far distance behind a car that hides the stem's foot; or the far distance alone."""
    _, cameras = street(np.inf)
    found = [FacadeView(c, *view(c, np.array([[9.0, 2.2, 0.0], [13.0, 3.4, 1.3]]))) for c in cameras]
    if not seen_through:
        return found
    return [replace(v, depth=np.full_like(v.depth, FAR), removed=np.zeros_like(v.removed)) for v in found]


def feet_of(standing: Surfels, *, seen_through: bool = False) -> Surfels | None:
    return carried_down(standing, (PLANT,), street(np.inf)[0], views(seen_through=seen_through))


def test_a_stem_goes_down_to_the_ground_behind_a_car() -> None:
    feet = feet_of(stem(1.2, 3.5))
    assert feet is not None
    means = feet.means.double().numpy()
    assert np.abs(means[:, :2] - (11.0, 4.0)).max() < 0.2
    assert means[:, 2].min() < 0.8 and means[:, 2].max() < 1.3
    assert (feet.labels == PLANT).all()


def test_a_stem_that_is_darker_below_gets_no_dashes() -> None:
    """Its lowest piece is dark below, where what hid it has mixed in, and one side of it lies in the sun."""
    seen = stem(1.2, 3.5)
    level = torch.where(seen.means[:, 2] < 1.5, -0.6, 0.2) + torch.where(seen.means[:, 0] > 11.0, 0.3, 0.0)
    feet = feet_of(replace(seen, sh=level[:, None, None].expand_as(seen.sh).contiguous()))
    assert feet is not None
    height, bright, sunny = feet.means[:, 2], feet.sh[:, 0, 0], feet.means[:, 0] > 11.0
    for side in (sunny, ~sunny):
        medians = [bright[side & (height > h) & (height < h + 0.2)].median() for h in np.arange(0.0, 0.7, 0.2)]
        assert max(medians) - min(medians) < 0.2, "as bright at each height"
    assert bright[sunny].median() - bright[~sunny].median() > 0.2, "and still lit from one side"


def test_what_is_seen_through_what_hangs_and_what_is_broad_do_not() -> None:
    assert feet_of(stem(1.2, 3.5), seen_through=True) is None
    for other in (stem(2.3, 3.5), stem(1.0, 3.5, half=0.8), stem(0.0, 3.5), stem(1.2, 3.5).select(torch.arange(5))):
        assert feet_of(other) is None


def test_a_low_crown_has_one_trunk() -> None:
    """Its tufts hang side by side over the car, and none of them stands on a trunk of its own; posts in a row do."""
    places = [11.0 + 0.5 * k for k in (-2, -1, 1, 2)]
    feet = feet_of(concatenate([*(stem(1.6, 2.5, at=(x, 4.0)) for x in places), stem(1.2, 3.5)]))
    assert feet is not None and np.abs(feet.means.double().numpy()[:, 0] - 11.0).max() < 0.2
    posts = feet_of(concatenate([stem(1.2, 2.5, at=(x, 4.0), label=POST) for x in places]))
    assert posts is not None and np.ptp(posts.means.double().numpy()[:, 0]) > 1.8

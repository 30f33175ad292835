"""What must hold for any scene: random ones, for each of which a property is checked rather than a picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.raster.scenes import GRADIENTS, camera, random_surfels, with_gradients
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, Rendered, render
from unveil_core.raster.spec import Limits
from unveil_core.surfels.surfels import Surfels

K = 5
few = settings(max_examples=25, deadline=None, derandomize=True)
views = st.builds(camera, st.integers(1, 70), st.integers(1, 50), st.floats(15.0, 120.0))
scenes = st.builds(
    lambda count, seed, spread, grazing, size, opacity: _varied(
        random_surfels(count, seed, labels=K, spread=spread, grazing=grazing), size, opacity
    ),
    st.integers(0, 300),
    st.integers(0, 10**6),
    st.floats(0.1, 3.0),
    st.booleans(),
    st.floats(-5.0, 2.0),
    st.floats(-6.0, 6.0),
)


def _varied(surfels: Surfels, size: float, opacity: float) -> Surfels:
    return replace(surfels, log_scales=surfels.log_scales + size, opacity_logits=surfels.opacity_logits + opacity)


def planes_of(out: Rendered) -> dict[str, torch.Tensor]:
    return {p: getattr(out, p).detach() for p in PLANES}


@few
@given(scenes, views)
def test_everything_is_finite_and_within_its_range(surfels: Surfels, view: Camera) -> None:
    leaves = with_gradients(surfels)
    out = render(leaves, view, PLANES, label_count=K)
    values = [getattr(out, p) for p in PLANES]
    torch.autograd.backward(values, [torch.ones_like(v) for v in values])
    made = planes_of(out)
    assert all(bool(torch.isfinite(v).all()) for v in made.values())
    assert all(bool(torch.isfinite(getattr(leaves, n).grad).all()) for n in GRADIENTS)
    alpha = made["alpha"]
    assert float(alpha.min()) >= 0
    assert float(alpha.max()) <= 1 - 0.99e-4
    torch.testing.assert_close(made["semantics"].sum(2), alpha, atol=5e-6, rtol=0)
    assert bool((made["normal"].norm(dim=2) <= alpha + 1e-5).all())
    assert float(made["distortion"].min()) > -1e-6
    # What weighs nothing has no gradient.
    hidden = ~out.visible
    assert all(not bool(getattr(leaves, n).grad[hidden].any()) for n in GRADIENTS)


@few
@given(scenes, views, st.integers(0, 10**6))
def test_the_order_in_the_list_does_not_matter(surfels: Surfels, view: Camera, seed: int) -> None:
    order = torch.randperm(len(surfels), generator=torch.Generator().manual_seed(seed))
    assert len(torch.unique(surfels.means[:, 2])) == len(surfels)
    a = planes_of(render(surfels, view, PLANES, label_count=K))
    b = planes_of(render(surfels.select(order), view, PLANES, label_count=K))
    assert all(torch.equal(a[p], b[p]) for p in PLANES)


@few
@given(scenes, views)
def test_exact_reach_changes_nothing(surfels: Surfels, view: Camera) -> None:
    """Every block of every tile in the bounding box, or only the blocks that a surfel reaches: the same bits."""
    exact = planes_of(render(surfels, view, PLANES, label_count=K))
    whole = planes_of(render(surfels, view, PLANES, label_count=K, limits=Limits(exact_reach=False)))
    assert all(torch.equal(exact[p], whole[p]) for p in PLANES)


@few
@given(scenes, st.integers(0, 10**6))
def test_moving_scene_and_camera_together_changes_nothing(surfels: Surfels, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=seed), rng.normal(size=3)
    quats = surfels.quats.double().numpy()
    turned = (turn * Rotation.from_quat(quats[:, [1, 2, 3, 0]])).as_quat()[:, [3, 0, 1, 2]] if len(quats) else quats
    moved = replace(
        surfels,
        means=torch.from_numpy(turn.apply(surfels.means.double().numpy()) + shift).float().reshape(-1, 3),
        quats=torch.from_numpy(turned).float().reshape(-1, 4),
    )
    view = camera()
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = turn.as_matrix(), shift
    there = replace(view, world_to_camera=view.world_to_camera @ np.linalg.inv(rigid))
    a = render(surfels, view, ("alpha", "depth"))
    b = render(moved, there, ("alpha", "depth"))
    for p in ("alpha", "depth"):
        x, y = getattr(a, p), getattr(b, p)
        # Positions are rounded anew: a contribution may fall on the other side of a cut.
        assert float(((x - y).abs() > 2e-3 * (1 + x.abs())).float().mean()) < 0.03, p


@few
@given(scenes, views, st.floats(0.5, 2.0))
def test_nothing_behind_can_take_light_away(surfels: Surfels, view: Camera, gap: float) -> None:
    if not len(surfels):
        return
    # The camera looks a little off the z axis; what is farthest by far is behind everything in any case.
    last = surfels.select(torch.zeros(1, dtype=torch.int64))
    last = replace(last, means=torch.tensor([[0.0, 0.0, 30.0 + gap]]), log_scales=torch.full((1, 2), 2.0))
    both = Surfels(*(torch.cat([getattr(surfels, n), getattr(last, n)]) for n in (*GRADIENTS, "labels")))
    before, after = render(surfels, view, ("alpha",)).alpha, render(both, view, ("alpha",)).alpha
    assert before is not None and after is not None
    assert bool((after >= before).all())

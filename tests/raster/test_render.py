"""render(): planes by groups, switches, refusals, screen gradients, and passes that live side by side."""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.raster.scenes import GRADIENTS, camera, random_ellipsoids, random_surfels, with_gradients
from unveil_core.base import array_pool
from unveil_core.base.parallel import threads
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import PLANES, render
from unveil_core.raster.passes import group_for
from unveil_core.surfels.surfels import Surfels


def all_bits(surfels: Surfels, view: Camera, planes: tuple[str, ...] = PLANES) -> list[torch.Tensor]:
    """Every plane, gradient and screen gradient of one pass."""
    leaves = with_gradients(surfels)
    out = render(leaves, view, planes, label_count=5)
    values = [getattr(out, plane) for plane in planes]
    g = torch.Generator().manual_seed(1)
    torch.autograd.backward(values, [torch.randn(v.shape, generator=g) for v in values])
    gradients = [getattr(leaves, n).grad for n in GRADIENTS]
    return [v.detach() for v in values] + gradients + [out.screen_gradients(), out.visible]


@pytest.mark.parametrize("made", [random_surfels, random_ellipsoids])
def test_two_runs_and_any_number_of_threads_give_the_same_bits(made: Callable[..., Surfels]) -> None:
    surfels, view = made(1500, 2, degree=2), camera(150, 90, 110.0)
    first = all_bits(surfels, view)
    for count in (1, 2, 3):
        with threads(count):
            for a, b in zip(first, all_bits(surfels, view), strict=True):
                assert torch.equal(a, b), f"{count} threads"


@pytest.mark.parametrize(
    ("planes", "group"),
    [
        (("alpha",), "colour"),
        (("rgb", "semantics"), "semantic"),
        (("rgb", "alpha", "median_depth", "normal"), "geometry"),
        (("depth", "semantics"), "all"),
        (("label_distortion",), "all"),
    ],
)
def test_a_group_gives_what_all_planes_give(planes: tuple[str, ...], group: str) -> None:
    assert group_for(planes) == group
    surfels, view = random_surfels(400, 6), camera(70, 45, 60.0)
    some, everything = render(surfels, view, planes, label_count=5), render(surfels, view, PLANES, label_count=5)
    for plane in PLANES:
        if plane in planes:
            torch.testing.assert_close(getattr(some, plane), getattr(everything, plane), atol=2e-6, rtol=2e-6)
        else:
            assert getattr(some, plane) is None


def test_planes_keep_what_they_stand_for() -> None:
    surfels, view = random_surfels(600, 8), camera(64, 48, 50.0)
    out = render(surfels, view, PLANES, label_count=5)
    alpha = out.alpha
    assert alpha is not None and out.semantics is not None and out.median_depth is not None and out.normal is not None
    assert float(alpha.min()) >= 0
    assert float(alpha.max()) <= 1
    torch.testing.assert_close(out.semantics.sum(dim=2), alpha, atol=2e-6, rtol=0)
    assert bool(((out.median_depth > 0) == (alpha > 0)).all())
    assert bool((out.normal.norm(dim=2) <= alpha + 1e-5).all())
    # Normals face the camera: each one's product with its viewing ray is negative, and so is their weighted sum's.
    local = torch.from_numpy(view.rays() @ view.world_to_camera[:3, :3].T).float()
    lone = render(surfels.select(torch.tensor([3])), view, ("normal", "alpha"))
    assert lone.normal is not None and lone.alpha is not None
    assert bool(((lone.normal * local).sum(dim=2)[lone.alpha > 0.01] < 0).all())


def test_sh_degree_uses_the_lower_coefficients_only() -> None:
    surfels = random_surfels(150, 9, degree=3)
    for degree in range(4):
        leaves = with_gradients(surfels)
        out = render(leaves, camera(), ("rgb",), sh_degree=degree)
        cut = render(replace(surfels, sh=surfels.sh[:, : (degree + 1) ** 2].contiguous()), camera(), ("rgb",))
        truth = render(surfels, camera(), ("rgb",), sh_degree=degree, backend="reference")
        assert out.rgb is not None and cut.rgb is not None and truth.rgb is not None
        assert torch.equal(out.rgb, cut.rgb)
        assert float((out.rgb - truth.rgb).detach().abs().median()) < 1e-6
        out.rgb.sum().backward()  # type: ignore[no-untyped-call]
        assert leaves.sh.grad is not None
        assert bool((leaves.sh.grad[:, (degree + 1) ** 2 :] == 0).all())
        assert float(leaves.sh.grad[:, : (degree + 1) ** 2].abs().sum()) > 0
    with pytest.raises(ValueError, match="sh_degree 2; 0 to 1"):
        render(random_surfels(3, 0), camera(), sh_degree=2)


@pytest.mark.parametrize("made", [random_surfels, random_ellipsoids])
def test_screen_gradients_are_those_by_the_principal_point(made: Callable[..., Surfels]) -> None:
    """Shifting the principal point shifts every projected mean and nothing else."""
    surfels, view = made(40, 12, degree=0), camera()
    planes = ("rgb", "depth", "normal")
    leaves = with_gradients(surfels)
    out = render(leaves, view, planes)
    with pytest.raises(RuntimeError, match="backward"):
        out.screen_gradients()
    # Away from the decisions that a shift could flip, and smooth: a weight that varies over the image.
    weight = torch.linspace(0, 1, 48).sin()[None, :] * torch.linspace(0, 2, 32).cos()[:, None]
    sum((getattr(out, p) * (weight if p == "depth" else weight[..., None])).sum() for p in planes).backward()  # type: ignore[union-attr]
    total = out.screen_gradients().double().sum(dim=0)

    def loss(dx: float, dy: float) -> float:
        moved = replace(view, cx=view.cx + dx, cy=view.cy + dy)
        doubled = Surfels(*(getattr(surfels, n).double() for n in GRADIENTS), surfels.labels)
        r = render(doubled, moved, planes, backend="reference")
        return float(sum((getattr(r, p) * (weight if p == "depth" else weight[..., None])).sum() for p in planes))

    step = 1e-7
    numeric = [
        (loss(step, 0) - loss(-step, 0)) / (2 * step),
        (loss(0, step) - loss(0, -step)) / (2 * step),
    ]
    assert float(total.norm()) > 0.1
    np.testing.assert_allclose(total.numpy(), numeric, rtol=2e-3, atol=2e-3)
    assert bool((out.screen_gradients()[~out.visible] == 0).all())


def test_two_live_passes_do_not_disturb_each_other() -> None:
    one, two = random_surfels(300, 20), random_surfels(500, 21)
    alone = [all_bits(s, camera()) for s in (one, two)]
    leaves = [with_gradients(s) for s in (one, two)]
    outs = [render(leaf, camera(), PLANES, label_count=5) for leaf in leaves]
    for k in (0, 1):
        values = [getattr(outs[k], plane) for plane in PLANES]
        g = torch.Generator().manual_seed(1)
        torch.autograd.backward(values, [torch.randn(v.shape, generator=g) for v in values])
        together = [v.detach() for v in values] + [getattr(leaves[k], n).grad for n in GRADIENTS]
        for a, b in zip(alone[k], together, strict=False):
            assert torch.equal(a, b)


def test_buffers_come_back_to_the_pool() -> None:
    surfels = random_surfels(50, 1)
    render(surfels, camera())
    assert 1 <= len(array_pool._pool) <= array_pool.POOL_SIZE
    before = len(array_pool._pool)
    out = render(with_gradients(surfels), camera())
    assert len(array_pool._pool) == before - 1, "held while the graph lives"
    del out
    gc.collect()
    assert len(array_pool._pool) == before, "returned when the graph is dropped without backward"
    lives = [render(with_gradients(surfels), camera()) for _ in range(4)]
    for out in lives:
        out.alpha.sum().backward()  # type: ignore[union-attr, no-untyped-call]
    assert len(array_pool._pool) == array_pool.POOL_SIZE


def test_no_graph_without_gradients() -> None:
    surfels = random_surfels(50, 1)
    with torch.no_grad():
        out = render(with_gradients(surfels), camera(), PLANES, label_count=5)
    assert all(not getattr(out, plane).requires_grad for plane in PLANES)
    leaves = with_gradients(surfels)
    plain, recorded = render(surfels, camera(), PLANES, label_count=5), render(leaves, camera(), PLANES, label_count=5)
    for plane in PLANES:
        assert torch.equal(getattr(plain, plane), getattr(recorded, plane).detach())


def test_backward_twice_and_parameters_changed_meanwhile_are_refused() -> None:
    leaves = with_gradients(random_surfels(20, 1))
    out = render(leaves, camera())
    assert out.rgb is not None
    out.rgb.sum().backward(retain_graph=True)  # type: ignore[no-untyped-call]
    with pytest.raises(RuntimeError, match="twice"):
        out.rgb.sum().backward()  # type: ignore[no-untyped-call]
    out = render(leaves, camera())
    with torch.no_grad():
        leaves.means.add_(1.0)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        out.rgb.sum().backward()  # type: ignore[union-attr, no-untyped-call]


@pytest.mark.parametrize("backend", ["cpu", "reference"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("name", GRADIENTS)
def test_a_value_that_is_not_finite_is_named_with_its_row(name: str, value: float, backend: str) -> None:
    surfels = random_surfels(40, 0)
    tensor = getattr(surfels, name).clone()
    tensor[31].view(-1)[-1] = value
    tensor[17].view(-1)[0] = value
    with pytest.raises(ValueError, match=f"^{name} is not finite in row 17$"):
        render(replace(surfels, **{name: tensor}), camera(), backend=backend)


def test_largest_finite_values_are_not_called_infinite() -> None:
    surfels = random_surfels(2, 0)
    render(replace(surfels, means=torch.full((2, 3), torch.finfo(torch.float32).max)), camera())


def wrong(**changes: object) -> tuple[Surfels, Camera]:
    surfels, view = random_surfels(4, 0), camera()
    for name, value in changes.items():
        if hasattr(surfels, name):
            surfels = replace(surfels, **{name: value})
        else:
            view = replace(view, **{name: value})
    return surfels, view


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({}, {"outputs": ("rgb", "colour")}, "not a plane: 'colour'"),
        ({}, {"backend": "cuda"}, "not a backend: 'cuda'"),
        ({}, {"near": 0.0}, "near 0.0 and far 100.0"),
        ({}, {"near": 5.0, "far": 2.0}, "near 5.0 and far 2.0"),
        ({}, {"label_count": 20}, "label_count 20; 1 to 19"),
        ({}, {"label_count": 0}, "label_count 0; 1 to 19"),
        ({"labels": torch.tensor([0, 1, 5, 2])}, {"label_count": 5}, "labels reach from 0 to 5"),
        ({"labels": torch.tensor([0, -1, 2, 2])}, {}, "labels reach from -1 to 2"),
        ({"labels": torch.zeros(4)}, {}, "labels are torch.float32"),
        ({"labels": torch.zeros(4, dtype=torch.int64, device="meta")}, {}, "means is on cpu, labels are on meta"),
        ({"quats": torch.zeros(4, 3)}, {}, r"quats has shape \(4, 3\), \(4, 4\) is needed"),
        ({"log_scales": torch.zeros(3, 2)}, {}, r"log_scales has shape \(3, 2\), \(4, 2 or 3\) is needed"),
        ({"log_scales": torch.zeros(4, 4)}, {}, "log_scales has shape"),
        ({"sh": torch.zeros(4, 5, 3)}, {}, "sh has shape"),
        ({"sh": torch.zeros(4, 3)}, {}, "sh has shape"),
        ({"means": torch.zeros(4, 3, dtype=torch.float64)}, {}, "means is torch.float64 on cpu"),
        ({"width": 0}, {}, "camera of 0 x 32 pixels"),
        ({"fx": float("nan")}, {}, "camera fx is nan"),
        ({"fy": -3.0}, {}, "camera fy is -3.0"),
        ({"world_to_camera": np.full((4, 4), np.nan)}, {}, "world_to_camera is not finite in row 0"),
        ({"world_to_camera": np.eye(3)}, {}, "world_to_camera has shape"),
    ],
)
def test_bad_input_is_refused_in_one_line(changes: dict, arguments: dict, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(ValueError, match=message) as caught:
        render(*wrong(**changes), **arguments)
    assert "\n" not in str(caught.value)


def test_tensors_that_are_not_contiguous_are_rendered_the_same() -> None:
    surfels = random_surfels(60, 3, degree=2)
    strided = Surfels(*(torch.stack([getattr(surfels, n)] * 2, dim=-1)[..., 0] for n in GRADIENTS), surfels.labels)
    assert not strided.sh.is_contiguous()
    for a, b in zip(all_bits(surfels, camera()), all_bits(strided, camera()), strict=True):
        assert torch.equal(a, b)

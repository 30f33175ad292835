"""What is chosen while the optimization runs: by held-out error, as much as the scene needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.adaptation.choices import AdaptSettings, Looks
from unveil_core.optimize.adaptation.colour_degree import choose_sh_degree, lowered, seen_from_anywhere
from unveil_core.optimize.adaptation.probes import HIDDEN_SHARE, hidden_blocks, hide, probe_error, probed_frames
from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.schedule import Phase, run_phase
from unveil_core.optimize.training.soft_labels import label_logits, render_soft_labels
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.optimize.training.views import TrainingView, training_view
from unveil_core.raster import render
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

SKY = Sky(torch.full((3, 8, 16), 0.5), np.eye(3))


def wall(degree: int, *, seed: int = 0) -> Surfels:
    """A wall of overlapping discs three metres away, with colours of that degree by direction."""
    g = torch.Generator().manual_seed(seed)
    x, y = torch.meshgrid(torch.linspace(-2, 2, 26), torch.linspace(-1.4, 1.4, 18), indexing="ij")
    count = x.numel()
    sh = torch.zeros(count, (degree + 1) ** 2, 3)
    sh[:, 0] = torch.rand(count, 3, generator=g) - 0.5
    sh[:, 1:] = 0.5 * torch.randn(count, sh.shape[1] - 1, 3, generator=g)
    return Surfels(
        torch.stack([x.flatten(), y.flatten(), torch.full((count,), 3.0)], 1),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(count, 1),
        torch.full((count, 2), -2.3),
        torch.full((count,), 3.0),
        sh,
        torch.zeros(count, dtype=torch.int64),
    )


def views_of(scene: Surfels, count: int = 12) -> list[TrainingView]:
    found = []
    for k in range(count):
        pose = np.eye(4)
        pose[0, 3] = -1.5 + 3.0 * k / (count - 1)
        camera = Camera(64, 48, 48.0, 48.0, 32.0, 24.0, pose)
        with torch.no_grad():
            out = render(scene, camera)
        assert out.rgb is not None and out.alpha is not None
        picture = (out.rgb + (1 - out.alpha)[..., None] * 0.5).clamp(0, 1).numpy()
        found.append(training_view(camera, np.round(picture * 255).astype(np.uint8), None, None, SKY))
    return found


def optimization(start: Surfels) -> Optimization:
    settings = TrainSettings(sky_rate=0.0)
    return Optimization(start, SKY, settings, LearningRates(means=1e-3), label_count=1, sky_label=None)


def phase_of(views: list[TrainingView], steps: int = 100) -> Phase:
    return Phase("coarse", views, steps, False, 0.5, 0.5)


def test_hidden_blocks_are_a_quarter_and_none_touch() -> None:
    hidden = hidden_blocks(256, 384)
    assert abs(hidden.mean() - HIDDEN_SHARE) < 0.05
    assert not (hidden[:, 31] & hidden[:, 64]).any() and hidden[40, 40] and not hidden[40, 10] and not hidden[10, 40]
    view = views_of(wall(0), 2)[0]
    assert np.array_equal(hide(view).weight.numpy() == 0, hidden_blocks(48, 64))  # type: ignore[union-attr]


@pytest.mark.parametrize("count", [1, 2, 3, 7, 25, 300])
def test_probed_frames_are_few_and_spread(count: int) -> None:
    probed = probed_frames(count)
    assert 1 <= len(probed) <= max(1, count // 6) and len(probed) <= 6 and all(0 <= i < count for i in probed)
    if count > 20:
        assert probed[0] > 0 and probed[-1] < count - 1


def test_probe_error_is_that_of_the_hidden_pixels() -> None:
    scene = wall(0)
    view = views_of(scene, 3)[1]
    state = optimization(scene)
    assert probe_error(state, [view]) < 1e-5
    spoilt = view.photograph.clone()
    hidden = torch.from_numpy(hidden_blocks(48, 64))
    spoilt[~hidden] = 0
    assert probe_error(state, [replace(view, photograph=spoilt)]) < 1e-5, "what is shown does not count"
    spoilt = view.photograph.clone()
    spoilt[hidden] += 128  # wraps around
    assert probe_error(state, [replace(view, photograph=spoilt)]) > 0.1


@pytest.mark.parametrize(("curve", "pays"), [(lambda w: 20 + 3 * np.log(w), True), (lambda w: 30 - 1 / w, False)])
def test_more_pays_while_the_curve_rises(curve: Callable[[float], float], pays: bool) -> None:
    looks = Looks(AdaptSettings(least_gain=0.1, looks=3), {})
    assert looks.pays(), "nothing was seen yet"
    for work in (7.0, 8.0, 9.0, 10.0):
        looks.seen.append((work, curve(work)))
    assert looks.pays() is pays
    gain = looks.gain()
    assert gain is not None and gain == pytest.approx(curve(11.0) - curve(10.0), abs=0.02)


def test_one_look_that_fell_short_ends_nothing() -> None:
    looks = Looks(AdaptSettings(least_gain=0.1, looks=3), {})
    looks.seen = [(float(w), 20 + 3 * np.log(w)) for w in (7, 8, 9)]
    looks.seen.append((10.0, 26.0))
    assert looks.gain() < 0.1 < looks.gain(back=1)  # type: ignore[operator]
    assert looks.pays()
    looks.seen.append((11.0, 26.0))
    assert not looks.pays()


@pytest.mark.parametrize("degree", [0, 2])
def test_the_degree_of_colour_is_what_the_scene_needs(degree: int) -> None:
    scene = wall(degree)
    views = views_of(scene)
    probed = probed_frames(len(views))
    start = replace(scene, sh=torch.zeros(len(scene), 9, 3))
    state = optimization(start)
    phase = phase_of([hide(v) if i in probed else v for i, v in enumerate(views)])
    looks = Looks(AdaptSettings(every=1000, sh_gain=0.4), {"coarse": [views[i] for i in probed]})
    run_phase(state, phase)
    chosen, told = choose_sh_degree(state, phase, 24, looks)
    assert told["chosen"] == chosen.trainable.surfels.sh_degree == degree, told
    assert set(told["psnr_of_degree"]) == {"0", "1", "2"}
    assert state.trainable.surfels.sh_degree == 2, "the trials leave the state as it was"


def test_lowering_keeps_what_the_views_show() -> None:
    scene = wall(2)
    cameras = [v.camera for v in views_of(scene)]
    truth = [v.image for v in views_of(scene)]

    def error(surfels: Surfels) -> float:
        return float(
            np.mean([float((v.image - t).square().mean()) for v, t in zip(views_of(surfels), truth, strict=True)])
        )

    cut = [error(replace(scene, sh=scene.sh[:, : (d + 1) ** 2].contiguous())) for d in (0, 1)]
    fitted = [error(lowered(scene, d, cameras)) for d in (0, 1)]
    assert fitted[1] < fitted[0] < 0.5 * cut[0] and fitted[1] < 0.5 * cut[1]
    same = lowered(scene, 1, cameras[:0])
    assert torch.allclose(same.sh, scene.sh[:, :4], atol=1e-6), "nobody sees it: as it was"


def test_a_phase_ends_when_told_and_grows_after_the_look() -> None:
    scene = wall(0)
    state = optimization(scene)
    seen: list[int] = []

    def watch(_: Optimization, phase: Phase, turn: int) -> bool:
        seen.append(turn)
        return turn == 7

    assert run_phase(state, phase_of(views_of(scene, 3), 50), watch) == 7
    assert seen == list(range(1, 8))


def test_soft_labels_are_rendered_as_hard_ones_when_they_are_sure() -> None:
    scene = wall(0)
    scene = replace(scene, labels=torch.arange(len(scene)) % 5)
    camera = views_of(scene, 2)[0].camera
    sure = 60 * torch.nn.functional.one_hot(scene.labels, 5).float()
    soft = render_soft_labels(scene, sure, camera, near=0.2, far=100.0)
    hard = render(scene, camera, ("semantics",), label_count=5).semantics
    assert hard is not None and float((soft - hard).abs().max()) < 1e-5
    logits = label_logits(scene.labels, 5).requires_grad_(True)
    render_soft_labels(scene, logits, camera, near=0.2, far=100.0)[..., 2].sum().backward()
    assert logits.grad is not None and float(logits.grad[:, 2].max()) > 0 and float(logits.grad[:, 3].min()) < 0


def test_the_empty_scene_has_one_colour_from_all_directions_unless_a_degree_is_given() -> None:
    scene, cameras = wall(2), [view.camera for view in views_of(wall(2))]
    plain = seen_from_anywhere(scene, cameras, None)
    assert plain.sh_degree == 0
    assert seen_from_anywhere(scene, cameras, 2) is scene
    assert seen_from_anywhere(plain, cameras, None) is plain

"""Re-optimization: what may move moves to what the targets show, and to the depth that is expected there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.seed import seed_pixels
from unveil_core.optimize.reoptimize import REOPTIMIZE_PRESETS, ReoptimizeSettings, reoptimize
from unveil_core.optimize.training.losses import LossWeights
from unveil_core.raster.picture import render_numpy
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

CAMERA = Camera(32, 24, 30.0, 30.0, 16.0, 12.0, np.eye(4))
SKY = Sky(torch.full((3, 8, 16), 0.5), np.eye(3))
SETTINGS = ReoptimizeSettings(
    iterations=40, weights=LossWeights(semantic=0, label_distortion=0, opacity=0, distortion=0, normal=0)
)


def wall(depth_m: float) -> Surfels:
    """A gray wall before the camera, a surfel per pixel."""
    shape = (24, 32)
    return seed_pixels(
        CAMERA,
        np.full((*shape, 3), 128, np.uint8),
        np.full(shape, depth_m),
        np.zeros(shape, np.int64),
        np.ones(shape, bool),
        sh_degree=0,
    )


def again(surfels: Surfels, movable: np.ndarray, settings: ReoptimizeSettings, **more: object) -> Surfels:
    target = np.full((24, 32, 3), 200, np.uint8)
    return reoptimize(surfels, movable, SKY, [(CAMERA, target)], settings, near=0.2, far=100.0, label_count=1, **more)  # type: ignore[arg-type]


def test_only_what_may_move_takes_the_targets_colour() -> None:
    start = wall(4.0)
    movable = start.means[:, 0].numpy() > 0
    done = again(start, movable, SETTINGS)
    assert torch.equal(done.sh[~movable], start.sh[~movable])
    rgb = render_numpy(done, CAMERA, near=0.2, far=100.0)["rgb"]
    assert rgb[4:-4, 20:-3].mean() > 0.57 and abs(rgb[4:-4, 3:12].mean() - 0.5) < 0.02


def test_an_expected_depth_draws_the_surface_to_it() -> None:
    start = wall(4.0)
    everything = np.ones(len(start), bool)
    expected = np.zeros((24, 32))
    expected[:, 16:] = 4.2
    weighted = replace(SETTINGS, weights=replace(SETTINGS.weights, depth=10.0))
    free = render_numpy(again(start, everything, SETTINGS), CAMERA, near=0.2, far=100.0)["depth"]
    drawn = render_numpy(again(start, everything, weighted, depths=[expected]), CAMERA, near=0.2, far=100.0)["depth"]
    right, left = np.s_[4:-4, 19:-4], np.s_[4:-4, 4:12]
    assert drawn[right].mean() - free[right].mean() > 0.015
    assert abs(drawn[left].mean() - free[left].mean()) < 0.01


def test_an_interrupted_re_optimization_comes_to_the_same_end(tmp_path: Path) -> None:
    start = wall(4.0)
    everything = np.ones(len(start), bool)
    whole = again(start, everything, SETTINGS)

    def kill(done: int, *_: object, **__: float) -> None:
        if done in (7, 23):
            raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            again(start, everything, SETTINGS, checkpoint=Checkpoint(tmp_path / "c.npz", every_s=0.0), progress=kill)
    resumed = again(start, everything, SETTINGS, checkpoint=Checkpoint(tmp_path / "c.npz", every_s=0.0))
    assert all(np.array_equal(a, resumed.arrays()[name]) for name, a in whole.arrays().items())
    # Not begun anew: of the steps those before the checkpoint are not taken again.
    steps: list[int] = []
    last = Checkpoint(tmp_path / "c.npz", every_s=0.0)
    again(start, everything, SETTINGS, checkpoint=last, progress=lambda done, *_, **__: steps.append(done))
    assert steps == [] or steps[0] > 23


def test_each_frame_has_its_turn_and_steps_grow_with_the_drive() -> None:
    for preset in REOPTIMIZE_PRESETS.values():
        assert preset.scaled(28) == preset and preset.scaled(100).iterations == max(100, preset.iterations)
        assert preset.scaled(1000).iterations >= max(1000, 10 * preset.iterations)

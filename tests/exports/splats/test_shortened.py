"""Splats that stick out of the street are shortened for other programs, and in no frame."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.exports.conftest import Street
from tests.exports.readers.splat_ply import read_as_reference
from tests.exports.street import WORLD
from unveil_core.app.cli import main
from unveil_core.exports.splats.shortened import LONGEST_M, SHARE_OF_DISTANCE, TIMES_WIDTH, shortened
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import Surfels

CAMERAS = np.array([[0.0, 0.0, 1.5], [4.0, 0.0, 1.5]])


def surfels(*extents: tuple[float, ...], x: float = 2.0) -> Surfels:
    """Grey ones of these extents, metres, all at one place."""
    n = len(extents)
    return Surfels(
        means=torch.tensor([[x, 0.0, 1.5]]).repeat(n, 1),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
        log_scales=torch.tensor(extents).log(),
        opacity_logits=torch.zeros(n),
        sh=torch.zeros(n, 1, 3),
        labels=torch.zeros(n, dtype=torch.int64),
    )


@pytest.mark.parametrize("turned", [False, True])
def test_a_needle_is_shortened_and_keeps_its_width(turned: bool) -> None:
    extents = (0.2, 60.0) if turned else (60.0, 0.2)
    found = shortened(surfels(extents), CAMERAS).log_scales.exp()[0].tolist()
    assert found == pytest.approx([0.2, LONGEST_M] if turned else [LONGEST_M, 0.2])


def test_far_and_broad_ones_may_be_longer() -> None:
    far = shortened(surfels((60.0, 0.2), x=104.0), CAMERAS)
    assert far.log_scales.exp()[0].tolist() == pytest.approx([100 * SHARE_OF_DISTANCE, 0.2])
    broad = shortened(surfels((60.0, 7.0)), CAMERAS)
    assert broad.log_scales.exp()[0].tolist() == pytest.approx([7 * TIMES_WIDTH, 7])
    thick = shortened(surfels((7.0, 1e-4, 60.0)), CAMERAS)
    assert thick.log_scales.exp()[0].tolist() == pytest.approx([7, 1e-4, 7 * TIMES_WIDTH])


def test_others_stay_as_they_are_to_the_last_bit() -> None:
    scene = surfels((0.99, 1e-3), (1.9, 0.96), (60.0, 0.2))
    found = shortened(scene, CAMERAS)
    assert torch.equal(found.log_scales[:2], scene.log_scales[:2]) and found.log_scales[2, 0] < scene.log_scales[2, 0]
    assert shortened(scene.select(torch.arange(2)), CAMERAS).log_scales.equal(scene.log_scales[:2])
    assert shortened(scene, np.zeros((0, 3))) is scene


def test_of_many_each_counts_from_its_own_nearest_camera() -> None:
    rng = np.random.default_rng(0)
    many = surfels(*[(60.0, 0.2)] * 5000)
    many = replace(many, means=torch.from_numpy(rng.uniform(-200, 200, (5000, 3)).astype(np.float32)))
    away = np.minimum(*(np.linalg.norm(many.means.numpy() - c, axis=1) for c in CAMERAS))
    found = shortened(many, CAMERAS).log_scales[:, 0].exp().numpy()
    np.testing.assert_allclose(found, np.clip(SHARE_OF_DISTANCE * away, LONGEST_M, 60), rtol=1e-5)


def test_an_export_has_no_needles_and_the_workspace_keeps_its_scene(street: Street, tmp_path: Path) -> None:
    root = Path(shutil.copytree(street.root, tmp_path / "ws"))
    scene = read_surfels(root / "surfels/empty.ply")
    scales = scene.log_scales.clone()
    scales[:] = scales.clamp(max=0)  # a metre
    scales[0] = torch.tensor([50.0, 0.1]).log()
    write_surfels(replace(scene, log_scales=scales), root / "surfels/empty.ply", to_world=WORLD)
    before = (root / "surfels/empty.ply").read_bytes()
    assert main(["export", str(root), "--to", "splat-ply", "-o", str(tmp_path)]) == 0
    found = np.exp(read_as_reference(tmp_path / "empty_splats.ply").of("scale_0")) / WORLD.scale
    assert found[0] < 5 and np.allclose(found[1:], scales[1:, 0].exp(), rtol=1e-5)
    assert (root / "surfels/empty.ply").read_bytes() == before

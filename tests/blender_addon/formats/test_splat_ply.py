"""Gaussians written for Unveil to read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from blender_addon.formats.gaussians import gaussians_of
from blender_addon.formats.ply_file import read_ply
from blender_addon.formats.splat_files.splat_ply import splat_ply
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import Surfels


def test_what_was_read_is_written_as_it_was(tmp_path: Path) -> None:
    generator = torch.Generator().manual_seed(1)
    surfels = Surfels(
        means=torch.randn(30, 3, generator=generator),
        quats=torch.nn.functional.normalize(torch.randn(30, 4, generator=generator), dim=1),
        log_scales=torch.randn(30, 2, generator=generator),
        opacity_logits=torch.randn(30, generator=generator),
        sh=torch.rand(30, 9, 3, generator=generator) - 0.5,
        labels=torch.arange(30) % 4,
    )
    write_surfels(surfels, tmp_path / "one.ply", comments=("labels of a street",))
    ply = read_ply(tmp_path / "one.ply")
    found = gaussians_of(ply, 1.0, np.arange(30))
    facts = {"label": ply.vertices["label"].astype(np.int32), "instance": np.arange(30, dtype=np.int32)}
    (tmp_path / "two.ply").write_bytes(splat_ply(found, facts, ply.comments))
    again = read_surfels(tmp_path / "two.ply")
    for name, values in surfels.arrays().items():
        np.testing.assert_allclose(again.arrays()[name], values, atol=1e-5, err_msg=name)
    written = read_ply(tmp_path / "two.ply")
    assert written.comments == ply.comments and np.array_equal(written.vertices["instance"], np.arange(30))


def test_opacities_at_both_ends_stay_finite(tmp_path: Path) -> None:
    found = gaussians_of(read_ply(_one(tmp_path, [-200.0, 0.0, 200.0])), 1.0, np.arange(3))
    (tmp_path / "two.ply").write_bytes(splat_ply(found, {}))
    logits = read_surfels(tmp_path / "two.ply").opacity_logits.numpy()
    assert np.isfinite(logits).all() and logits[0] < -10 and abs(logits[1]) < 1e-5 and logits[2] > 10


def _one(folder: Path, logits: list[float]) -> Path:
    count = len(logits)
    surfels = Surfels(
        means=torch.zeros(count, 3),
        quats=torch.tensor([[1.0, 0, 0, 0]] * count),
        log_scales=torch.zeros(count, 2),
        opacity_logits=torch.tensor(logits),
        sh=torch.zeros(count, 1, 3),
        labels=torch.zeros(count, dtype=torch.long),
    )
    write_surfels(surfels, folder / "one.ply")
    return folder / "one.ply"

"""Surfels as the Gaussians that splat renderers draw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from blender_addon.formats.gaussians import THIN_M, gaussians_of
from blender_addon.formats.ply_file import Ply, read_ply
from unveil_core.exports.splats.shortened import shortened
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import Surfels


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Twenty surfels whose harmonics have the second degree."""
    generator = torch.Generator().manual_seed(0)
    surfels = Surfels(
        means=torch.randn(20, 3, generator=generator),
        quats=torch.randn(20, 4, generator=generator),
        log_scales=torch.randn(20, 2, generator=generator),
        opacity_logits=torch.randn(20, generator=generator),
        sh=torch.rand(20, 9, 3, generator=generator) - 0.5,
        labels=torch.arange(20) % 3,
    )
    write_surfels(surfels, tmp_path / "empty.ply")
    return tmp_path / "empty.ply"


def test_they_are_the_surfels_in_the_scenes_units(file: Path) -> None:
    known, chosen = read_surfels(file), np.array([0, 3, 19])
    found = gaussians_of(read_ply(file), 100.0, chosen)
    assert len(found) == 3
    assert all(part.dtype == np.float32 for part in (found.positions, found.scales, found.rotations, found.base))
    assert np.allclose(found.positions, known.means.numpy()[chosen] * 100, rtol=1e-5)
    assert np.allclose(found.scales[:, :2], known.log_scales.exp().numpy()[chosen] * 100, rtol=1e-5)
    assert np.allclose(found.scales[:, 2], THIN_M * 100, rtol=1e-5)
    assert np.allclose(np.linalg.norm(found.rotations, axis=1), 1, atol=1e-6)
    quats = torch.nn.functional.normalize(known.quats, dim=1).numpy()[chosen]
    assert np.allclose(found.rotations, quats, atol=1e-6)
    assert np.allclose(found.base[:, :3], known.sh[:, 0].numpy()[chosen], atol=1e-6)
    assert np.allclose(found.base[:, 3], known.opacity_logits.sigmoid().numpy()[chosen], atol=1e-6)
    assert found.harmonics.shape == (8, 3, 3)
    assert np.allclose(found.harmonics, known.sh[:, 1:].numpy()[chosen].transpose(1, 0, 2), atol=1e-6)


def test_needles_are_as_short_as_the_command_exports_them(file: Path) -> None:
    known, cameras = read_surfels(file), np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    long = replace(known, means=known.means * 20, log_scales=known.log_scales + torch.tensor([4.0, 0.0]))
    write_surfels(long, file)
    exported = shortened(long, cameras).log_scales
    found = gaussians_of(read_ply(file), 100.0, np.arange(20), cameras)
    assert (exported != long.log_scales).any(dim=1).sum() > 10
    assert np.allclose(found.scales[:, :2], exported.exp().numpy() * 100, rtol=1e-5)


def changed(ply: Ply, **values: float) -> Ply:
    table = ply.vertices.copy()
    for name, value in values.items():
        table[name] = value
    return Ply(table, ply.triangles, ply.comments)


def test_numbers_that_nothing_draws_are_brought_into_range(file: Path) -> None:
    everyone = np.arange(20)
    extreme = changed(read_ply(file), scale_0=-90.0, scale_1=500.0, opacity=-1e30, rot_0=0, rot_1=0, rot_2=0, rot_3=0)
    found = gaussians_of(extreme, 1.0, everyone)
    assert np.allclose(found.scales[0, :2], (THIN_M, 1e4), rtol=1e-4) and (found.base[:, 3] >= 0).all()
    assert (found.rotations == (1, 0, 0, 0)).all()
    with pytest.raises(ValueError, match="not finite"):
        gaussians_of(changed(read_ply(file), f_dc_1=np.nan), 1.0, everyone)


def test_what_is_no_surfel_file_is_refused(file: Path) -> None:
    ply = read_ply(file)
    plain = Ply(ply.vertices[["x", "y", "z"]], ply.triangles, ())
    with pytest.raises(ValueError, match="holds no surfels"):
        gaussians_of(plain, 1.0, np.arange(20))


def test_half_a_band_of_harmonics_is_left_out(file: Path) -> None:
    """Five coefficients of a channel: the first three are the first degree."""
    ply = read_ply(file)
    kept = [n for n in ply.vertices.dtype.names or () if not n.startswith("f_rest_") or int(n[7:]) < 15]
    found = gaussians_of(Ply(ply.vertices[kept], ply.triangles, ()), 1.0, np.arange(20))
    assert found.harmonics.shape == (3, 20, 3)
    assert (found.harmonics[1, :, 2] == ply.vertices["f_rest_11"]).all()

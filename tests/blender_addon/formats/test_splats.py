"""Points and surfels as faces."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from blender_addon.formats.ply_file import read_ply
from blender_addon.formats.splats import SIGMAS, discs, surfel_discs, tetrahedra
from unveil_core.surfels.ply import read_surfels, write_surfels


def test_discs_lie_as_the_surfels_do(tmp_path: Path) -> None:
    import torch

    from unveil_core.surfels.surfels import Surfels

    generator = torch.Generator().manual_seed(0)
    surfels = Surfels(
        means=torch.randn(20, 3, generator=generator),
        quats=torch.randn(20, 4, generator=generator),
        log_scales=torch.randn(20, 2, generator=generator),
        opacity_logits=torch.zeros(20),
        sh=torch.rand(20, 1, 3, generator=generator) - 0.5,
        labels=torch.arange(20) % 3,
    )
    write_surfels(surfels, tmp_path / "full.ply")
    centres, first, second, colors = surfel_discs(read_ply(tmp_path / "full.ply"))
    known = read_surfels(tmp_path / "full.ply")
    assert np.allclose(centres, known.means.numpy(), atol=1e-6)
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.allclose(np.abs((normals * known.normals().numpy()).sum(axis=1)), 1, atol=1e-5)
    lengths = np.stack([np.linalg.norm(first, axis=1), np.linalg.norm(second, axis=1)], axis=1)
    assert np.allclose(lengths, SIGMAS * known.log_scales.exp().numpy(), rtol=1e-5)
    assert np.abs(colors / 255 - (known.sh[:, 0].numpy() * 0.28209479177387814 + 0.5)).max() < 0.003
    vertices, quads = discs(centres, first, second)
    assert np.allclose(vertices[quads].mean(axis=1), centres, atol=1e-5)


def test_points_are_closed_and_face_outwards() -> None:
    centres = np.array([[0.0, 0, 0], [5, 5, 5]])
    vertices, faces = tetrahedra(centres, np.array([1.0, 0.5]))
    middle = vertices[faces].mean(axis=1)
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    assert ((middle - np.repeat(centres, 4, axis=0)) * normals).sum(axis=1).min() > 0
    assert np.allclose(np.linalg.norm(vertices[4:] - centres[1], axis=1), 0.5, atol=1e-6)

"""PLY files: what is written is read, discs as discs and ellipsoids as ellipsoids."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.plain_ply import read_plain_ply
from tests.raster.scenes import random_ellipsoids, random_surfels
from unveil_core.base.errors import UnveilError
from unveil_core.geometry.similarity import Similarity
from unveil_core.surfels.ply import read_surfels, write_surfels
from unveil_core.surfels.surfels import THIN_LOG_SCALE, Surfels


@pytest.mark.parametrize("surfels", [random_surfels(9, 0, degree=2), random_ellipsoids(9, 0, degree=0)])
def test_round_trip(surfels: Surfels, tmp_path: Path) -> None:
    path = tmp_path / "surfels.ply"
    write_surfels(
        surfels, path, to_world=Similarity(translation=np.array([1.0, 2.0, 3.0])), comments=("labels road, car",)
    )
    read = read_surfels(path)
    for field in fields(Surfels):
        assert torch.equal(getattr(read, field.name), getattr(surfels, field.name)), field.name
    vertex = read_plain_ply(path)
    third = torch.from_numpy(vertex["scale_2"].copy())
    assert torch.equal(third, surfels.log_scales[:, 2] if surfels.ellipsoids else torch.full((9,), THIN_LOG_SCALE))
    normals = torch.from_numpy(np.stack([vertex[n] for n in ("nx", "ny", "nz")], axis=1))
    assert torch.equal(normals, surfels.normals())


def test_ellipsoids_without_their_third_scale_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "surfels.ply"
    write_surfels(random_ellipsoids(2, 0), path)
    # As long, so that the header stays what the reader expects.
    path.write_bytes(path.read_bytes().replace(b"float scale_2", b"float scale_9"))
    with pytest.raises(UnveilError, match="lacks the attribute scale_2"):
        read_surfels(path)

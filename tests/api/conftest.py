"""A finished workspace, surveyed far off, with 16-bit footage in a lens, and a small drive; neither is to be changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.drives.tiny_drive import make_tiny_drive
from tests.exports.street import make_workspace
from unveil_core.surfels.sky import Sky, save_sky


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = make_workspace(tmp_path_factory.mktemp("api"))
    save_sky(Sky(torch.full((3, 4, 8), 0.7), np.eye(3)), root / "surfels/sky.npz")
    return root


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny_drive(tmp_path_factory.mktemp("api") / "street").parent

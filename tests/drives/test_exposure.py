"""The doors between photographs and canonical colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import WorkspaceError
from unveil_core.drives.exposure import IDENTITY, Exposure, Exposures, read_exposures, write_exposures

DIM = Exposure(np.array([0.6, 0.7, 0.65]), np.array([0.02, -0.01, 0.0]))


def test_the_identity_hands_back_the_picture_itself() -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    assert IDENTITY.is_identity and not DIM.is_identity
    assert IDENTITY.canonical(picture) is picture and IDENTITY.photographed(picture) is picture


def test_out_and_in_again_is_the_same_up_to_rounding() -> None:
    canonical = np.random.default_rng(0).integers(10, 250, (20, 30, 3)).astype(np.uint8)
    photograph = DIM.photographed(canonical)
    assert np.abs(photograph / 255 - (canonical / 255 * DIM.gain + DIM.bias)).max() <= 0.5 / 255 + 1e-9
    again = DIM.canonical(photograph)
    assert np.abs(again.astype(int) - canonical).max() <= 1


def test_what_is_brighter_than_white_is_clipped() -> None:
    assert DIM.canonical(np.full((1, 1, 3), 255, np.uint8)).tolist() == [[[255, 255, 255]]]


def test_exposures_are_kept_in_a_file(tmp_path: Path) -> None:
    path = tmp_path / "exposure.json"
    assert read_exposures(path).is_identity
    write_exposures(Exposures({("front", "07"): DIM}, {"used": True}), path)
    found = read_exposures(path)
    assert found.figures == {"used": True} and not found.is_identity
    assert (found.known["front", "07"].gain == DIM.gain).all() and (found.known["front", "07"].bias == DIM.bias).all()
    path.write_text('{"frames": [{"camera": "front"}]}')
    with pytest.raises(WorkspaceError, match=r"exposure.json.*reconstruct"):
        read_exposures(path)

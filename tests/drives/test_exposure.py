"""The doors between photographs and canonical colours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.drives.exposure import IDENTITY, Exposure, Exposures, read_exposures, write_exposures

DIM = Exposure(np.array([0.6, 0.7, 0.65]), np.array([0.02, -0.01, 0.0]))


def test_the_identity_hands_back_the_picture_itself() -> None:
    picture = np.zeros((4, 5, 3), np.uint8)
    assert IDENTITY.is_identity and not DIM.is_identity
    assert IDENTITY.canonical(picture) is picture and IDENTITY.photographed(picture) is picture


@pytest.mark.parametrize(
    "exposure", [DIM, Exposure(np.full(3, 0.7), np.zeros(3)), Exposure(np.full(3, 1.6), np.full(3, 0.03))]
)
@pytest.mark.parametrize("bits", [8, 16])
def test_in_and_out_again_is_the_same_on_all_levels(exposure: Exposure, bits: int) -> None:
    """To half a step of 16 bits, and above the level that a gain brings to white, too."""
    most = (1 << bits) - 1
    codes = np.repeat(np.arange(most + 1, dtype=np.uint8 if bits == 8 else np.uint16)[:, None, None], 3, axis=2)
    photograph = codes if bits == 8 else codes.astype(np.float32) / 257
    canonical = exposure.canonical(photograph)
    assert np.abs(canonical / 255 - (codes / most - exposure.bias) / exposure.gain).max() < 0.5 / 65535
    assert np.abs(exposure.photographed(canonical) / 255 - codes / most).max() < 0.5 / 65535


def test_what_is_brighter_than_white_stays() -> None:
    canonical = DIM.canonical(np.full((1, 1, 3), 255, np.uint8))
    assert (canonical > 255 / 0.75).all()
    assert np.allclose(DIM.photographed(canonical), 255)


@pytest.mark.parametrize(
    "known", [{}, {("front", "07"): DIM, ("front", "08"): Exposure(np.full(3, 1.4), np.full(3, 0.05))}]
)
def test_between_stages_a_picture_keeps_all_that_photographs_show(
    known: dict[tuple[str, str], Exposure], tmp_path: Path
) -> None:
    exposures = Exposures(known)
    ends = np.array([[[0, 0, 0]], [[255, 255, 255]]], np.uint8)
    for exposure in (IDENTITY, *known.values()):
        canonical = exposure.canonical(ends)
        write_image_atomic(tmp_path / "a.png", exposures.packed(canonical))
        assert np.abs(exposures.read_packed(tmp_path / "a.png") - canonical).max() < 1.01 / 257
    own = np.arange(256, dtype=np.uint8)[:, None, None].repeat(3, axis=2)
    assert known or np.array_equal(exposures.packed(own), own.astype(np.uint16) * 257)


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

"""The scene as somebody edited it in Blender: rendered and exported as a state of its own."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.exports.conftest import Street
from tests.plain_ply import read_plain_ply
from unveil_core.app.cli import main
from unveil_core.surfels.ply import read_surfels, write_surfels


@pytest.fixture
def edited(street: Street, tmp_path: Path) -> Path:
    """A workspace whose edited scene is every other surfel, a metre to the side, each of an object of its own."""
    root = Path(shutil.copytree(street.root, tmp_path / "workspace"))
    half = read_surfels(root / "surfels/empty.ply")
    half = half.select(torch.arange(0, len(half), 2))
    half.means[:, 0] += 1.0
    write_surfels(half, root / "surfels/edited.ply", more={"instance": np.arange(len(half)) + 5})
    return root


def test_splats_of_the_edited_scene(edited: Path, tmp_path: Path) -> None:
    for state in ("empty", "edited"):
        command = ["export", str(edited), "--to", "splat-ply", "--state", state, "-o", str(tmp_path / "out")]
        assert main(command) == 0
    whole, half = (read_plain_ply(tmp_path / f"out/{state}_splats.ply") for state in ("empty", "edited"))
    assert len(half["x"]) == (len(whole["x"]) + 1) // 2
    assert np.array_equal(half["instance"], np.arange(len(half["x"])) + 5)
    moved = np.stack([half[axis] - whole[axis][::2] for axis in "xyz"], axis=1)
    assert np.allclose(np.linalg.norm(moved, axis=1) / np.linalg.norm(moved[0]), 1, atol=1e-3) and moved[0].any()
    assert main(["export", str(edited), "--to", "spz,las", "--state", "edited", "-o", str(tmp_path / "more")]) == 0


@pytest.mark.parametrize(
    ("formats", "told"),
    [("glb", "the edited scene has no mesh"), ("png", "png shows the empty street only")],
)
def test_what_has_no_such_state_is_one_line(
    edited: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], formats: str, told: str
) -> None:
    assert main(["export", str(edited), "--to", formats, "--state", "edited", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1


def test_a_workspace_that_was_not_edited_says_where(
    street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(street.root), "--to", "spz", "--state", "edited", "-o", str(tmp_path / "out")]) == 2
    assert "Not made yet: the edited scene (edit the Gaussians in Blender 5.3" in capsys.readouterr().err

"""A whole run with a device of its own: planes that nothing here may touch before they are brought back, and the same files."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.raster.test_on_device import far_render
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.raster import on_device

SETTINGS = RunSettings(quality="draft", iterations=20, remove=("vehicle",), device="cpu", baselines=True)
COMPARED = (".ply", ".png", ".npy", ".npz", ".glb")


def files(root: Path) -> dict[str, bytes]:
    """The results of a run, by name."""
    found = (p for p in sorted(root.rglob("*")) if p.suffix in COMPARED and not p.is_relative_to(root / "report"))
    return {str(p.relative_to(root)): p.read_bytes() for p in found}


def test_no_stage_takes_a_plane_past_the_one_helper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    here = files(run(drive, tmp_path / "here", SETTINGS).root)
    monkeypatch.setattr(on_device, "render", far_render)
    assert files(run(drive, tmp_path / "far", SETTINGS).root) == here
    assert {Path(name).parts[0] for name in here} >= {"surfels", "frames", "meshes", "inpainted", "masks"}

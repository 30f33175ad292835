"""A whole run in several blocks: as good as in one, and without a seam where they meet."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sample_scenes.box_worlds import Lens, Way, make_box_world
from sample_scenes.long_street import long_street, long_way
from unveil_core.base.errors import UnveilError, WorkspaceError
from unveil_core.ground import blocks
from unveil_core.pipeline.run import run, stage_named
from unveil_core.pipeline.runner import run_block, run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

FRAMES, SIZE = 20, (120, 80)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    way = long_way(FRAMES, size=SIZE)
    lens = Lens(size=SIZE, focal=0.65 * SIZE[0])
    folder = tmp_path_factory.mktemp("blocks") / "street"
    return make_box_world(folder, long_street(FRAMES, seed=3), Way(way.places, way.headings, [lens]), rays=4000)


def run_in_blocks(drive: Path, root: Path, length_m: float, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    monkeypatch.setattr(blocks, "BLOCK_M", length_m)
    settings = RunSettings(quality="draft", remove=("vehicle",), iterations=120, memory="64M")
    return run(drive, root, settings, until="deliver")


def error_of(drive: Path, workspace: Workspace) -> np.ndarray:
    """(F,) mean squared error of each frame's removed pixels."""
    found = []
    for i in range(FRAMES):
        name = f"camera/{i:04d}.png"
        removed = cv2.imread(str(workspace.root / "masks/removed" / name), cv2.IMREAD_GRAYSCALE) > 127
        ours, truth = (
            cv2.imread(str(p)).astype(float)
            for p in (workspace.root / "frames" / name, drive.parent / "truth/images" / name)
        )
        found.append(np.square(ours - truth)[removed].mean())
    return np.array(found)


def test_blocks_are_as_good_as_one_piece(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run_in_blocks(drive, tmp_path / "one", 100.0, monkeypatch)
    parts = run_in_blocks(drive, tmp_path / "two", 10.0, monkeypatch)
    assert len(whole.state()["stages"]["reconstruct"]["choices"].get("blocks", ())) == 0
    assert len(parts.state()["stages"]["reconstruct"]["choices"]["blocks"]) == 2
    one, two = error_of(drive, whole), error_of(drive, parts)
    assert 10 * np.log10(two.mean() / one.mean()) < 0.5
    # The frames beside a border are no worse than the others, compared with one piece.
    worse = 10 * np.log10(two / one)
    borders = [8, 9, 10, 11]
    assert worse[borders].mean() < np.delete(worse, borders).mean() + 0.5
    assert not list(parts.root.glob(".partial-*"))


def test_blocks_made_alone_make_the_stage(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "BLOCK_M", 6.5)
    settings = RunSettings(quality="draft", remove=("vehicle",), iterations=30)
    whole = run(drive, tmp_path / "whole", settings, until="reconstruct")
    parts = run(drive, tmp_path / "parts", settings, until="choose")
    stage = stage_named("reconstruct")
    for number in (2, 0, 1):
        assert run_block(parts, stage, number, settings, drive)
    before = len(parts.events())
    run(drive, tmp_path / "parts", settings, until="reconstruct")
    said = [e["message"] for e in parts.events()[before:] if e["stage"] == "reconstruct"]
    assert not [m for m in said if m.startswith("block")]
    assert (parts.root / "surfels/full.ply").read_bytes() == (whole.root / "surfels/full.ply").read_bytes()
    assert not run_block(parts, stage, 0, settings, drive), "nothing is left to make"
    # A workspace whose stage is to be made again, of the same photographs, has its blocks; asked for by force it has not.
    parts.replace_stage("reconstruct", {})
    for force, expected in ((False, False), (True, True)):
        before = len(parts.events())
        assert run_stages(parts, [stage], settings, drive, force=force) == ["reconstruct"]
        said = [e["message"] for e in parts.events()[before:] if e["stage"] == "reconstruct"]
        assert "started" in said and any(m.startswith("block") for m in said) == expected
        assert (parts.root / "surfels/full.ply").read_bytes() == (whole.root / "surfels/full.ply").read_bytes()
    for name, number, wrong in (
        ("remove", 0, "not made in blocks"),
        ("reoptimize", 0, "has no"),
        ("reconstruct", 3, ""),
    ):
        given = replace(settings, seed=1)
        with pytest.raises(UnveilError, match=wrong or "there is no block 3"):
            run_block(parts, stage_named(name), number, given, drive)


def test_blocks_share_a_workspace_and_a_run_waits_for_nobody(tmp_path: Path) -> None:
    space = Workspace.create(tmp_path / "w")
    with space.lock(shared=True), space.lock(shared=True), pytest.raises(WorkspaceError, match="in use"), space.lock():
        pass
    with space.lock(), pytest.raises(WorkspaceError, match="in use"), space.lock(shared=True):
        pass

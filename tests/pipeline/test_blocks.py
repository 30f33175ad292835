"""A whole run in several blocks: without a seam where they meet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.worlds.box_worlds import Lens, Way, make_box_world
from tests.worlds.long_street import long_street, long_way
from unveil_core.base.errors import UnveilError, WorkspaceError
from unveil_core.drives.imported import read_imported
from unveil_core.ground import blocks
from unveil_core.ground.files import read_ground
from unveil_core.inpaint import cleaning, emptied
from unveil_core.inpaint.chart.street_chart import INVENTED, PLANES
from unveil_core.inpaint.frames.propagate import RemainingScene
from unveil_core.inpaint.stretches import Stretch
from unveil_core.pipeline import runner
from unveil_core.pipeline.run import run, stage_named
from unveil_core.pipeline.runner import run_block, run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.surfels.ply import read_surfels
from unveil_core.surfels.scene_edit import read_edit
from unveil_core.surfels.surfels import Surfels
from unveil_core.workspace.files import load_array
from unveil_core.workspace.workspace import Workspace

FRAMES, SIZE = 20, (96, 64)
BORDER_M = 9.5
"""Where the two blocks of ten frames meet, metres along x."""
STREET = long_street(FRAMES, seed=0)
ACROSS = next(b for b in STREET.boxes if b.removed and abs(b.centre[0] - BORDER_M) < b.size[0] / 2 - 0.5)
"""A parked car that reaches from one block into the other."""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    way = long_way(FRAMES, size=SIZE)
    lens = Lens(size=SIZE, focal=0.65 * SIZE[0])
    folder = tmp_path_factory.mktemp("blocks") / "street"
    return make_box_world(folder, STREET, Way(way.places, way.headings, [lens]), rays=2500)


def run_in_blocks(drive: Path, root: Path, length_m: float, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    monkeypatch.setattr(blocks, "BLOCK_M", length_m)
    settings = RunSettings(quality="draft", remove=("vehicle",), iterations=60, memory="64M")
    return run(drive, root, settings, until="deliver")


@dataclass
class Cut:
    """A run in two blocks, and what its stage ``inpaint`` did: the block that was cleaned first comes first.

    Attributes:
        stretches: of the street, by block.
        known: what was known of the scene before a block was cleaned; invented: its new surfels.
        told: stage and message of each call of the stages' progress.
    """

    workspace: Workspace
    stretches: list[Stretch] = field(default_factory=list)
    known: list[RemainingScene] = field(default_factory=list)
    invented: list[Surfels | None] = field(default_factory=list)
    told: list[tuple[str, str]] = field(default_factory=list)


@pytest.fixture(scope="module")
def cut(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cut]:
    root = tmp_path_factory.mktemp("cut") / "two"
    found = Cut(Workspace(root))
    clean, divide = cleaning.propagate_inpainting, emptied.cut_street

    def watched(tasks, known, *arguments, **options):  # type: ignore[no-untyped-def]
        found.known.append(known)
        found.invented.append(clean(tasks, known, *arguments, **options))
        return found.invented[-1]

    def noted(*arguments):  # type: ignore[no-untyped-def]
        found.stretches = divide(*arguments)
        return found.stretches

    progress = runner._Attempt.progress

    def heard(self, done, total, message="", **metrics):  # type: ignore[no-untyped-def]
        found.told.append((self.stage.name, message))
        progress(self, done, total, message, **metrics)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner._Attempt, "progress", heard)
        patch.setattr(cleaning, "propagate_inpainting", watched)
        patch.setattr(emptied, "cut_street", noted)
        run_in_blocks(drive, root, 10.0, patch)
    yield found


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


def test_frames_beside_a_border_show_none(drive: Path, cut: Cut) -> None:
    """How good a run in blocks is compared with one piece, ``benchmarks/machine/scale.py --borders`` measures."""
    assert len(cut.workspace.state()["stages"]["reconstruct"]["choices"]["blocks"]) == 2
    error = error_of(drive, cut.workspace)
    assert 10 * np.log10(255**2 / error.mean()) > 18
    # The street is as hard there as some frames before and after: in one piece, half a decibel.
    beside, around = error[8:12].mean(), np.concatenate([error[4:8], error[12:16]]).mean()
    assert 10 * np.log10(beside / around) < 1
    assert not list(cut.workspace.root.glob(".partial-*"))


def test_what_is_done_stretch_by_stretch_is_told_so(cut: Cut) -> None:
    """Work that tells nothing for minutes cannot be cancelled either."""
    for message in ("looking for the sun", "renewing the ground", "completing facades"):
        assert cut.told.count(("inpaint", message)) == len(cut.stretches) == 2, message
    assert ("remove", "looking for what remains of objects") in cut.told
    assert ("ground", "following lines and kerbs") in cut.told


def test_an_object_across_two_blocks_goes_whole_and_one_of_them_owns_its_place(cut: Cut) -> None:
    low, high = (ACROSS.centre[0] + sign * ACROSS.size[0] / 2 for sign in (-1, 1))
    assert low < BORDER_M - 0.5 and high > BORDER_M + 0.5
    root = cut.workspace.root
    to_world = read_imported(cut.workspace.drive_dir, points=False).to_world
    means = to_world.to_world(read_surfels(root / "surfels/full.ply").means.double().numpy())
    gone, instance = read_edit(root / "surfels/edit.npz").removed, load_array(root / "surfels/instances.npy")
    inside = (np.abs(means - ACROSS.centre) < np.array(ACROSS.size) / 2 + 0.05).all(axis=1) & (means[:, 2] > 0.4)
    ids = []
    for half in (inside & (means[:, 0] < BORDER_M), inside & (means[:, 0] >= BORDER_M)):
        assert half.sum() > 20 and gone[half].mean() > 0.98
        ids.append(np.bincount(instance[half]).argmax())
    assert ids[0] == ids[1] > 0, "it is one object"
    # Its place is filled by one block: the stretches part beside it, not where the blocks do.
    street = read_ground(cut.workspace.ground_npz).street
    assert street is not None
    footprint = np.array([[x, ACROSS.centre[1], 0.0] for x in np.linspace(low, high, 9)])
    s = street.path.to_street(to_world.to_local(footprint))[:, 0]
    assert [stretch.owns(s).all() for stretch in cut.stretches if stretch.owns(s).any()] == [True]


def test_what_a_block_fills_is_known_to_the_one_before(cut: Cut) -> None:
    later, earlier = cut.known
    invented = cut.invented[0]
    assert invented is not None and len(invented) > 50
    assert not np.isin(rows_of(invented), rows_of(later.surfels)).any()
    assert np.isin(rows_of(invented), rows_of(earlier.surfels)).all()
    # The ground, too: what the earlier block's frames see of the later one's is as that filled it.
    assert later.ground is not None and earlier.ground is not None
    ours, theirs = earlier.ground.chart, later.ground.chart
    border = cut.stretches[1].s[0]
    skip, own = (round((border - chart.s_start) / chart.texel) for chart in (ours, theirs))
    length = min(len(ours.source) - skip, len(theirs.source) - own)
    assert length * ours.texel > 10.0
    handed, filled = ours.part(skip, skip + length), theirs.part(own, own + length)
    assert (filled.source == INVENTED).any()
    for name in PLANES:
        one, other = getattr(handed, name), getattr(filled, name)
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), name


def rows_of(surfels: Surfels) -> np.ndarray:
    """(N,) the places of surfels, bit for bit, as one value each."""
    return np.ascontiguousarray(surfels.means.detach().numpy()).view("V12").ravel()


def test_blocks_made_alone_make_the_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "BLOCK_M", 4.5)
    settings = RunSettings(quality="draft", remove=("vehicle",), iterations=20)
    drive = make_box_world(tmp_path / "short", long_street(13.0), long_way(13, size=(32, 24)), rays=300)
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
        ("remove", 0, "Not made in blocks"),
        ("reoptimize", 0, "has no"),
        ("reconstruct", 3, ""),
    ):
        given = replace(settings, seed=1)
        with pytest.raises(UnveilError, match=wrong or "Not a block: 3"):
            run_block(parts, stage_named(name), number, given, drive)


def test_blocks_share_a_workspace_and_a_run_waits_for_nobody(tmp_path: Path) -> None:
    space = Workspace.create(tmp_path / "w")
    with space.lock(shared=True), space.lock(shared=True), pytest.raises(WorkspaceError, match="In use"), space.lock():
        pass
    with space.lock(), pytest.raises(WorkspaceError, match="In use"), space.lock(shared=True):
        pass

"""A run over a street on which a car drives: it is gone from every frame, and was never part of the scene."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.moving_street import FRAMES, MOVER_ID, ONCOMING, PARKED_ID, make_moving_street
from unveil_core.base.errors import SettingsError
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.drives import open_drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.evaluate.baselines import BASELINES
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.semantics.labels import choose_labels
from unveil_core.surfels.ply import read_surfels
from unveil_core.workspace.movers import read_moving, write_moving
from unveil_core.workspace.workspace import Workspace


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive: neither ids nor boxes, only semantics."""
    return make_moving_street(tmp_path_factory.mktemp("moving") / "street", ONCOMING).parent


@pytest.fixture(scope="module")
def workspace(street: Path) -> Workspace:
    """Everything up to the clean frames, in few steps."""
    settings = RunSettings(quality="draft", iterations=40, splats=10_000, seed=1)
    return run(street, street.parent / "workspace", settings, until="deliver")


def picture(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def psnr(workspace: Workspace, street: Path, masks: list[np.ndarray], folder: str | None = "frames") -> float:
    """Of the masked pixels against the true empty street; ``folder`` None = of the photographs."""
    error = []
    for i, mask in enumerate(masks):
        path = street / "images" if folder is None else workspace.root / folder / "camera"
        truth = picture(street / f"truth/images/{i:02d}.png").astype(float)
        error.append(np.square(picture(path / f"{i:02d}.png") - truth)[mask].ravel())
    return float(10 * np.log10(255**2 / np.concatenate(error).mean()))


def best_of_one_frame(street: Path, masks: list[np.ndarray]) -> float:
    """PSNR of the masked pixels as the best baseline fills them, which knows no other frame."""
    error: dict[str, list[np.ndarray]] = {name: [] for name in BASELINES}
    for i, mask in enumerate(masks):
        truth = picture(street / f"truth/images/{i:02d}.png").astype(float)
        for name, fill in BASELINES.items():
            error[name].append(np.square(fill(picture(street / f"images/{i:02d}.png"), mask) - truth)[mask].ravel())
    return max(float(10 * np.log10(255**2 / np.concatenate(e).mean())) for e in error.values())


def test_the_frames_show_the_street_behind_the_mover(workspace: Workspace, street: Path) -> None:
    ids = [picture(street / f"instances/{i:02d}.png") for i in range(FRAMES)]
    own = [n == MOVER_ID for n in ids]
    assert psnr(workspace, street, own) > best_of_one_frame(street, own) + 4
    removed = [picture(workspace.root / f"masks/removed/camera/{i:02d}.png") > 0 for i in range(FRAMES)]
    assert all((r | ~(n > 0)).all() for r, n in zip(removed, ids, strict=True))


def test_the_shadow_of_the_mover_goes_too(workspace: Workspace, street: Path) -> None:
    moving, drive = read_moving(workspace.root), read_imported(workspace.drive_dir)
    shadows = [moving.shadow(f) for f in drive.frames]
    assert sum(int(s.sum()) for s in shadows) > 1500
    assert psnr(workspace, street, shadows) > psnr(workspace, street, shadows, None) + 5
    for i, shadow in enumerate(shadows):
        marked = picture(workspace.root / f"masks/shadows/camera/{i:02d}.png") > 0
        marked |= picture(workspace.root / f"masks/removed/camera/{i:02d}.png") > 0
        assert (marked | ~shadow).all()


def test_the_mover_never_becomes_surfels(workspace: Workspace) -> None:
    drive = read_imported(workspace.drive_dir)
    surfels = read_surfels(workspace.surfels_full)
    scene = choose_labels(drive)
    cars = surfels.labels.numpy() == scene.labels.index("car")
    where = surfels.means.double().numpy() + drive.to_world.translation
    on_its_way = (np.abs(where[:, 1] - 1.75) < 1.2) & (where[:, 0] > 5) & (where[:, 0] < 30)
    parked = (np.abs(where[:, 1] + 3.05) < 1.2) & (where[:, 0] > 12) & (where[:, 0] < 18)
    assert (cars & parked).sum() > 300 and (cars & on_its_way).sum() <= 0.01 * (cars & parked).sum()
    blue = surfels.sh[:, 0, 2] - surfels.sh[:, 0, 0] > 1.0
    low = (where[:, 2] > 0.2) & (where[:, 2] < 1.5)
    assert int((blue.numpy() & on_its_way & low).sum()) == 0
    entries = json.loads((workspace.root / "instances.json").read_text())
    assert len(entries) == 1 and entries[0]["class"] == "car"


def test_the_workspace_tells_what_moved(workspace: Workspace) -> None:
    entries = json.loads((workspace.root / "movers/movers.json").read_text())
    assert [(e["number"], e["class"], e["evidence"], e["id"]) for e in entries] == [(1, "car", "seen through", None)]
    assert workspace.state()["stages"]["segment"]["movers"] == 1
    assert not list((workspace.root / "movers").rglob("*.partial"))


def test_keep_leaves_everything_standing(street: Path, tmp_path: Path) -> None:
    found = run(street, tmp_path / "kept", RunSettings(quality="draft", movers="keep"), until="segment")
    drive = read_imported(found.drive_dir)
    moving = read_moving(found.root)
    assert moving.count == 0 and moving.hidden(drive, FrameCache()) is None and moving.static_part(drive) is drive
    assert [p.name for p in (found.root / "movers").rglob("*")] == ["movers.json"]
    with pytest.raises(SettingsError, match="Not a choice of movers: 'chase'"):
        RunSettings(movers="chase")


def test_a_workspace_without_the_folder_has_no_movers(street: Path, tmp_path: Path) -> None:
    assert read_moving(tmp_path).count == 0
    drive = open_drive(street)
    assert write_moving(drive, choose_labels(drive), tmp_path / "movers", "auto", no_progress, FrameCache()) == 1
    moving = read_moving(tmp_path)
    ids = np.full((drive.frames[6].camera.height, drive.frames[6].camera.width), PARKED_ID)
    static = moving.ids_of_static(drive.frames[6], ids)
    assert static is not None and ((static == 0) == moving.pixels(drive.frames[6])).all() and (static == 0).any()


class Killed(BaseException):
    pass


@pytest.mark.parametrize("ids", [True, False])
def test_what_was_found_before_a_kill_is_not_looked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ids: bool
) -> None:
    path = make_moving_street(tmp_path / "street", ONCOMING, instances=ids, boxes=False)
    drive = import_drive(open_drive(path), tmp_path / "drive")
    scene = choose_labels(drive, ["car"])

    def run(folder: Path, kept: Kept, calls: int = 10**6) -> int:
        """Calls of progress until the end, or until it is killed."""
        made = 0

        def progress(done: int, total: int, message: str = "", **_: float) -> None:
            nonlocal made
            made += 1
            if made == calls:
                raise Killed

        folder.mkdir(exist_ok=True)
        assert write_moving(drive, scene, folder, "auto", progress, FrameCache(), kept) == 1
        return made

    def files(folder: Path) -> dict[str, bytes]:
        return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}

    whole = run(tmp_path / "whole", Kept())
    for calls in (2, len(drive.frames) - 1, whole - 3):
        kept, parts = Kept(tmp_path / f"kept{calls}", every_s=0.0), tmp_path / f"parts{calls}"
        with pytest.raises(Killed):
            run(parts, kept, calls)
        # An object's verdict is told again; the rest is not looked at a second time.
        assert run(parts, kept) <= whole - calls + 2 * ids + 1
        assert files(parts) == files(tmp_path / "whole") != {}

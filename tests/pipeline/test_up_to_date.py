"""What a workspace remembers of files: of its own alone. Of a truth only what is named like frames is read."""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.pipeline.outside import files_of_truth
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.up_to_date import LONGEST_UNUSED_S, Digests
from unveil_core.workspace.workspace import Workspace


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache/outside"


@pytest.fixture
def workspace(tmp_path: Path, cache: Path) -> Workspace:
    assert main(["import", str(make_tiny_drive(tmp_path / "drive")), "-o", str(tmp_path / "ws")]) == 0
    return Workspace.open(tmp_path / "ws")


def test_files_outside_are_remembered_by_the_user_alone(workspace: Workspace, cache: Path, tmp_path: Path) -> None:
    inside = json.loads((workspace.root / ".digests.json").read_text())
    assert "drive/cameras.json" in inside and str(tmp_path) not in (workspace.root / ".digests.json").read_text()
    (kept,) = cache.iterdir()
    assert str(tmp_path / "drive/transforms.json") in json.loads(kept.read_text())
    assert os.name == "nt" or cache.stat().st_mode & 0o077 == 0
    photograph = tmp_path / "drive/images/00.png"
    known, remembered = Digests(workspace).of_file(photograph), json.loads(kept.read_text())
    remembered[str(photograph)][-1] = "remembered"
    kept.write_text(json.dumps(remembered))
    assert Digests(workspace).of_file(photograph) == "remembered"
    shutil.rmtree(cache)
    assert Digests(workspace).of_file(photograph) == known


def test_what_a_workspace_says_of_files_outside_is_not_believed(workspace: Workspace, tmp_path: Path) -> None:
    photograph = tmp_path / "drive/images/00.png"
    state = photograph.stat()
    said = {k: [state.st_size, state.st_mtime_ns, "forged"] for k in (str(photograph), "../drive/images/00.png")}
    (workspace.root / ".digests.json").write_text(json.dumps(said))
    digests = Digests(workspace)
    assert digests.of_file(photograph) != "forged"
    digests.save()
    assert json.loads((workspace.root / ".digests.json").read_text()) == {}


def test_what_is_remembered_goes_after_a_while_and_a_cache_is_no_must(
    workspace: Workspace, cache: Path, tmp_path: Path
) -> None:
    old = cache / "old.json"
    old.write_text("{}")
    os.utime(old, (0, time.time() - LONGEST_UNUSED_S - 100))
    digests = Digests(workspace)
    digests.of_file(tmp_path / "drive/images/00.png")
    digests.save()
    assert not old.exists() and len(list(cache.iterdir())) == 1
    shutil.rmtree(cache)
    cache.write_text("in the way")
    digests.save()


def test_of_a_truth_the_files_named_like_frames_are_read_and_no_folder_is_listed(
    workspace: Workspace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    wanted = ["images/00.png", "images/01.jpg", "removed/00.png", "depth/01.png", "free/transforms.json"]
    wanted += ["free/images/over.png", "free/unseen/over.png"]
    for name in (*wanted, "id_rsa", "images/holiday.png", "taxes/2025.txt", "images/00.txt", "free/images/00.png"):
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_bytes(b"x")
    cameras = workspace.drive_dir / "cameras.json"
    stored = json.loads(cameras.read_text())
    pose = json.loads((tmp_path / "drive/transforms.json").read_text())["frames"][0]["transform_matrix"]
    view = {"file_path": "images/over.png", "transform_matrix": pose, "fl_x": 30, "w": 40, "h": 30}
    (home / "free/transforms.json").write_text(json.dumps({"frames": [view]}))
    cameras.write_text(json.dumps({**stored, "truth_root": str(home)}))
    found = files_of_truth(workspace, RunSettings(), tmp_path / "drive")
    assert sorted(name for name, _ in found) == sorted(wanted)
    (home / "free/transforms.json").write_text("{")
    assert len(files_of_truth(workspace, RunSettings(), tmp_path / "drive")) == len(wanted) - 2
    cameras.write_text(json.dumps({**stored, "truth_root": "/"}))
    listed: list[object] = []
    for name in ("scandir", "listdir", "walk"):
        real = getattr(os, name)
        monkeypatch.setattr(
            os, name, lambda path=".", *rest, real=real, **more: listed.append(path) or real(path, *rest, **more)
        )
    assert files_of_truth(workspace, RunSettings(), tmp_path / "drive") == [] and listed == []

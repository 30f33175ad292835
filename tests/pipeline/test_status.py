"""What `unveil status` says is what a run would do; nothing is computed or changed."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.pipeline.run import run
from unveil_core.pipeline.status import stage_states
from unveil_core.workspace.workspace import Workspace


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Imported and segmented."""
    drive = make_tiny_drive(tmp_path / "drive")
    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    assert main(["segment", str(tmp_path / "ws")]) == 0
    return tmp_path / "ws"


def states(root: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, str]:
    capsys.readouterr()
    assert main(["status", str(root), "--json", *options]) == 0
    found: dict[str, str] = json.loads(capsys.readouterr().out)["stages"]
    return found


def test_done_and_to_do(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (root / "workspace.json").read_bytes()
    found = states(root, capsys)
    assert list(found)[:5] == ["import", "objects", "segment", "choose", "reconstruct"]
    assert found["import"] == found["segment"] == "done"
    assert {found[n] for n in ("reconstruct", "remove", "mesh", "report")} == {"to do"}
    assert (root / "workspace.json").read_bytes() == before
    assert main(["status", str(root)]) == 0
    assert "segment      done\n" in capsys.readouterr().out


def test_settings_make_stale_what_they_influence_and_what_follows(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert states(root, capsys, "--seed", "7")["segment"] == "done"
    assert states(root, capsys, "--movers", "keep")["segment"] == "stale"
    assert states(root, capsys, "--without", "quilting")["segment"] == "done"
    changed = states(root, capsys, "--work-side", "32")
    assert changed["import"] == changed["segment"] == "stale"
    assert main(["segment", str(root), "--movers", "keep"]) == 0  # recorded from here on
    assert states(root, capsys)["segment"] == "done"
    assert states(root, capsys, "--movers", "auto")["segment"] == "stale"


def test_a_changed_drive_is_seen(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(root.parent / "drive/transforms.json", lambda d: d["frames"].pop())
    found = states(root, capsys)
    assert found["import"] == found["segment"] == "stale"


def test_a_photograph_that_was_replaced_with_size_and_time_of_the_old_one_is_seen(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As ``cp -p`` and ``rsync -t`` leave it."""
    path = sorted((root.parent / "drive/images").rglob("*.png"))[0]
    before = path.stat()
    other = path.with_name("other")
    other.write_bytes(path.read_bytes()[:-1] + b"\0")
    os.utime(other, ns=(before.st_atime_ns, before.st_mtime_ns))
    other.replace(path)
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert states(root, capsys)["import"] == "stale"


def test_a_copy_of_drive_and_workspace_is_up_to_date(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its files are others to the system, of the same content; and what an earlier version remembered is none any more."""
    drive = root.parent / "drive"
    drive.rename(root.parent / "before")
    shutil.copytree(root.parent / "before", drive)
    root.rename(root.parent / "ws_before")
    shutil.copytree(root.parent / "ws_before", root)
    for known in (None, "{}", json.dumps({"drive/cameras.json": [1, 2, "0" * 32]})):
        if known is not None:
            (root / ".digests.json").write_text(known)
        found = states(root, capsys)
        assert found["import"] == found["segment"] == "done"


def test_failed_running_and_killed(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    workspace = Workspace.open(root)
    workspace.update_stage("reconstruct", status="failed")
    assert states(root, capsys)["reconstruct"] == "failed"
    workspace.update_stage("reconstruct", status="running")
    assert states(root, capsys)["reconstruct"] == "to do"  # nobody works here: it was killed
    with workspace.lock():
        assert states(root, capsys)["reconstruct"] == "running"


def test_each_stage_records_the_settings_that_made_it(root: Path) -> None:
    stages = Workspace.open(root).state()["stages"]
    assert stages["import"]["settings"] == {
        "poses": "auto",
        "work_side": None,
        "quality": "standard",
        "scale": None,
        "camera_height": None,
        "up": None,
        "scene": None,
        "cameras": [],
        "frames": None,
        "sweeps": "all",
        "model": None,
        "labels": None,
        "instance_maps": None,
        "label_classes": None,
        "mask_removes": None,
        "pose_convention": None,
        "segmenter": None,
    }
    assert set(stages["segment"]["settings"]) >= {"movers"}


def test_another_choice_does_not_make_the_scene_stale(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["choose", str(root)]) == 0
    changed = states(root, capsys, "--instances", "300")
    assert changed["choose"] == "stale" and changed["segment"] == "done"


def test_a_drive_that_was_named_from_the_working_folder_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_tiny_drive(tmp_path / "drive")
    monkeypatch.chdir(tmp_path)
    workspace = run(Path("drive"), Path("w"), until="import")
    monkeypatch.chdir(tmp_path.parent)
    assert stage_states(Workspace.open(tmp_path / "w"))["import"] == "done", workspace.root

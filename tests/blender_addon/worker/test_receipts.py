"""What the batch command saved may be saved again; what somebody else put there, or changed, may not."""

from __future__ import annotations

import os
from pathlib import Path

from blender_addon.worker.receipts import is_somebodys, note_saved


def test_only_what_was_saved_and_not_changed_is_ours(tmp_path: Path) -> None:
    workspace, shot = tmp_path / "ws", tmp_path / "shot.blend"
    workspace.mkdir()
    assert not is_somebodys(workspace, shot)
    shot.write_bytes(b"BLENDER")
    assert is_somebodys(workspace, shot)
    note_saved(workspace, shot)
    assert not is_somebodys(workspace, shot)
    assert is_somebodys(tmp_path / "other", shot)
    shot.write_bytes(b"BLENDER, and an evening's work")
    assert is_somebodys(workspace, shot)
    assert str(tmp_path) not in (workspace / "blender/saved.json").read_text()


def test_links_and_folders_are_somebodys(tmp_path: Path) -> None:
    workspace, shot = tmp_path / "ws", tmp_path / "shot.blend"
    workspace.mkdir()
    shot.write_bytes(b"BLENDER")
    note_saved(workspace, shot)
    (tmp_path / "folder.blend").mkdir()
    assert is_somebodys(workspace, tmp_path / "folder.blend")
    if os.name != "nt":
        link = tmp_path / "link.blend"
        link.symlink_to(shot)
        note_saved(workspace, link)
        assert is_somebodys(workspace, link)


def test_a_damaged_record_is_none(tmp_path: Path) -> None:
    workspace, shot = tmp_path / "ws", tmp_path / "shot.blend"
    (workspace / "blender").mkdir(parents=True)
    shot.write_bytes(b"BLENDER")
    for content in (b"[]", b"\xff", b'{"a": 1}'):
        (workspace / "blender/saved.json").write_bytes(content)
        assert is_somebodys(workspace, shot)
    note_saved(workspace, shot)
    assert not is_somebodys(workspace, shot)

"""Class, object and provenance of each Gaussian, by the files of a workspace."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from blender_addon.formats.ply_file import Ply
from blender_addon.formats.splat_files.splat_facts import FACTS, facts_of
from unveil_core.inpaint import origin
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, write_edit


def scene(labels: list[int]) -> Ply:
    table = np.zeros(len(labels), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<f4")])
    table["label"] = labels
    return Ply(table, np.zeros((0, 3), np.int32), ())


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Of five surfels the second goes, the fourth is displaced, the fifth lost a shadow; two were added."""
    (tmp_path / "surfels").mkdir()
    np.save(tmp_path / "surfels/instances.npy", np.array([0, 7, 0, 0, 3]))
    masks = (np.array(values, bool) for values in ([0, 1, 0, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]))
    removed, displaced, relit = masks
    new = surfels_from_points(
        np.zeros((2, 3)), np.zeros((2, 3), np.uint8), np.zeros(2, np.int64), np.zeros((2, 3)), np.ones(2)
    )
    origins = np.array([origin.CONTINUED, origin.INVENTED], np.uint8)
    write_edit(SceneEdit(removed, NOT_SHORTENED, displaced, relit, new, origins), tmp_path / "surfels/edit.npz")
    return tmp_path


def test_the_full_scene_is_seen(workspace: Path) -> None:
    found = facts_of(workspace, "full", scene([2, 0, 1, 1, 0]), np.array([1, 4]))
    assert {name: values.tolist() for name, values in found.items()} == {
        "label": [0, 0],
        "instance": [7, 3],
        "provenance": [origin.SEEN_ELSEWHERE] * 2,
    }
    assert tuple(found) == FACTS and all(values.dtype == np.int32 for values in found.values())


def test_the_empty_scene_is_what_stays_then_what_was_added(workspace: Path) -> None:
    found = facts_of(workspace, "empty", scene([2, 1, 0, 5, 6]), np.arange(5))
    assert found["instance"].tolist() == [0, 0, 3, 0, 0]
    expected = [origin.SEEN_ELSEWHERE] * 2 + [origin.RELIT, origin.CONTINUED, origin.INVENTED]
    assert found["provenance"].tolist() == expected


@pytest.mark.parametrize("spoil", ["missing", "another scene", "text", "pickled"])
def test_what_the_workspace_does_not_tell_is_left_out(workspace: Path, spoil: str) -> None:
    path = workspace / "surfels/instances.npy"
    if spoil == "missing":
        path.unlink()
    elif spoil == "another scene":
        np.save(path, np.arange(3))
    elif spoil == "text":
        path.write_text("no numbers")
    else:
        np.save(path, np.array([{}, 1, 2, 3, 4], object), allow_pickle=True)
    found = facts_of(workspace, "empty", scene([2, 1, 0, 5, 6]), np.arange(5))
    assert set(found) == {"label", "provenance"}


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x05\x06" + b"\0" * 18])
def test_an_edit_that_cannot_be_read_leaves_class_alone(workspace: Path, content: bytes) -> None:
    (workspace / "surfels/edit.npz").write_bytes(content)
    assert set(facts_of(workspace, "empty", scene([2, 1, 0, 5, 6]), np.arange(5))) == {"label"}

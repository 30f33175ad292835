"""What becomes of a scene: applied in one way, kept in one file, and a damaged file is told in a line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from unveil_core.base.errors import WorkspaceError
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, Shortened, read_edit, write_edit
from unveil_core.surfels.surfels import Surfels


def some_surfels(count: int, first: float = 0.0) -> Surfels:
    """Surfels of which each differs from the others, their means counted from ``first``."""
    at = torch.arange(count, dtype=torch.float32) + first
    ones = torch.ones(count, 1)
    quats = torch.cat([ones, torch.zeros(count, 3)], dim=1)
    return Surfels(
        at[:, None] * torch.ones(3), quats, at[:, None] * torch.ones(2), at, torch.full((count, 1, 3), 0.2), at.long()
    )


def an_edit() -> SceneEdit:
    """Of five surfels: the first goes, the third makes room, the last is shorter and relit; two are new."""
    marks = np.eye(5, dtype=bool)
    shorter = Shortened(np.array([4]), np.full((1, 3), 4.5, np.float32), np.full((1, 2), -1.0, np.float32))
    return SceneEdit(marks[0], shorter, marks[2], marks[4], some_surfels(2, 10.0), np.array([3, 4], np.uint8))


def test_what_stays_comes_first_then_what_is_added() -> None:
    empty = an_edit().apply(some_surfels(5))
    assert empty.means[:, 0].tolist() == [1.0, 3.0, 4.5, 10.0, 11.0]
    assert empty.log_scales[:, 0].tolist() == [1.0, 3.0, -1.0, 10.0, 11.0]
    origins = an_edit().carried(np.where(an_edit().relit, 1, 2), an_edit().origin)
    assert origins.tolist() == [2, 2, 1, 3, 4]


def test_an_edit_that_only_takes_away_leaves_the_rest_as_it_is() -> None:
    scene = some_surfels(4)
    edit = SceneEdit.removing(np.array([False, True, False, False]), NOT_SHORTENED)
    assert torch.equal(edit.apply(scene).means, scene.means[[0, 2, 3]]) and not edit.relit.any()


@pytest.mark.parametrize("edit", [an_edit(), replace(an_edit(), added=None, origin=np.zeros(0, np.uint8))])
def test_a_file_gives_back_what_was_written(edit: SceneEdit, tmp_path: Path) -> None:
    write_edit(edit, tmp_path / "edit.npz")
    found, scene = read_edit(tmp_path / "edit.npz", 5), some_surfels(5)
    for name, array in edit.apply(scene).arrays().items():
        assert np.array_equal(found.apply(scene).arrays()[name], array), name
    assert np.array_equal(found.origin, edit.origin) and np.array_equal(found.relit, edit.relit)


def test_a_missing_file_is_one_line_that_tells_the_causes_apart(tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match=r"edit\.npz: Not found: .* has not run, or an older version"):
        read_edit(tmp_path / "edit.npz")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"removed": np.zeros(4, dtype=bool)}, "not of 5 surfels"),
        ({"relit": np.zeros(5)}, "not of 5 surfels"),
        ({"shortened": np.full((1, 6), 5.0)}, "does not have"),
        ({"shortened": np.full((1, 6), np.nan)}, "shortened surfels are none"),
        ({"shortened": np.zeros((1, 3))}, "shortened surfels are none"),
        ({"origin": np.zeros(3, np.uint8)}, "origins are not those"),
        ({"added.means": np.zeros((2, 2), np.float32)}, "means are of another shape"),
        ({"added.means": np.full((2, 3), np.inf, np.float32)}, "means are none"),
        ({"added.sh": np.zeros((2, 2, 3), np.float32)}, "another kind"),
        ({"added.labels": np.full(2, 300)}, "labels that are none"),
        ({"added.labels": np.zeros(2, np.float32)}, "labels are none"),
    ],
)
def test_what_is_no_edit_of_this_scene_is_one_line(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = tmp_path / "edit.npz"
    write_edit(an_edit(), path)
    with np.load(path) as data:
        arrays = {name: data[name] for name in data.files}
    np.savez(path, **{**arrays, **change})
    with pytest.raises(WorkspaceError, match=f"Not an edit of the scene: .*{said}"):
        read_edit(path, 5)


def test_bytes_that_are_no_archive_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "edit.npz").write_bytes(b"no archive")
    with pytest.raises(WorkspaceError, match="Not an edit of the scene"):
        read_edit(tmp_path / "edit.npz")


def test_what_is_packed_is_not_unpacked(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "edit.npz", removed=np.zeros(1 << 22, bool))
    with pytest.raises(WorkspaceError, match="Not an edit of the scene: it unpacks to more than"):
        read_edit(tmp_path / "edit.npz")

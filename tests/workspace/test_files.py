"""Small files of a workspace that somebody else wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.errors import WorkspaceError
from unveil_core.pipeline.up_to_date import Digests
from unveil_core.workspace.files import load_depth, load_labels, load_selection, save_depth
from unveil_core.workspace.workspace import Workspace

LABELS = '{"names": ["road"], "disk_ids": [0], "source": "mask", "pixel_counts": [1]}'


@pytest.mark.parametrize(
    "content", ["", "[]", "[" * 100_000, '{"names": 3}', '{"disk_ids": ["x"]}', '{"pixel_counts": null}']
)
def test_a_damaged_choice_names_its_file(content: str, tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    workspace.labels_json.write_text(content)
    with pytest.raises(WorkspaceError, match="labels.json: "):
        load_labels(workspace)
    workspace.labels_json.write_text(LABELS)
    workspace.selection_json.write_text(content)
    with pytest.raises(WorkspaceError, match="selection.json: "):
        load_selection(workspace)
    workspace.selection_json.write_text('{"removed": [], "instances": []}')
    assert load_selection(workspace).source == "mask"


@pytest.mark.parametrize(
    "known",
    ["[]", "3", "[" * 100_000, '{"labels.json": 3}', '{"labels.json": [1, 2]}', '{"labels.json": "abc"}'],
)
def test_remembered_digests_that_are_none_are_made_again(known: str, tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    workspace.labels_json.write_text(LABELS)
    expected = Digests(workspace).of_file(workspace.labels_json)
    (tmp_path / "w/.digests.json").write_text(known)
    assert Digests(workspace).of_file(workspace.labels_json) == expected


def test_depth_comes_back_to_two_millimetres_and_what_is_near_or_far_stays_a_surface(tmp_path: Path) -> None:
    depth = np.array([[0.0, 0.001, 0.2, 12.345], [100.0, 255.9, 256.0, 900.0]], np.float32)
    save_depth(depth, tmp_path / "depths/camera/0.png")
    back = load_depth(tmp_path / "depths/camera/0.png")
    assert back.dtype == np.float32 and back.shape == (2, 4)
    assert back[0, 0] == 0 and (back.ravel()[1:] > 0).all()
    assert np.abs(back - depth)[depth < 255.9].max() <= 1 / 256 and (back[1, 2:] > 255.9).all()

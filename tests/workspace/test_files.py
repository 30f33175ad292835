"""Small files of a workspace that somebody else wrote."""

from __future__ import annotations

from pathlib import Path

import pytest

from unveil_core.base.errors import WorkspaceError
from unveil_core.pipeline.up_to_date import Digests
from unveil_core.workspace.files import load_labels, load_selection
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

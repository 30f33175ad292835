"""One workspace with a scene, and its page, for all tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.report.scene_workspace import build_scene_workspace
from unveil_core.report import write_report


@pytest.fixture(scope="session")
def scene_workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its page is in ``report/``; tests leave it as it is."""
    workspace = build_scene_workspace(tmp_path_factory.mktemp("scene"))
    write_report(workspace, workspace / "report")
    return workspace

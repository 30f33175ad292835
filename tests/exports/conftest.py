"""The workspace of these tests, made once, and what was exported of it, once a format."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from tests.exports.street import make_workspace
from unveil_core.app.cli import main
from unveil_core.exports.job import Job
from unveil_core.exports.registry import FORMATS
from unveil_core.workspace.workspace import Workspace


@dataclass
class Street:
    """A workspace and its exports."""

    root: Path
    folder: Path
    done: set[str] = field(default_factory=set)

    @property
    def job(self) -> Job:
        return Job(Workspace.open(self.root))

    def exported(self, name: str) -> Path:
        """The result of a format, by the command."""
        path = self.folder / FORMATS[name].result.format(state="empty")
        if name not in self.done:
            assert main(["export", str(self.root), "--to", name, "-o", str(self.folder)]) == 0
            self.done.add(name)
        return path


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Street:
    root = tmp_path_factory.mktemp("exports")
    return Street(make_workspace(root), root / "out")

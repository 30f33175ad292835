"""What the check on real footage says when it cannot be. The whole of it runs in ``tests/slow/``."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.small_street import make_small_street
from unveil_core.app.cli import main
from unveil_core.app.holdout_check import check_footage
from unveil_core.base.errors import Cancelled, SettingsError, WorkspaceError
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

QUICK = RunSettings(quality="draft", iterations=50, splats=5000, adapt=False)


@pytest.fixture(scope="module")
def footage(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("footage")
    return run(make_small_street(folder / "street"), folder / "ws", QUICK, until="inpaint")


def test_cancelled_before_the_run_leaves_nothing_half_written(footage: Workspace, tmp_path: Path) -> None:
    def stop(event: dict[str, object]) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        check_footage(footage.root, tmp_path / "out", cars=1, reporter=stop)
    assert not (tmp_path / "out/drive").exists() and not (tmp_path / "out/holdout.json").exists()


def test_what_cannot_be_is_one_line(footage: Workspace, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SettingsError, match="1 to 9"):
        check_footage(footage.root, cars=0)
    with pytest.raises(SettingsError, match="-o"):
        check_footage(tmp_path)
    half = tmp_path / "half"
    shutil.copytree(footage.root, half)
    shutil.rmtree(half / "masks/shadows")
    with pytest.raises(WorkspaceError, match="masks/shadows.*unveil run"):
        check_footage(half)
    for arguments in (["--cars", "2"], ["--holdout-masks", "--truth", "x"], ["--holdout-masks", "--cars", "x"]):
        assert main(["evaluate", str(footage.root), *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1

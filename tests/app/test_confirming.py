"""What is most probably a mistake is asked about at a terminal, and elsewhere ends the command with a line that names --yes."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.base.errors import ConfirmError
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.pipeline.run import run
from unveil_core.semantics.too_much import much_removed


@pytest.fixture
def inverted(tmp_path: Path) -> Path:
    """A drive whose masks are white where something goes."""
    drive = make_tiny_drive(tmp_path / "drive", semantics=False, masks=True)
    for path in (drive.parent / "masks").iterdir():
        cv2.imwrite(str(path), 255 - cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    return drive


def test_without_a_terminal_it_is_one_line_and_nothing_is_left(
    inverted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for verb in ("import", "run"):
        assert main([verb, str(inverted), "-o", str(tmp_path / "ws")]) == 2
        told = capsys.readouterr().err.strip().splitlines()
        assert len(told) == 1 and "masks remove 94 % of 4 of 4 frames (black and transparent is removed" in told[0]
        assert "--mask-removes white turns it round; --yes goes on all the same" in told[0]
    assert not (tmp_path / "ws").exists()


def test_yes_goes_on_and_tells_it(inverted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(inverted), "-o", str(tmp_path / "ws"), "--yes"]) == 0
    assert "LOOK AT THE DRIVE: masks remove 94 % of 4 of 4 frames" in capsys.readouterr().err
    assert main(["import", str(inverted), "-o", str(tmp_path / "ws")]) == 0  # it was confirmed


def test_the_other_way_round_nothing_is_asked(inverted: Path, tmp_path: Path) -> None:
    assert main(["import", str(inverted), "-o", str(tmp_path / "ws"), "--mask-removes", "white"]) == 0


@pytest.mark.skipif(os.name == "nt", reason="no pseudo terminals")
@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("\n", 2), ("no\n", 2)])
def test_at_a_terminal_it_is_asked(answer: str, code: int, inverted: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "unveil_core", "import", str(inverted), "-o", str(tmp_path / "ws")]
    ours, theirs = pty.openpty()
    process = subprocess.Popen(command, stdin=theirs, stderr=theirs, stdout=subprocess.DEVNULL, close_fds=True)
    os.close(theirs)
    said = b""
    while b"[y/N]" not in said:
        said += os.read(ours, 4096)
    os.write(ours, answer.encode())
    try:
        while os.read(ours, 4096):
            pass
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait(timeout=120) == code
    assert (tmp_path / "ws/workspace.json").is_file() == (code == 0)


def test_from_python_it_is_an_error_of_its_own(inverted: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfirmError, match="--yes"):
        run(inverted, tmp_path / "ws", until="import")
    assert run(inverted, tmp_path / "ws", until="import", yes=True).root.is_dir()


def test_classes_count_as_they_are_chosen(tmp_path: Path) -> None:
    opened = open_drive(make_tiny_drive(tmp_path / "drive"))
    checked = check_drive(opened)
    assert much_removed(opened, checked) is None
    found = much_removed(opened, checked, ("road", "car"))
    assert found is not None and "what is to be removed (road, car) has 58 % of 4 of 4 frames" in found.line
    assert much_removed(opened, checked, instances=(300,)) is None
    assert np.isnan(checked.masked).all() and (checked.classes.sum(axis=1) == 24 * 32).all()


def test_a_batch_takes_the_word_along(inverted: Path, tmp_path: Path) -> None:
    pytest.importorskip("dask")
    from unveil_core.farm.manifest import read_batch

    for words in ([], ["--yes"]):
        root = tmp_path / f"batch{len(words)}"
        assert main(["batch", "plan", str(inverted), "-o", str(root), *words]) == 0
        assert ("--yes" in read_batch(root).tasks[0].arguments) == bool(words)

"""What a kill leaves beside the place of a result is gone after the next call, and what was to be replaced is there again."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from unveil_core.base.output.scratch import exchanged, scratch_folder

PROGRAM = """
import sys, time
from pathlib import Path
from unveil_core.base.output import scratch
place, where = Path(sys.argv[1]), sys.argv[2]
with scratch.scratch_folder(place.parent, "export") as folder:
    (folder / "made").mkdir()
    (folder / "made/a").write_text("new")
    if where == "between":
        scratch.move(place, folder / "before")
        (folder / "place").write_text(place.name)
    print("there", flush=True)
    time.sleep(60)
"""


def killed(place: Path, where: str) -> None:
    process = subprocess.Popen([sys.executable, "-c", PROGRAM, str(place), where], stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == b"there\n"
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()


@pytest.mark.parametrize("where", ["making", "between"])
def test_the_next_call_tidies_and_puts_back(where: str, tmp_path: Path) -> None:
    place = tmp_path / "out"
    place.mkdir()
    (place / "a").write_text("old")
    killed(place, where)
    assert place.exists() == (where == "making") and len(list(tmp_path.glob(".export.*"))) == 1
    (tmp_path / ".export.somebody.partial").mkdir()
    with scratch_folder(tmp_path, "export") as folder:
        assert [p.name for p in tmp_path.glob(".export.*")] != [] and (place / "a").read_text() == "old"
        (folder / "made").mkdir()
        (folder / "made/a").write_text("new")
        exchanged(folder / "made", place)
    assert (place / "a").read_text() == "new"
    assert sorted(p.name for p in tmp_path.iterdir()) == [".export.somebody.partial", "out"]


def test_nobody_takes_the_folder_of_who_works_there(tmp_path: Path) -> None:
    with scratch_folder(tmp_path, "export") as first, scratch_folder(tmp_path, "export") as second:
        assert first.is_dir() and second.is_dir() and first != second
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_was_made_for_nothing_is_gone(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), scratch_folder(tmp_path / "a/b", "export"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []

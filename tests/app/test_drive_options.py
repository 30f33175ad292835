"""Which part of a drive is run, and hostile files in it: one line and exit code 2, and nothing is left."""

from __future__ import annotations

import gzip
import os
import pickle
import re
from pathlib import Path

import pytest

from tests.drives.formats.test_pandaset import make_pandaset
from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.drives.formats.pickled import stand_ins
from unveil_core.drives.imported import read_imported


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """Two cameras, two frames each."""

    def named(document) -> None:  # type: ignore[no-untyped-def]
        for i, frame in enumerate(document["frames"]):
            frame["camera"] = ("front", "left")[i % 2]

    path = make_tiny_drive(tmp_path / "rig")
    edit(path, named)
    return path


def error(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a command ends with, whose exit code is 2."""
    assert main(arguments) == 2
    said = capsys.readouterr().err
    lines = [line for line in said.splitlines() if line.startswith("unveil: error: ")]
    assert len(lines) == 1 and "Traceback" not in said
    return lines[0]


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--cameras", "rear", r"no camera rear.*front, left"),
        ("--cameras", "front,rear", r"no camera rear"),
        ("--frames", "9:", r"no frame lies in 9:"),
        ("--frames", "1:x", r"Not a range of frames.*A:B:STEP"),
        ("--frames", "0:4:0", r"Not a range of frames.*STEP above 0"),
        ("--sweeps", "some", r"sweeps.*all, key"),
        ("--sweeps", "0", r"sweeps.*all, key"),
        ("--model", "1", r"has no models to choose from.*leave --model out"),
        ("--scene", "0061", r"one scene.*leave --scene out"),
        ("--labels", "/nowhere/labels", r"no folder of labels: /nowhere/labels"),
        ("--segmenter", "/nowhere/network.onnx", r"network\.onnx"),
    ],
)
def test_a_part_that_there_is_none_of_is_one_line(
    option: str, value: str, message: str, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = error(["run", str(rig), "-o", str(tmp_path / "ws"), option, value], capsys)
    assert re.search(message, line), line
    assert not (tmp_path / "ws").exists()


def test_the_part_that_is_asked_for_is_imported(rig: Path, tmp_path: Path) -> None:
    workspace = tmp_path / "ws"
    assert main(["import", str(rig), "-o", str(workspace), "--cameras", "left", "--frames", "0"]) == 0
    assert [(f.camera_name, f.name) for f in read_imported(workspace / "drive").frames] == [("left", "01")]
    assert main(["import", str(rig), "-o", str(workspace), "--cameras", "all"]) == 0


class Attack:
    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> tuple[object, ...]:
        return os.system, (f"touch {self.victim}",)


@pytest.mark.parametrize("place", ["lidar/01", "annotations/cuboids/01", "annotations/semseg/01"])
def test_a_hostile_dataset_runs_nothing(place: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, victim = make_pandaset(tmp_path / "002"), tmp_path / "victim"
    path = drive / f"{place}.pkl.gz"
    path.write_bytes(gzip.compress(pickle.dumps(Attack(victim))))
    line = error(["run", str(drive), "-o", str(tmp_path / "ws"), "--quality", "draft"], capsys)
    assert str(path) in line and "no such file needs" in line
    assert not victim.exists() and not (tmp_path / "ws").exists()


def test_a_bomb_in_a_dataset_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stand_ins, "MOST_BYTES", 1 << 20)
    drive = make_pandaset(tmp_path / "002")
    (drive / "lidar/02.pkl.gz").write_bytes(gzip.compress(bytes(64 << 20)))
    line = error(["run", str(drive), "-o", str(tmp_path / "ws"), "--quality", "draft"], capsys)
    assert "lidar/02.pkl.gz" in line and "unpacks to more than" in line and not (tmp_path / "ws").exists()

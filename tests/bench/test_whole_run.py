"""``unveil bench run``: each stage measured, each run beside the last one of its kind."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.base.errors import SettingsError
from unveil_core.bench.whole_run import rows_in, run_table


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny_drive(tmp_path_factory.mktemp("drive") / "street")


def test_a_run_stands_beside_the_one_before(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    clock = itertools.count(
        step=1.5
    )  # looked at when a stage begins and when it ends; stages take hundredths of a second
    monkeypatch.setattr("unveil_core.bench.whole_run.processor_seconds", lambda: next(clock))
    output = tmp_path / "runs.json"
    command = ["bench", "run", str(drive), "--quality", "draft", "--until", "segment", "-o", str(output)]
    assert main(command) == 0
    first = capsys.readouterr().out
    assert "; before: " not in first
    assert main(command) == 0
    table = capsys.readouterr().out.splitlines()
    assert "; before: " in table[0]
    assert [line.split()[0] for line in table[2:]] == ["import", "objects", "segment", "all"]
    rows = json.loads(output.read_text())["rows"]
    assert len(rows) == 2 and {p.name for p in tmp_path.iterdir()} <= {"runs.json", "cache"}
    for row in rows:
        assert row["drive"] == "street" and row["quality"] == "draft" and row["frames"] > 0
        for stage in row["stages"].values():
            assert stage["processor_seconds"] == 1.5 and stage["seconds"] >= 0 and stage["peak_memory_mb"] > 10
            assert len(stage["cores"]) == row["machine"]["cores"] and all(0 <= share <= 1 for share in stage["cores"])


def row(drive: str = "street", seconds: float = 10.0, processor: str = "one") -> dict[str, object]:
    stage = {"seconds": seconds, "processor_seconds": 1.5 * seconds, "peak_memory_mb": 100.0, "cores": [0.9, 0.6]}
    return {
        "machine": {"processor": processor},
        "commit": f"c{seconds:.0f}",
        "drive": drive,
        "quality": "draft",
        "frames": 3,
        "size": [96, 64],
        "stages": {"import": stage, "mesh": {**stage, "peak_memory_mb": 300.0}},
    }


def test_the_last_run_of_the_same_drive_is_the_one_before() -> None:
    rows = [row(seconds=30.0), row(seconds=20.0), row("other", 5.0), row(seconds=10.0)]
    head, _, *stages = run_table({"rows": rows}).splitlines()
    assert head.endswith("before: c20")
    assert stages[0].split() == ["import", "10.0", "15.0", "100.0", "20.0", "30.0", "100.0", "90%", "60%"]
    assert stages[-1].split() == ["all", "20.0", "30.0", "300.0", "40.0", "60.0", "300.0"]
    assert "on another machine" in run_table({"rows": [row(processor="two"), row()]})
    assert "before:" not in run_table({"rows": [row("other"), row()]})


@pytest.mark.parametrize(
    "content", ["[]", "{}", '{"rows": 3}', '{"rows": [{"stages": {"mesh": {}}}]}', '{"rows": [[]]}']
)
def test_a_file_of_something_else_is_named(content: str, tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    path.write_text(content)
    with pytest.raises(SettingsError, match=r"other.json: Not results of `unveil bench run`"):
        rows_in(path)
    assert rows_in(tmp_path / "none.json") == [] and rows_in(None) == []

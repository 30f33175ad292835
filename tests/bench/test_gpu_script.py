"""benchmarks/machine/gpu.py, before a card's time is spent on it: in a tiny size, in Triton's interpreter, and short of time."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("triton")
from benchmarks.machine import gpu, gpu_parts
from benchmarks.machine.gpu_parts import TINY, TimeLeft

SCRIPT = Path(gpu.__file__)
WHOLE_RUNS = ("sample", "drive", "sample on the processor")


def tiny(output: Path, *options: str) -> Any:
    """What the script finds of a tiny size, by part."""
    command = [sys.executable, "-W", "ignore", str(SCRIPT), "--tiny", "-o", str(output), *options]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    (found,) = json.loads(output.read_text()).values()
    return found


def test_a_tiny_size_is_imported_and_timed_and_what_is_too_long_is_said(tmp_path: Path) -> None:
    found = tiny(tmp_path / "gpu.json", "--parts", "imports,passes,bytes", "--seconds", "400")
    assert found["imports"]["missing"] == [] and "torch" in found["machine"]["versions"]
    (row,) = found["passes"]
    assert all(times["ms"] > 0 for times in row["ms"].values()) and row["bytes_computed"] > 0
    assert {name.rpartition(": ")[2] for name in row["ms"]} == {"forward", "forward and backward"}
    again = tiny(tmp_path / "gpu.json", "--parts", "passes", "--seconds", "0")
    assert again["passes"][0]["skipped"].startswith("left out: takes about 3 s, 0 s are left")
    assert again["bytes"] == found["bytes"] and found["bytes"]  # of other parts it keeps what it knows


def test_a_part_that_does_not_fit_is_not_begun() -> None:
    def begun(extent: object, left: object) -> None:
        pytest.fail("there was no time for it")

    found = gpu.found_by("sample", 60.0, begun, TINY, TimeLeft(12.0))
    assert found == {"skipped": "left out: takes about 60 s, 12 s are left"}
    assert gpu.found_by("checks", 1e9, lambda extent, left: "made", TINY, TimeLeft(None)) == "made"


def test_a_run_that_takes_longer_is_ended_with_all_that_it_started(tmp_path: Path) -> None:
    drive = gpu_parts.ROOT / "sample_scenes/parked_street"
    begun = time.perf_counter()
    row = gpu_parts.whole_run(drive, tmp_path / "ws", ("--quality", "draft", "--device", "cpu"), TimeLeft(1.0))
    assert row["cut_off"] and 0.9 < row["seconds"] <= time.perf_counter() - begun
    assert not [p for p in psutil.process_iter(["cmdline"]) if str(tmp_path / "ws") in (p.info["cmdline"] or [])]


def test_a_run_that_fails_is_a_result_and_the_others_go_on(tmp_path: Path) -> None:
    def fails(extent: gpu_parts.Extent, left: TimeLeft) -> object:
        return gpu_parts.whole_run(tmp_path / "nowhere", tmp_path / "ws", ("--device", "cpu"), left)

    found = gpu.found_by("drive", 0.0, fails, TINY, TimeLeft(None))
    assert "unveil run ended with" in found["failed"] and "nowhere" in found["failed"]


def test_whole_runs_are_left_out_where_a_package_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    assert gpu_parts.missing() == ["OpenEXR"]
    for name in WHOLE_RUNS:
        found = gpu.found_by(name, 0.0, lambda extent, left: pytest.fail("it would fail"), TINY, TimeLeft(None))
        assert found["skipped"].startswith("left out: OpenEXR not found; install")


def test_a_card_is_asked_all_and_a_machine_without_one_what_it_can_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gpu_parts, "CARD", None)
    assert list(gpu.known_parts(tmp_path, False)) == ["imports", "checks", "bytes", "kernels"]
    monkeypatch.setattr(gpu_parts, "CARD", "a card")
    asked = gpu.known_parts(tmp_path, False)
    # What tells most comes first, as the time may end.
    assert list(asked)[:5] == ["imports", "checks", "passes", "sample", "drive"] and set(WHOLE_RUNS) < set(asked)
    assert set(gpu.known_parts(tmp_path, True)) == set(asked)

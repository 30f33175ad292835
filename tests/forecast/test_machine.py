"""What is known of a machine: kept in a file that anybody may damage."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import psutil
import pytest

from unveil_core.forecast.machine import KEPT, free_disk_mb, free_memory_mb, measured_seconds, this_machine


def test_times_of_runs_are_kept_and_come_before_the_measurement(tmp_path: Path) -> None:
    machine = this_machine(tmp_path)
    assert not machine.known and machine.multiple("draft", "mesh") == 1
    machine.speed = 3.0
    machine.save()
    assert this_machine(tmp_path).multiple("draft", "mesh") == 3
    for seconds in (10, 11, 90):
        machine.note("draft", "mesh", seconds, 10)
    again = this_machine(tmp_path)
    assert again.known and again.multiple("draft", "mesh") == pytest.approx(1.1)
    assert again.multiple("draft", "ground") == pytest.approx(1.1), "by other stages"
    assert again.multiple("standard", "ground") == 3, "of another quality nothing is known"
    for _ in range(9):
        again.note("draft", "mesh", 20, 10)
    assert this_machine(tmp_path).ratios["draft.mesh"] == [2.0] * KEPT


def test_short_stages_and_impossible_times_tell_nothing(tmp_path: Path) -> None:
    machine = this_machine(tmp_path)
    machine.note("draft", "choose", 0.02, 0.01)
    machine.note("draft", "mesh", 1e6, 10)
    assert not machine.known


@pytest.mark.parametrize(
    "content", ["", "[]", "{", '{"NAME": 7}', '{"NAME": {"speed": "x", "ratios": {"a.b": [true, 1e9]}}}']
)
def test_a_damaged_file_is_as_none(tmp_path: Path, content: str) -> None:
    name = this_machine(tmp_path).name
    (tmp_path / "timings.json").write_text(content.replace("NAME", name))
    machine = this_machine(tmp_path)
    assert not machine.known
    machine.note("draft", "mesh", 20, 10)
    assert this_machine(tmp_path).multiple("draft", "mesh") == 2
    assert isinstance(json.loads((tmp_path / "timings.json").read_text()), dict)


def test_other_machines_keep_their_times(tmp_path: Path) -> None:
    (tmp_path / "timings.json").write_text('{"another": {"speed": 2.0, "ratios": {}}}')
    machine = this_machine(tmp_path)
    machine.speed = 1.5
    machine.save()
    assert set(json.loads((tmp_path / "timings.json").read_text())) == {"another", machine.name}


def test_a_folder_that_cannot_be_written_costs_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    machine = this_machine(tmp_path / "file")
    machine.note("draft", "mesh", 20, 10)
    assert machine.multiple("draft", "mesh") == 2


def test_this_machine_takes_time_and_has_room(tmp_path: Path) -> None:
    assert measured_seconds() > 0
    assert 0 < free_memory_mb() <= psutil.virtual_memory().total / 2**20
    assert 0 <= free_disk_mb(tmp_path / "not" / "there") <= shutil.disk_usage(tmp_path).total / 2**20


def test_times_with_a_gpu_are_kept_for_themselves(tmp_path: Path) -> None:
    with_gpu = this_machine(tmp_path, "cuda:0")
    with_gpu.note("draft", "reconstruct", 5.0, 50.0)
    assert this_machine(tmp_path, "cuda:0").known and not this_machine(tmp_path).known

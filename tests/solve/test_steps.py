"""Steps are done once, as long as all that they were made from is the same."""

from __future__ import annotations

import os
from pathlib import Path

from unveil_core.solve.steps import Steps, facts_of_files


def _two(folder: Path, first: object, second: object) -> list[object]:
    steps, found = Steps(folder), []
    for name, made_from in (("a", first), ("b", second)):
        found.append(steps.begin(name, made_from))
        steps.done(name, {"of": made_from})
    return found


def test_what_changes_is_made_anew_with_all_behind_it(tmp_path: Path) -> None:
    assert _two(tmp_path, 1, 1) == [None, None]
    assert _two(tmp_path, 1, 1) == [{"of": 1}, {"of": 1}]
    assert _two(tmp_path, 1, 2) == [{"of": 1}, None]
    assert _two(tmp_path, 2, 2) == [None, None]


def test_a_damaged_file_counts_as_none(tmp_path: Path) -> None:
    _two(tmp_path, 1, 1)
    (tmp_path / "a.json").write_text("{")
    assert _two(tmp_path, 1, 1) == [None, {"of": 1}]


def test_a_step_that_was_ended_halfway_goes_on(tmp_path: Path) -> None:
    steps = Steps(tmp_path)
    assert steps.begin("a", 1) is None and not steps.going_on("a")
    again = Steps(tmp_path)
    assert again.begin("a", 1) is None and again.going_on("a")
    other = Steps(tmp_path)
    assert other.begin("a", 2) is None and not other.going_on("a")


def test_files_are_the_same_by_name_size_and_time(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("1")
    before = facts_of_files([tmp_path / "a"])
    assert before == facts_of_files([Path(os.path.relpath(tmp_path / "a"))])
    os.utime(tmp_path / "a", (1, 1))
    assert before != facts_of_files([tmp_path / "a"])

"""States for drawing: there at once, however slow the disk, and read again when they are old or settings have changed."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path

import pytest

from blender_addon.worker import states_watch
from blender_addon.worker.states_watch import StatesWatch
from blender_addon.worker.workspace_state import StageState, WorkspaceState

ROOT = Path("/somewhere")


class Disk:
    """A slow one: reading waits until it is let go."""

    def __init__(self) -> None:
        self.go, self.state, self.asked = threading.Event(), "to do", 0

    def read(self, root: Path, wanted: Mapping[str, object]) -> WorkspaceState:
        self.asked += 1
        assert self.go.wait(120)
        return WorkspaceState(root, True, stages={"mesh": StageState("mesh", f"{self.state} {wanted['quality']}")})


def wait(watch: StatesWatch) -> None:
    deadline = time.monotonic() + 120
    while watch.pending and time.monotonic() < deadline:
        time.sleep(0.005)
    assert not watch.pending


def state_of(found: WorkspaceState | None) -> str:
    assert found is not None
    return found.stages["mesh"].state


def test_drawing_does_not_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk()
    watch = StatesWatch(disk.read)
    assert watch.latest(ROOT, {"quality": "draft"}) is None and watch.latest(ROOT, {"quality": "draft"}) is None
    assert watch.pending and disk.asked == 1
    disk.go.set()
    wait(watch)
    assert watch.changed and state_of(watch.latest(ROOT, {"quality": "draft"})) == "to do draft"
    assert not watch.changed and not watch.pending  # fresh: nothing is read
    # Other settings: the old states are shown until the new ones are there.
    disk.go.clear()
    assert state_of(watch.latest(ROOT, {"quality": "high"})) == "to do draft" and watch.pending
    disk.go.set()
    wait(watch)
    assert state_of(watch.latest(ROOT, {"quality": "high"})) == "to do high"
    # The same, but old.
    monkeypatch.setattr(states_watch, "OLD_S", 0.0)
    disk.state = "done"
    watch.latest(ROOT, {"quality": "high"})
    wait(watch)
    assert watch.changed and state_of(watch.latest(ROOT, {"quality": "high"})) == "done high"
    wait(watch)


def test_of_another_workspace_nothing_is_known_yet() -> None:
    disk = Disk()
    disk.go.set()
    watch = StatesWatch(disk.read)
    assert state_of(watch.latest(ROOT, {"quality": "draft"}, wait=True)) == "to do draft"
    assert watch.latest(Path("/elsewhere"), {"quality": "draft"}) is None
    wait(watch)
    watch.forget()
    before = disk.asked
    watch.latest(Path("/elsewhere"), {"quality": "draft"})
    wait(watch)
    assert disk.asked == before + 1


def test_a_reader_that_fails_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def fail(root: Path, wanted: Mapping[str, object]) -> WorkspaceState:
        calls.append(root)
        raise OSError("the disk has gone")

    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    watch = StatesWatch(fail)
    for _ in range(2):
        assert watch.latest(ROOT, {"quality": "draft"}) is None
        wait(watch)
    assert len(calls) == 2

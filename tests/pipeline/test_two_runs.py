"""Two runs of one process, each in a thread of its own: what is said of the one is not said of the other, then or afterwards."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from unveil_core.base.errors import Cancelled
from unveil_core.base.kernels.device import CPU, current_device, note_of_device
from unveil_core.base.mechanisms import on
from unveil_core.base.parallel import each, thread_count, threads
from unveil_core.base.progress import stop_asked
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.workspace.workspace import Workspace

PATIENCE_S = 60
"""For what another thread does at once, on a machine with other work."""


class Run(threading.Thread):
    """A run of one stage, which stands still between its beginning and its end until it is told to go on.

    Attributes:
        inside, go_on, over: when the stage has begun; may end; when the run is over.
        seen: by moment, what the threads of the stage's work found.
        error: by which the run ended.
    """

    def __init__(self, root: Path, name: str, without: tuple[str, ...] = (), device: str = "cpu") -> None:
        super().__init__(name=name)
        self.workspace = Workspace.create(root / name)
        self.settings = RunSettings(without=without, device=device)
        self.inside, self.go_on, self.over = threading.Event(), threading.Event(), threading.Event()
        self.seen: dict[str, list[Any]] = {}
        self.error: BaseException | None = None

    def run(self) -> None:
        """As the other threads of a host do."""
        try:
            stage = Stage("inpaint", self.work, (), ("made.txt",), ("without",))
            run_stages(self.workspace, [stage], self.settings, self.workspace.root)
        except BaseException as error:
            self.error = error
        finally:
            self.over.set()

    def look(self, _: int) -> tuple[bool, bool, str, int, bool]:
        """What one thread of the work finds."""
        note_of_device(f"told by {self.name}")
        return on("quilting"), on("facades"), current_device().backend, thread_count(), stop_asked()

    def work(self, context: StageContext) -> None:
        """The stage's work."""
        with threads(3 if self.name == "first" else 2):
            self.seen["begun"] = [*each(self.look, range(5)), self.look(0)]
            self.inside.set()
            assert self.go_on.wait(PATIENCE_S)
            self.seen["alone"] = [*each(self.look, range(5)), self.look(0)]
        context.output("made.txt").write_text("made")


def state_of_process() -> dict[str, Any]:
    """What a run must leave as it was."""
    return {
        "mechanisms": [on("quilting"), on("facades")],
        "device": current_device(),
        "threads": thread_count(),
        "stop": stop_asked(),
        "hook": threading.excepthook,
        "frozen": gc.get_freeze_count() > 0,
    }


@contextmanager
def interleaved(first: Run, second: Run) -> Iterator[None]:
    """The first run begins and ends before the second: within the block both are at work."""
    first.start()
    assert first.inside.wait(PATIENCE_S), first.error
    second.start()
    try:
        assert second.inside.wait(PATIENCE_S), second.error
        yield
    finally:
        for run in (first, second):
            run.go_on.set()
            assert run.over.wait(PATIENCE_S)
            run.join(PATIENCE_S)


def test_each_run_has_its_own_switches_device_threads_and_notes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from unveil_core.base.kernels import device

    monkeypatch.setattr(device, "gpu_problem", lambda: None)
    monkeypatch.setattr(device, "GPU", device.Device("cpu", "triton"))
    before = state_of_process()
    first, second = Run(tmp_path, "first", ("quilting",)), Run(tmp_path, "second", ("facades",), device="auto")
    with interleaved(first, second):
        pass
    assert first.error is None and second.error is None
    assert {*first.seen["begun"], *first.seen["alone"]} == {(False, True, "auto", 3, False)}
    assert {*second.seen["begun"], *second.seen["alone"]} == {(True, False, "triton", 2, False)}
    for run in (first, second):
        recorded = run.workspace.state()["stages"]["inpaint"]
        assert recorded["device_notes"] == [f"told by {run.name}"]
        assert recorded["settings"]["without"] == list(run.settings.without)
    assert state_of_process() == before and before["device"] == CPU and before["mechanisms"] == [True, True]


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_a_signal_stops_the_run_that_heeds_it(tmp_path: Path) -> None:
    """That of the main thread; the other, whose host told it nothing, goes on to its end."""
    before = state_of_process()
    other = Run(tmp_path, "second")
    other.start()
    assert other.inside.wait(PATIENCE_S), other.error

    def signalled(context: StageContext) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        assert stop_asked() and all(each(lambda _: stop_asked(), range(4)))
        other.go_on.set()
        assert other.over.wait(PATIENCE_S)
        context.progress(1, 1)

    try:
        with threads(2), pytest.raises(Cancelled):
            run_stages(Workspace.create(tmp_path / "main"), [stage_of(signalled)], RunSettings(), tmp_path)
    finally:
        other.go_on.set()
        other.join(PATIENCE_S)
    assert other.error is None and {seen[-1] for seen in other.seen["alone"]} == {False}
    assert state_of_process() == before and not before["stop"]


def stage_of(work: Callable[[StageContext], None]) -> Stage:
    """A stage that does this."""
    return Stage("inpaint", work, (), ("made.txt",))

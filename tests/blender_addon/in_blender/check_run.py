"""Running through operators: bad input, cancel, kill, one stage, everything, and finding it all again."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest


@pytest.fixture
def empty(scene, street, tmp_path):  # type: ignore[no-untyped-def]
    """A scene with the drive and a workspace named, draft quality."""
    scene.unveil.drive = str(street)
    scene.unveil.workspace = str(tmp_path / "ws")
    scene.unveil.quality = "draft"
    return scene


def states(addon, scene) -> dict[str, str]:  # type: ignore[no-untyped-def]
    found = addon.module("operators_run").stage_states(scene)
    return {name: stage.state for name, stage in found.stages.items()}


def log(addon) -> str:  # type: ignore[no-untyped-def]
    text = addon.module("logs").log_text()
    return text.as_string() if text else ""


def test_without_a_drive_nothing_starts(addon, scene) -> None:
    import bpy

    with pytest.raises(RuntimeError, match="There is no drive yet"):
        bpy.ops.unveil.run()
    with pytest.raises(RuntimeError, match="There is no workspace yet"):
        bpy.ops.unveil.stage(stage="mesh")
    assert not addon.module("session").session.busy


def test_bad_input_is_one_line_and_the_log_a_text(addon, empty) -> None:
    import bpy

    empty.unveil.drive = "/nowhere"
    with pytest.raises(RuntimeError, match="/nowhere: there is no such drive"):
        bpy.ops.unveil.run()
    assert "unveil: error: /nowhere" in log(addon) and "exit code 2" in log(addon)
    assert addon.module("session").session.last.status == "bad input"
    with pytest.raises(RuntimeError, match="no such drive"):
        bpy.ops.unveil.run()
    assert sum(1 for text in bpy.data.texts if text.get("unveil_log")) == 1
    assert bpy.ops.unveil.show_log() == {"FINISHED"}


def test_a_named_python_that_is_none_is_told(addon, empty) -> None:
    import bpy

    chosen = addon.module("preferences").preferences(bpy.context)
    chosen.python = "/nowhere/python"
    try:
        with pytest.raises(RuntimeError, match="No Python with unveil was found"):
            bpy.ops.unveil.run()
    finally:
        chosen.python = ""
    with pytest.raises(RuntimeError, match="no such Python|No Python|needs"):
        chosen.python = "/nowhere/python"
        bpy.ops.unveil.check_python()
    chosen.python = ""
    assert bpy.ops.unveil.check_python() == {"FINISHED"}
    lines = addon.module("preferences").known(chosen).lines()
    assert "from UNVEIL_PYTHON" in lines[0] and "CPU cores" in lines[2] and lines[-1] == "Ready."


def meanwhile(addon, what, when) -> threading.Thread:  # type: ignore[no-untyped-def]
    """Do something in a thread once the job says so: the call that starts it blocks."""
    session = addon.module("session").session

    def wait() -> None:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (session.job and when(session.job.state)):
            time.sleep(0.02)
        if session.job:
            what(session.job)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def test_cancel_and_kill_leave_a_workspace_that_goes_on(addon, empty, street) -> None:
    import bpy

    reconstructing = lambda state: state.stage == "reconstruct" and state.done > 0  # noqa: E731
    asked: list[float] = []
    thread = meanwhile(addon, lambda job: (asked.append(time.monotonic()), job.cancel()), reconstructing)
    assert bpy.ops.unveil.run() == {"CANCELLED"}
    assert time.monotonic() - asked[0] < 2
    thread.join()
    assert addon.module("session").session.last.status == "cancelled"
    found = states(addon, empty)
    assert found["import"] == "done" and found["reconstruct"] in ("to do", "stale")
    thread = meanwhile(addon, lambda job: os.kill(job.pid, signal.SIGKILL), reconstructing)
    with pytest.raises(RuntimeError, match="The worker was killed"):
        bpy.ops.unveil.run()
    thread.join()
    assert states(addon, empty)["reconstruct"] == "to do"  # and nobody works there
    if sys.platform != "win32":  # Ctrl+C, where Blender runs in a terminal
        thread = meanwhile(addon, lambda job: os.kill(os.getpid(), signal.SIGINT), reconstructing)
        assert bpy.ops.unveil.run() == {"CANCELLED"}
        thread.join()
    assert bpy.ops.unveil.stage(stage="segment") == {"FINISHED"}


def test_everything_through_the_operator(addon, empty, workspace, tmp_path) -> None:
    import bpy

    root = workspace
    empty.unveil.workspace = str(root)
    assert set(states(addon, empty).values()) == {"done"}
    assert len(list((root / "frames").rglob("*.png"))) == 8 and (root / "meshes/empty.ply").is_file()

    empty.unveil.shadows = "off"
    found = states(addon, empty)
    assert found["remove"] == "done" and found["inpaint"] == found["reoptimize"] == found["report"] == "stale"
    assert bpy.ops.unveil.stage(stage="inpaint") == {"FINISHED"}
    assert json.loads((root / "workspace.json").read_text())["settings"]["shadows"] == "off"
    found = states(addon, empty)
    assert found["inpaint"] == "done" and found["reoptimize"] == "stale" and found["instances"] == "done"

    # The file opened again finds workspace and state; moved together with its workspace, too.
    blend = tmp_path / "moved/street.blend"
    blend.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert states(addon, bpy.context.scene)["inpaint"] == "done"
    root.rename(blend.parent / root.name)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert Path(bpy.context.scene.unveil.workspace) == blend.parent / root.name
    assert states(addon, bpy.context.scene)["inpaint"] == "done"


def test_opening_a_file_ends_the_job_before(addon, empty, tmp_path) -> None:
    import bpy

    session = addon.module("session").session
    jobs = addon.module("jobs")
    python = os.environ["UNVEIL_PYTHON"]
    session.begin("a sleep", lambda: jobs.Job([python, "-c", "import time; time.sleep(60)"]))
    job = session.job
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not session.busy and not job.state.running and session.last is None


def test_the_panel_draws_in_every_state(addon, empty) -> None:
    """With a layout that records: drawing needs no window."""
    panel_run = addon.module("panel_run")
    session = addon.module("session").session
    job_state = addon.module("job_state")
    assert "unveil.run" in drawn(panel_run.UNVEIL_PT_work)
    assert "there is no workspace yet" in drawn(panel_run.UNVEIL_PT_run)
    session.last = job_state.JobState(
        status="failed", error="frames/03.png: is cut short (copy it again from its source)"
    )
    try:
        assert "cut short" in " ".join(drawn(panel_run.UNVEIL_PT_work))
    finally:
        session.last = None
    python = os.environ["UNVEIL_PYTHON"]
    session.begin("a sleep", lambda: addon.module("jobs").Job([python, "-c", "import time; time.sleep(60)"]))
    try:
        session.last.read('{"stage": "mesh", "done": 3, "total": 8, "message": "fusing", "loss": 0.25}')
        said = drawn(panel_run.UNVEIL_PT_work)
        assert (
            "unveil.cancel" in said and "unveil.run" not in said and "mesh  3/8  fusing  loss 0.2500" in " ".join(said)
        )
    finally:
        session.end()
        session.last = None


class Recorder:
    """Stands for a UILayout: keeps texts and operators' names."""

    def __init__(self, said: list[str]) -> None:
        object.__setattr__(self, "said", said)

    def __setattr__(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def __getattr__(self, name: str):  # type: ignore[no-untyped-def]
        def call(*args, **kwargs):  # type: ignore[no-untyped-def]
            self.said.extend(str(v) for v in (*args, kwargs.get("text", "")) if isinstance(v, str) and v)
            return Recorder(self.said)

        return call


def drawn(panel) -> list[str]:  # type: ignore[no-untyped-def]
    import types

    import bpy

    said: list[str] = []
    stand_in = types.SimpleNamespace(layout=Recorder(said))
    for name in ("_progress", "_outcome", "_stages", "_stage"):
        if hasattr(panel, name):
            setattr(stand_in, name, types.MethodType(getattr(panel, name), stand_in))
    panel.draw(stand_in, bpy.context)
    return said

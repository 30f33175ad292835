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
    found = addon.module("work.stage_states").stage_states(scene)
    return {name: stage.state for name, stage in found.stages.items()}


def log(addon) -> str:  # type: ignore[no-untyped-def]
    text = addon.module("work.job.logs").log_text()
    return text.as_string() if text else ""


def test_without_a_drive_nothing_starts(addon, scene) -> None:
    import bpy

    with pytest.raises(RuntimeError, match="No drive yet"):
        bpy.ops.unveil.run()
    with pytest.raises(RuntimeError, match="No results yet"):
        bpy.ops.unveil.stage(stage="mesh")
    assert not addon.module("worker.session").session.busy


def test_bad_input_is_one_line_and_the_log_a_text(addon, empty) -> None:
    import bpy

    empty.unveil.drive = "/nowhere"
    with pytest.raises(RuntimeError, match="/nowhere: Not found"):
        bpy.ops.unveil.run()
    assert "unveil: error: /nowhere" in log(addon) and "exit code 2" in log(addon)
    assert addon.module("worker.session").session.last.status == "bad input"
    with pytest.raises(RuntimeError, match="Not found"):
        bpy.ops.unveil.run()
    assert sum(1 for text in bpy.data.texts if text.get("unveil_log")) == 1
    assert bpy.ops.unveil.show_log() == {"FINISHED"}


def test_a_named_python_that_is_none_is_told(addon, empty) -> None:
    import bpy

    chosen = addon.module("work.preferences").preferences(bpy.context)
    chosen.python = "/nowhere/python"
    try:
        with pytest.raises(RuntimeError, match="No Python with unveil was found"):
            bpy.ops.unveil.run()
    finally:
        chosen.python = ""
    with pytest.raises(RuntimeError, match="Not a Python|No Python|needs"):
        chosen.python = "/nowhere/python"
        bpy.ops.unveil.check_python()
    chosen.python = ""
    assert bpy.ops.unveil.check_python() == {"FINISHED"}
    lines = addon.module("work.preferences").known(chosen).lines()
    assert "from UNVEIL_PYTHON" in lines[0] and "CPU cores" in lines[2] and lines[-1] == "Ready."


def meanwhile(addon, what, when) -> threading.Thread:  # type: ignore[no-untyped-def]
    """Do something in a thread once the job says so: the call that starts it blocks."""
    session = addon.module("worker.session").session

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
    assert addon.module("worker.session").session.last.status == "cancelled"
    found = states(addon, empty)
    assert found["import"] == "done" and found["reconstruct"] in ("to do", "stale")
    thread = meanwhile(addon, lambda job: os.kill(job.pid, signal.SIGKILL), lambda state: state.stage == "reconstruct")
    with pytest.raises(RuntimeError, match="The worker was killed"):
        bpy.ops.unveil.run()
    thread.join()
    assert states(addon, empty)["reconstruct"] == "to do"  # and nobody works there
    if sys.platform != "win32":  # Ctrl+C, where Blender runs in a terminal
        thread = meanwhile(addon, lambda job: os.kill(os.getpid(), signal.SIGINT), lambda state: bool(state.stage))
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

    # The file opened again finds workspace and state.
    blend = tmp_path / "moved/street.blend"
    blend.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert states(addon, bpy.context.scene)["inpaint"] == "done"


def test_all_that_was_moved_with_the_file_is_found(addon, empty, workspace, tmp_path) -> None:
    """Pictures, strips, lists and what was chosen, at once; loading again adds nothing. Twice, with an object of mattes."""
    import bpy

    blend = tmp_path / "street.blend"
    bpy.ops.unveil.load_workspace(directory=str(workspace))
    bpy.ops.unveil.add_mattes(directory=str(workspace / "masks/removed"), class_name="van")
    bpy.ops.unveil.toggle_object(number=5)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    kinds = ("images", "movieclips", "objects", "meshes", "collections", "materials", "actions")
    there = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    for place in ("first", "second"):
        old, blend = blend, tmp_path / place / blend.name
        blend.parent.mkdir()
        old.rename(blend)
        workspace = workspace.rename(blend.parent / workspace.name)
        bpy.ops.wm.open_mainfile(filepath=str(blend))
        scene = bpy.context.scene
        assert Path(scene.unveil.workspace) == workspace
        assert states(addon, scene)["reconstruct"] == "done"
        made = [b for b in (*bpy.data.images, *bpy.data.movieclips) if b.get("unveil_drive")]
        named = [Path(bpy.path.abspath(b.filepath)) for b in made]
        strips = addon.module("scene.versions").strips_of(scene)
        named += [Path(p) for s in strips for p in addon.module("scene.versions").strip_files(s)]
        assert len(named) > 20 and all(p.is_file() and workspace in p.parents for p in named)
        assert all(i.has_data or len(i.pixels) for i in bpy.data.images if i.get("unveil_drive"))
        car, van = scene.unveil_selection.objects
        assert Path(car.thumbnail).is_file() and Path(van.mattes) == workspace / "masks/removed"
        assert not car.chosen and addon.module("choice.selection").arguments(scene)[:2] == ["--instances", "1001"]
        scene.frame_end, scene.render.resolution_percentage = 5, 50
        assert bpy.ops.unveil.load_workspace() == {"FINISHED"}
        assert {kind: len(getattr(bpy.data, kind)) for kind in kinds} == there and len(strips) == 2
        assert not scene.unveil_selection.objects[0].chosen
        assert (scene.frame_end, scene.render.resolution_percentage) == (5, 50)  # what the artist has set
        bpy.ops.wm.save_mainfile()


def test_what_a_run_loads_can_be_taken_back(addon, empty, workspace) -> None:
    """Alone: what the artist did before stays."""
    import bpy

    empty.unveil.workspace = str(workspace)
    bpy.ops.ed.undo_push(message="start")
    bpy.ops.mesh.primitive_cube_add("EXEC_DEFAULT", True)
    assert bpy.ops.unveil.run("EXEC_DEFAULT", True) == {"FINISHED"}
    assert {"Cube", "Mesh after"} <= set(bpy.data.objects.keys())
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.ed.undo()
        assert "Cube" in bpy.data.objects and "Mesh after" not in bpy.data.objects
        bpy.ops.ed.redo()
        assert {"Cube", "Mesh after"} <= set(bpy.data.objects.keys())


def test_results_go_to_the_scene_that_asked_for_them(addon, empty, workspace) -> None:
    """Also where the artist works in another one when the job ends, or has named another workspace."""
    import bpy

    empty.unveil.workspace = str(workspace)
    name, other = empty.name, bpy.data.scenes.new("Other")

    def leave(job: object) -> None:
        bpy.data.scenes[name].unveil.workspace = "/elsewhere"
        bpy.context.window_manager.windows[0].scene = other

    thread = meanwhile(addon, leave, lambda state: state.running)
    assert bpy.ops.unveil.stage(stage="segment") == {"FINISHED"}
    thread.join()
    assert not other.collection.children and other.camera is None
    assert len(bpy.data.scenes[name].collection.children) == 1 and bpy.data.scenes[name].camera is not None


def test_a_deleted_drive_comes_back_once(addon, scene, workspace) -> None:
    import bpy

    bpy.ops.unveil.load_workspace(directory=str(workspace))
    kinds = ("images", "movieclips", "meshes", "materials")
    there = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    (collection,) = scene.collection.children
    for thing in list(collection.all_objects):
        bpy.data.objects.remove(thing)
    for each in [*collection.children_recursive, collection]:
        bpy.data.collections.remove(each)
    bpy.ops.unveil.load_workspace()
    assert {kind: len(getattr(bpy.data, kind)) for kind in kinds} == there
    assert len(addon.module("scene.versions").strips_of(scene)) == 2


def sleeping(addon, seconds: float):  # type: ignore[no-untyped-def]
    """A job that sleeps, started as any other."""
    session, jobs = addon.module("worker.session").session, addon.module("worker.jobs")
    program = [os.environ["UNVEIL_PYTHON"], "-c", f"import time; time.sleep({seconds})"]
    session.begin("a sleep", lambda: jobs.Job(program))
    return session


def test_a_job_outlives_the_file_that_it_was_started_in(addon, empty) -> None:
    import bpy

    session = sleeping(addon, 60)
    job = session.job
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert session.busy and job.state.running and session.last is job.state
    session.end()
    assert not job.state.running and not session.busy
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert session.last is None  # it spoke of the other file


def test_results_that_came_in_another_file_are_loaded_when_theirs_is_opened(addon, empty, workspace, tmp_path) -> None:
    import bpy

    task, left_behind = addon.module("work.job.task"), addon.module("work.job.left_behind")
    load = addon.module("work.loading").load
    empty.unveil.workspace = str(workspace)
    blend = tmp_path / "street.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend))
    begun = task.Task("Unveil", empty.name, str(workspace), load=load, drive=empty.unveil.drive)
    session = sleeping(addon, 0.1)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    session.wait()
    assert begun.conclude(bpy.context).status == "done"
    assert begun.place() is None and not bpy.context.scene.collection.children and log(addon) == ""
    left_behind.keep(begun)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    assert not bpy.context.scene.collection.children
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert {"Mesh after", "camera"} <= set(bpy.data.objects.keys())
    assert left_behind.take_up(bpy.context) == []  # once


def test_what_an_undo_step_took_back_is_named_again_with_the_results(addon, scene, workspace, street) -> None:
    import bpy

    task = addon.module("work.job.task")
    load = addon.module("work.loading").load
    words = {"load": load, "drive": str(street)}
    imported = task.Task("Import", scene.name, str(workspace), names=True, **words)
    run = task.Task("Unveil", scene.name, str(workspace), **words)
    scene.unveil.workspace = "/elsewhere"  # of a run: somebody has named another one
    assert run.show(bpy.context) == "" and scene.unveil.workspace == "/elsewhere"
    assert imported.show(bpy.context) == ""
    assert (scene.unveil.drive, scene.unveil.workspace) == (str(street), str(workspace))
    scene.unveil.drive = scene.unveil.workspace = ""
    assert run.show(bpy.context) == ""
    assert (scene.unveil.drive, scene.unveil.workspace) == (str(street), str(workspace))


def test_the_panel_draws_in_every_state(addon, empty, monkeypatch) -> None:
    """With a layout that records: drawing needs no window."""
    import bpy

    panel_run, next_step = addon.module("ui.panel_run"), addon.module("ui.next_step")
    session = addon.module("worker.session").session
    job_state = addon.module("worker.job_state")
    assert {"unveil.import_drive", "Drive Chosen"} <= set(drawn(panel_run.UNVEIL_PT_work))
    named, empty.unveil.drive = empty.unveil.drive, ""
    assert {"unveil.open_drive", "Nothing Imported Yet"} <= set(drawn(panel_run.UNVEIL_PT_work))
    empty.unveil.drive = named
    python_state = addon.module("ui.telling.python_state")
    monkeypatch.setattr(python_state, "is_missing", lambda context: True)
    assert next_step.next_step(bpy.context).operator == "unveil.show_preferences"
    monkeypatch.undo()
    assert "No results yet" in drawn(panel_run.UNVEIL_PT_run)
    session.last = job_state.JobState(
        status="failed", error="frames/03.png: is cut short (copy it again from its source)"
    )
    try:
        assert "cut short" in " ".join(drawn(panel_run.UNVEIL_PT_work))
        status = addon.module("ui.status_bar")
        assert status.told() == (session.last.error, "ERROR")
        assert bpy.ops.unveil.dismiss() == {"FINISHED"} and status.told() == ("", "")
    finally:
        session.last = None
    python = os.environ["UNVEIL_PYTHON"]
    session.begin("a sleep", lambda: addon.module("worker.jobs").Job([python, "-c", "import time; time.sleep(60)"]))
    try:
        session.last.read('{"stage": "mesh", "done": 3, "total": 8, "message": "fusing", "loss": 0.25}')
        said = drawn(panel_run.UNVEIL_PT_work)
        assert "unveil.cancel" in said and "unveil.run" not in said
        assert said[:2] == ["a sleep: Mesh", "38 %"] and not any("loss" in text for text in said)
        # One bar for the whole run: half of it where the second of two stages has just begun, and it never goes back.
        session.last.planned = ("inpaint", "mesh")
        session.last.read('{"stage": "mesh", "done": 0, "total": 8, "message": ""}')
        assert drawn(panel_run.UNVEIL_PT_work)[:2] == ["a sleep: Mesh (2 of 2)", "50 %"]
        session.last.read('{"stage": "inpaint", "done": 1, "total": 8, "message": ""}')
        assert drawn(panel_run.UNVEIL_PT_work)[1] == "50 %"
        # As soon as the run itself says what is left, that counts.
        session.job.started -= 300
        session.last.read('{"stage": "mesh", "done": 4, "total": 8, "message": "", "left_s": 100}')
        assert drawn(panel_run.UNVEIL_PT_work)[1] == "75 %, 1 min 40 s left"
        part, text = addon.module("ui.status_bar").status_text()
        assert abs(part - 0.75) < 0.01 and text == "a sleep: Mesh (2 of 2)  ·  1 min 40 s left"
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
    for name in ("_progress", "_outcome", "_stages", "_stage", "_active", "_versions"):
        if hasattr(panel, name):
            setattr(stand_in, name, types.MethodType(getattr(panel, name), stand_in))
    panel.draw(stand_in, bpy.context)
    return said

"""The runner: skips, redoes, survives kills, leaves nothing half-written."""

from __future__ import annotations

import gc
import json
import os
import signal
import subprocess
import sys
import time
import weakref
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.inpaint.networks import blur, from_reference, mean_fill
from unveil_core.base.errors import Cancelled, SettingsError, UnveilError, WorkspaceError
from unveil_core.pipeline.outside import check_networks, files_of_networks
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Facts, Stage, StageContext
from unveil_core.pipeline.status import explained_states
from unveil_core.workspace.journal import recover
from unveil_core.workspace.workspace import Workspace


def letters(context: StageContext) -> None:
    """First stage: some files in a folder."""
    for i in range(20):
        (context.output("letters") / f"{i:02d}.txt").parent.mkdir(exist_ok=True)
        (context.output("letters") / f"{i:02d}.txt").write_text(f"{context.settings.seed} {i}")
        context.progress(i + 1, 20, "writing", loss=1.0 / (i + 1))
        time.sleep(float(os.environ.get("SLOW", "0")))


def total(context: StageContext) -> None:
    """Second stage: one file from the folder."""
    texts = [p.read_text() for p in sorted((context.workspace.root / "letters").iterdir())]
    context.output("sum/total.json").write_text(json.dumps(texts))
    context.output("sum/quality.txt").write_text(context.settings.quality)
    time.sleep(10 * float(os.environ.get("SLOW", "0")))


STAGES = (
    Stage("letters", letters, (), ("letters",), ("seed",)),
    Stage("total", total, ("letters",), ("sum/total.json", "sum/quality.txt"), ("quality",)),
)


def go(root: Path, **settings: object) -> list[str]:
    return run_stages(Workspace.create(root), STAGES, RunSettings(**settings), Path("."))  # type: ignore[arg-type]


def test_up_to_date_stages_are_skipped(tmp_path: Path) -> None:
    assert go(tmp_path / "w") == ["letters", "total"]
    assert go(tmp_path / "w") == []
    assert go(tmp_path / "w", quality="draft") == ["total"]
    assert go(tmp_path / "w", quality="draft", seed=3) == ["letters", "total"]
    (tmp_path / "w" / "sum" / "total.json").unlink()
    assert go(tmp_path / "w", quality="draft", seed=3) == ["total"]


@pytest.mark.parametrize("how", ["changed", "one bit", "one bit, and the time put back", "cut short", "gone"])
def test_a_result_that_is_another_one_than_the_stage_wrote_is_made_again(how: str, tmp_path: Path) -> None:
    """Nothing is made of it; what may be a person's is kept."""
    go(tmp_path / "w")
    file = tmp_path / "w/letters/03.txt"
    before, time_before = file.read_bytes(), file.stat().st_mtime_ns
    turned = bytes([before[0] ^ 1, *before[1:]])
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes({"changed": b"a person's", "cut short": b""}.get(how, turned))
    if "time" in how:
        os.utime(file, ns=(time_before, time_before))
    other = file.read_bytes() if file.exists() else None
    states = explained_states(Workspace.open(tmp_path / "w"), RunSettings(), Path("."), stages=STAGES)
    assert states["letters"].why == f"letters/03.txt {'is gone' if how == 'gone' else 'was changed since'}"
    assert go(tmp_path / "w") == ["letters"]
    assert file.read_bytes() == before and go(tmp_path / "w") == []
    kept = tmp_path / "w/kept/letters/03.txt"
    assert (kept.read_bytes() if kept.exists() else None) == (None if "time" in how else other)


def test_networks_count_by_their_content(tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    names = ("inpainter", "reference_inpainter")
    stages = (STAGES[0], replace(STAGES[1], settings=names, outside=files_of_networks))
    network = mean_fill(tmp_path / "mean.onnx")

    def again(**given: str) -> list[str]:
        return run_stages(workspace, stages, RunSettings(**given), Path("."))  # type: ignore[arg-type]

    assert again() == ["letters", "total"]
    assert again(inpainter=str(network)) == ["total"] and again(inpainter=str(network)) == []
    moved = network.rename(tmp_path / "moved.onnx")
    assert again(inpainter=str(moved)) == []
    blur(moved, 2)
    assert again(inpainter=str(moved)) == ["total"]
    (tmp_path / "moved.onnx.data").write_bytes(b"weights beside it")
    assert again(inpainter=str(moved)) == ["total"]
    reference = from_reference(tmp_path / "reference.onnx")
    assert again(inpainter=str(moved), reference_inpainter=str(reference)) == ["total"]


@pytest.mark.parametrize("name", ["inpainter", "reference_inpainter"])
def test_a_network_that_is_none_is_told_before_anything_runs(name: str, tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    stages = (STAGES[0], replace(STAGES[1], settings=(name,), check=check_networks))
    with pytest.raises(SettingsError, match="absent.onnx: cannot be read"):
        run_stages(workspace, stages, RunSettings(**{name: str(tmp_path / "absent.onnx")}), Path("."))  # type: ignore[arg-type]
    assert not (tmp_path / "w/letters").exists()
    (tmp_path / "broken.onnx").write_bytes(b"0" * 100)
    with pytest.raises(SettingsError, match="broken.onnx: cannot be loaded"):
        run_stages(workspace, stages, RunSettings(**{name: str(tmp_path / "broken.onnx")}), Path("."))  # type: ignore[arg-type]
    # Stages that do not need it do not ask for it.
    settings = RunSettings(**{name: str(tmp_path / "absent.onnx")})  # type: ignore[arg-type]
    assert run_stages(workspace, stages[:1], settings, Path(".")) == ["letters"]


def test_state_and_events_tell_what_happened(tmp_path: Path) -> None:
    go(tmp_path / "w")
    workspace = Workspace.open(tmp_path / "w")
    stage = workspace.state()["stages"]["letters"]
    assert stage["status"] == "done" and stage["seconds"] >= 0 and stage["peak_memory_mb"] > 10
    events = workspace.events()
    assert {"t", "stage", "done", "total", "message", "level"} <= set(events[0])
    assert events[-1]["message"] == "done"
    with workspace.events_jsonl.open("a") as stream:
        stream.write('{"t": 1, "stage": "cut')
    assert len(workspace.events()) == len(events)


def test_a_failing_stage_keeps_the_old_result(tmp_path: Path) -> None:
    go(tmp_path / "w")

    def broken(context: StageContext) -> None:
        context.output("sum/total.json").write_text("half")
        raise UnveilError("nothing to sum", path="letters", mend="write some")

    stages = (STAGES[0], replace(STAGES[1], run=broken, variant="broken"))
    before = (tmp_path / "w/sum/total.json").read_text()
    with pytest.raises(UnveilError, match="letters: nothing to sum"):
        run_stages(Workspace.open(tmp_path / "w"), stages, RunSettings(), Path("."))
    assert (tmp_path / "w/sum/total.json").read_text() == before
    assert not list((tmp_path / "w").glob(".partial*"))
    assert Workspace.open(tmp_path / "w").state()["stages"]["total"]["status"] == "failed"
    assert go(tmp_path / "w") == []


@pytest.mark.parametrize("end", [Cancelled("total"), UnveilError("nothing to sum")])
def test_an_attempt_with_other_settings_leaves_the_finished_result_valid(end: Exception, tmp_path: Path) -> None:
    go(tmp_path / "w")
    record = Workspace.open(tmp_path / "w").state()["stages"]["total"]

    def unwilling(context: StageContext) -> Facts:
        if context.settings.quality == "high":
            raise end
        return {"texts": 20}

    def again(quality: str) -> list[str]:
        stages = (STAGES[0], replace(STAGES[1], run=unwilling))
        return run_stages(Workspace.open(tmp_path / "w"), stages, RunSettings(quality=quality), Path("."))

    assert again("standard") == []
    with pytest.raises(type(end)):
        again("high")
    entry = Workspace.open(tmp_path / "w").state()["stages"]["total"]
    assert entry["status"] in ("cancelled", "failed") and entry["attempt"]["settings"] == {"quality": "high"}
    assert entry["settings"] == {"quality": "standard"} and entry["input_hash"] == record["input_hash"]
    assert again("standard") == []
    assert Workspace.open(tmp_path / "w").state()["stages"]["total"] == record


def test_what_a_stage_returns_is_recorded_when_it_is_done_and_not_before(tmp_path: Path) -> None:
    seen: list[dict[str, object]] = []

    def counts(context: StageContext) -> Facts:
        letters(context)
        seen.append(context.workspace.state()["stages"]["letters"])
        return {"count": context.settings.seed}

    stages = (replace(STAGES[0], run=counts),)
    for seed in (1, 2):
        run_stages(Workspace.create(tmp_path / "w"), stages, RunSettings(seed=seed), Path("."))
    assert "count" not in seen[0] and seen[1]["count"] == 1
    assert Workspace.open(tmp_path / "w").state()["stages"]["letters"]["count"] == 2


SCRIPT = """
import sys
from pathlib import Path
from tests.pipeline.test_runner import go
try:
    go(Path(sys.argv[1]))
except BaseException as error:
    print(type(error).__name__)
    raise SystemExit(130)
"""


def start(root: Path, slow: float) -> subprocess.Popen:  # type: ignore[type-arg]
    environment = {**os.environ, "SLOW": str(slow)}
    where = Path(__file__).resolve().parents[2]
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(root)], env=environment, cwd=where, stdout=subprocess.PIPE
    )


def files(root: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(root)): p.read_bytes()
        for p in sorted(root.rglob("*"))
        if p.is_file() and not p.name.startswith(".") and p.parent not in (root, root / ".made")
    }


def test_killed_anywhere_it_goes_on_to_the_same_result(tmp_path: Path) -> None:
    go(tmp_path / "whole")
    for turn, wait in enumerate((0.05, 0.35, 0.75)):
        root = tmp_path / f"killed{turn}"
        process = start(root, 0.03)
        deadline = time.monotonic() + 120
        while not (root / "events.jsonl").exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(wait)
        process.send_signal(signal.SIGKILL)
        process.wait()
        go(root)
        assert files(root) == files(tmp_path / "whole")
        assert go(root) == []


def test_an_interrupted_move_is_finished(tmp_path: Path) -> None:
    go(tmp_path / "w")
    root = tmp_path / "w"
    partial = root / ".partial-total"
    (partial / "sum").mkdir(parents=True)
    (partial / "sum/total.json").write_text("new")
    (root / ".journal.json").write_text(
        json.dumps(
            {
                "stage": "total",
                "partial": partial.name,
                "outputs": list(STAGES[1].outputs),
                "record": {"status": "done", "input_hash": "of the new one"},
            }
        )
    )

    recover(Workspace.open(root))
    assert (root / "sum/total.json").read_text() == "new"
    assert not partial.exists() and not (root / ".journal.json").exists()
    assert Workspace.open(root).state()["stages"]["total"] == {"status": "done", "input_hash": "of the new one"}


@pytest.mark.parametrize(
    "entry",
    [
        {"partial": "../elsewhere", "outputs": []},
        {"partial": "/elsewhere", "outputs": []},
        {"partial": ".partial-total", "outputs": ["../../elsewhere"]},
        {"partial": ".partial-total", "outputs": ["/elsewhere"]},
        {"partial": ".partial-total", "outputs": "letters"},
        {"partial": ".partial-total", "outputs": [], "record": None},
        [],
    ],
)
def test_a_journal_that_this_program_did_not_write_moves_and_removes_nothing(entry: object, tmp_path: Path) -> None:
    go(tmp_path / "w")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/thesis.txt").write_text("important")
    if isinstance(entry, dict):
        entry = {"stage": "total", "record": {}, **entry}
    (tmp_path / "w/.journal.json").write_text(json.dumps(entry))
    before = files(tmp_path)
    with pytest.raises(WorkspaceError, match="Not a journal of this program"):
        go(tmp_path / "w")
    assert files(tmp_path) == before


def test_interrupt_ends_with_cancelled_and_resumes(tmp_path: Path) -> None:
    root = tmp_path / "w"
    process = start(root, 10.0)  # the signal cuts the stage's sleep short
    deadline = time.monotonic() + 120
    while not list(root.glob(".partial-letters/letters/*")) and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    assert process.returncode == 130 and b"Cancelled" in out
    assert Workspace.open(root).state()["stages"]["letters"]["status"] == "cancelled"
    assert go(root) == ["letters", "total"]


def test_two_processes_do_not_share_a_workspace(tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    with workspace.lock(), pytest.raises(WorkspaceError, match="In use by another process"), workspace.lock():
        pass
    with workspace.lock():
        pass


def test_workspaces_do_not_take_over_other_folders(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("important")
    with pytest.raises(WorkspaceError, match="Not empty, and not a workspace"):
        Workspace.create(tmp_path / "mine")
    with pytest.raises(WorkspaceError, match="Not a workspace"):
        Workspace.open(tmp_path / "mine")
    with pytest.raises(WorkspaceError, match="Not a folder"):
        Workspace.create(tmp_path / "mine" / "thesis.txt")


def test_a_missing_input_names_the_stage(tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match="has no letters, which total needs"):
        run_stages(Workspace.create(tmp_path / "w"), STAGES[1:], RunSettings(), Path("."))


def test_settings_are_checked_and_round_trip() -> None:
    settings = RunSettings(remove=("car",), instances=(3, 7), quality="draft", seed=5, work_side=256)
    assert RunSettings.from_json(json.loads(json.dumps(settings.to_json()))) == settings
    for bad in ({"quality": "best"}, {"seed": -1}, {"work_side": 3}, {"device": "gpu"}, {"inpainter": "magic"}):
        with pytest.raises(SettingsError):
            RunSettings(**bad)  # type: ignore[arg-type]


def test_cancelled_is_no_user_error() -> None:
    assert not issubclass(Cancelled, UnveilError)


def test_systems_without_unix_modules_run_it_all_the_same(tmp_path: Path) -> None:
    """Windows has neither of these modules."""
    program = (
        "import psutil, sys; sys.modules['resource'] = sys.modules['grp'] = sys.modules['pwd'] = None\n"
        "from unveil_core.app.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    subprocess.run([sys.executable, "-c", program, "import", str(drive), "-o", str(root)], check=True)
    stage = Workspace.open(root).state()["stages"]["import"]
    assert stage["status"] == "done" and stage["peak_memory_mb"] > 10


def test_what_an_interrupted_attempt_kept_serves_the_next_one_with_the_same_inputs(tmp_path: Path) -> None:
    made: list[str] = []

    def in_parts(context: StageContext) -> None:
        for name in ("a", "b", "c"):

            def make(name: str = name) -> dict[str, np.ndarray]:
                made.append(name)
                return {"seed": np.array(context.settings.seed)}

            before = len(made)
            found = context.kept.once(name, make)
            context.output(f"parts/{name}.txt").write_text(str(found["seed"]))
            if name == "b" and len(made) > before:
                raise Cancelled("parts")

    stages = (Stage("parts", in_parts, (), ("parts",), ("seed",)),)

    def again(seed: int) -> list[str]:
        return run_stages(Workspace.create(tmp_path / "w"), stages, RunSettings(seed=seed), Path("."))

    with pytest.raises(Cancelled):
        again(0)
    assert made == ["a", "b"] and (tmp_path / "w/.partial-parts").is_dir()
    assert again(0) == ["parts"] and made == ["a", "b", "c"]
    assert sorted(p.name for p in (tmp_path / "w/parts").iterdir()) == ["a.txt", "b.txt", "c.txt"]
    # Of other inputs nothing is used, and when the old result is good again, nothing stays.
    with pytest.raises(Cancelled):
        again(1)
    assert made == ["a", "b", "c", "a", "b"] and (tmp_path / "w/.partial-parts").is_dir()
    assert again(0) == [] and not (tmp_path / "w/.partial-parts").exists()
    assert (tmp_path / "w/parts/c.txt").read_text() == "0"


def test_what_a_failed_attempt_kept_is_thrown_away(tmp_path: Path) -> None:
    def broken(context: StageContext) -> None:
        context.kept.once("half", lambda: {"x": np.zeros(1)})
        raise UnveilError("cannot be used", path="x", mend="use another")

    with pytest.raises(UnveilError):
        run_stages(
            Workspace.create(tmp_path / "w"), (Stage("parts", broken, (), ("parts",)),), RunSettings(), Path(".")
        )
    assert not (tmp_path / "w/.partial-parts").exists()


def test_what_a_stage_leaves_in_cycles_is_gone_before_the_next(tmp_path: Path) -> None:
    class Large:
        def __init__(self) -> None:
            self.itself = self

    left: list[weakref.ref[Large]] = []

    def leaves(context: StageContext) -> None:
        left.append(weakref.ref(Large()))
        context.output("a.txt").write_text("a")

    def looks(context: StageContext) -> None:
        assert left[0]() is None
        context.output("b.txt").write_text("b")

    stages = (Stage("leaves", leaves, (), ("a.txt",)), Stage("looks", looks, ("a.txt",), ("b.txt",)))
    gc.disable()
    try:
        assert run_stages(Workspace.create(tmp_path / "w"), stages, RunSettings(), Path(".")) == ["leaves", "looks"]
    finally:
        gc.enable()


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_an_interrupt_does_not_wait_for_what_is_imported(tmp_path: Path) -> None:
    """PyTorch takes seconds, in which no progress is told."""

    def work(context: StageContext) -> None:
        raise AssertionError("it is not begun")

    def load() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(30)
        waited.append("to the end")

    work.load = load  # type: ignore[attr-defined]
    workspace = Workspace.create(tmp_path / "w")
    waited: list[str] = []
    with pytest.raises(Cancelled):
        run_stages(workspace, (Stage("slow", work, (), ("slow",)),), RunSettings(), Path("."))
    assert not waited and workspace.state()["stages"]["slow"]["status"] == "cancelled"

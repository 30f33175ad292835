"""The stage graph and its runner: skip what is up to date, redo what changed, survive a kill at any moment.

A stage writes into a folder of its own; when it has finished, its outputs are renamed into place under a journal, so that after
``kill -9`` the workspace holds either the old or the new result of a stage, and the next run goes on from there.
"""

from __future__ import annotations

import json
import platform
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from unveil_core.base.errors import Cancelled, DiskFullError, UnveilError, WorkspaceError
from unveil_core.base.files import disk_is_full, write_json_atomic
from unveil_core.base.peak_memory import peak_memory_mb
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.pipeline.digests import Digests, input_hash
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Reporter, Stage, StageContext, silent
from unveil_core.workspace.workspace import Workspace

__all__ = ["depends_on", "run_stages"]


# ----------------------------------------------------------------------------------------------------------------- digests


# ------------------------------------------------------------------------------------------------------------------ runner


def _move_into_place(workspace: Workspace, stage: Stage, partial: Path) -> None:
    """Rename a finished stage's outputs over the old ones. The journal makes an interrupted move finish at the next start."""
    journal = workspace.root / ".journal.json"
    write_json_atomic(journal, {"stage": stage.name, "partial": partial.name, "outputs": list(stage.outputs)})
    for name in stage.outputs:
        source, target = partial / name, workspace.root / name
        if source.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir():
                shutil.rmtree(target)
            elif target.exists():
                target.unlink()
            source.rename(target)
    shutil.rmtree(partial, ignore_errors=True)
    journal.unlink()


def recover(workspace: Workspace) -> None:
    """Finish an interrupted move, and throw away what an interrupted stage left."""
    journal = workspace.root / ".journal.json"
    if journal.is_file():
        data = json.loads(journal.read_text())
        partial = workspace.root / data["partial"]
        stage = Stage(data["stage"], lambda _: None, (), tuple(data["outputs"]))
        if partial.is_dir():
            _move_into_place(workspace, stage, partial)
        else:
            journal.unlink()
    for left in workspace.root.glob(".partial-*"):
        shutil.rmtree(left, ignore_errors=True)
    for left in workspace.root.rglob(".*.partial"):
        if left.is_file():
            left.unlink()


@contextmanager
def _signals(flag: threading.Event) -> Iterator[None]:
    """SIGINT and SIGTERM (and Ctrl+Break on Windows) raise the flag; the next progress call ends the work."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heeded = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, n)]
    previous = {s: signal.signal(s, lambda *_: flag.set()) for s in heeded}
    try:
        yield
    finally:
        for s, handler in previous.items():
            signal.signal(s, handler)


def depends_on(inputs: Sequence[str], outputs: Sequence[str] | set[str]) -> bool:
    """Whether an input is one of the outputs, a folder that holds one, or lies in one."""
    return any(a == b or a.startswith(f"{b}/") or b.startswith(f"{a}/") for a in inputs for b in outputs)


def _follows(stage: Stage, recorded: dict[str, Any]) -> dict[str, str]:
    """The input hashes of the stages whose outputs a stage reads: with them one can tell at a glance what is stale."""
    inputs = stage.inputs + stage.optional
    return {
        name: entry["input_hash"] for name, entry in recorded.items()
        if name != stage.name and "input_hash" in entry and depends_on(inputs, entry.get("outputs", ()))
    }  # fmt: skip


@contextmanager
def _room_on(root: Path) -> Iterator[None]:
    """Errors for want of space become the one line that says so."""
    try:
        yield
    except OSError as error:
        if disk_is_full(error, root):
            raise DiskFullError(root) from error
        raise


def run_stages(
    workspace: Workspace,
    stages: Sequence[Stage],
    settings: RunSettings,
    drive: Path,
    *,
    force: bool = False,
    reporter: Reporter = silent,
) -> list[str]:
    """Run stages in order, each only if something that it depends on has changed.

    Args:
        workspace: where.
        stages: in the order of their dependence.
        settings: recorded in workspace.json.
        drive: the drive as the user gave it.
        force: run them even if they are up to date.
        reporter: receives each event.
    Returns:
        names of the stages that ran.
    Raises:
        Cancelled: SIGINT or SIGTERM came; the workspace resumes.
        DiskFullError: no room; the workspace resumes.
        UnveilError: bad input; the stage's partial output is gone.
    """
    ran: list[str] = []
    _check_networks(stages, settings)
    stop = threading.Event()
    with _room_on(workspace.root), workspace.lock(), _signals(stop):
        recover(workspace)
        digests = Digests(workspace)
        workspace.update(drive=str(drive), settings=settings.to_json(), versions=_versions())
        for stage in stages:
            missing = [n for n in stage.inputs if not (workspace.root / n).exists()]
            if missing:
                raise WorkspaceError(
                    f"has no {missing[0]}, which {stage.name} needs", path=workspace.root,
                    mend="run the stages before it, or `unveil run`",
                )  # fmt: skip
            wanted = input_hash(stage, workspace, settings, drive, digests)
            all_recorded = workspace.state().get("stages", {})
            recorded = all_recorded.get(stage.name, {})
            follows = _follows(stage, all_recorded)
            there = all((workspace.root / n).exists() for n in stage.outputs)
            if not force and there and recorded.get("status") == "done" and recorded.get("input_hash") == wanted:
                if recorded.get("follows") != follows:  # other inputs, of the same content
                    workspace.update_stage(stage.name, follows=follows)
                reporter(workspace.log(stage.name, "up to date", done=1, total=1))
                continue
            _run_one(workspace, stage, settings, drive, wanted, stop, reporter)
            workspace.update_stage(stage.name, follows=follows)
            ran.append(stage.name)
            digests.save()
    return ran


def _check_networks(stages: Sequence[Stage], settings: RunSettings) -> None:
    """Before anything runs: whether the networks that one of the stages needs are there, and are such networks."""
    wanted = {name for stage in stages for name in stage.settings} & set(settings.networks)
    if "inpainter" in wanted:
        inpainter(settings.inpainter)
    if "reference_inpainter" in wanted:
        load_reference(settings.networks["reference_inpainter"])


def _run_one(
    workspace: Workspace, stage: Stage, settings: RunSettings, drive: Path, wanted: str, stop: threading.Event,
    reporter: Reporter,
) -> None:  # fmt: skip
    partial = workspace.root / f".partial-{stage.name}"
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    logged = [0.0]

    def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
        if stop.is_set():
            raise Cancelled(stage.name)
        now = time.monotonic()
        if done >= total or now - logged[0] > 0.2:  # a log of every step would be larger than the result
            logged[0] = now
            rounded: dict[str, Any] = {k: round(v, 5) for k, v in metrics.items()}
            reporter(workspace.log(stage.name, message, done=done, total=total, **rounded))

    started = time.monotonic()
    workspace.update_stage(stage.name, status="running")
    reporter(workspace.log(stage.name, "started"))
    try:
        stage.body(StageContext(workspace, settings, progress, drive, partial))
        if stop.is_set():
            raise Cancelled(stage.name)
    except BaseException as error:
        shutil.rmtree(partial, ignore_errors=True)
        status = "cancelled" if isinstance(error, Cancelled | KeyboardInterrupt) else "failed"
        detail: dict[str, Any] = (
            {} if isinstance(error, UnveilError | Cancelled) else {"traceback": traceback.format_exc()}
        )
        with suppress(OSError):  # a full disk has no room for this either; the error itself is what must be told
            workspace.update_stage(stage.name, status=status)
            reporter(workspace.log(stage.name, str(error), level="error", **detail))
        if isinstance(error, KeyboardInterrupt):
            raise Cancelled(stage.name) from error
        raise
    _move_into_place(workspace, stage, partial)
    seconds = round(time.monotonic() - started, 2)
    values = settings.to_json()
    workspace.update_stage(
        stage.name, status="done", seconds=seconds, peak_memory_mb=peak_memory_mb(), input_hash=wanted,
        settings={k: values[k] for k in stage.settings}, outputs=list(stage.outputs),
    )  # fmt: skip
    reporter(workspace.log(stage.name, "done", done=1, total=1, seconds=seconds))


def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version

    from unveil_core import __version__

    found = {"unveil": __version__, "python": platform.python_version()}
    for name in ("torch", "numpy", "numba", "opencv-contrib-python-headless"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found

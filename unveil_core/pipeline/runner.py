"""Runs stages: skips what is up to date, redoes what changed, survives a kill at any moment.

A stage writes into a folder of its own; when it has finished, its outputs are renamed into place under a journal (see
``workspace.journal``). The ``input_hash`` in workspace.json belongs to the outputs that lie there, whatever became of later
attempts: a cancelled or failed attempt leaves the finished result valid.
"""

from __future__ import annotations

import platform
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import (
    Cancelled,
    DiskFullError,
    DriveError,
    GpuMemoryError,
    GpuTooSmallError,
    Interrupted,
    OutOfMemoryError,
    SettingsError,
    UnveilError,
    WorkspaceError,
)
from unveil_core.base.files import full_disk, is_out_of_gpu_memory, is_out_of_memory
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.kernels.device import check_device, working_on
from unveil_core.base.mechanisms import without
from unveil_core.base.process_memory import (
    free_cycles,
    old_objects_set_aside,
    peak_memory_mb,
    return_free_memory,
)
from unveil_core.base.progress import heeding
from unveil_core.base.resume.parts import Parts
from unveil_core.drives.imported import read_imported
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.pipeline.forecasting import Expected
from unveil_core.pipeline.mechanisms import of_stage
from unveil_core.pipeline.outside import let_go
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import (
    SCRATCH,
    Notice,
    Reporter,
    Stage,
    StageContext,
    note_of_block,
    parts_of,
    silent,
)
from unveil_core.pipeline.up_to_date import Digests, depends_on, input_hash, is_current
from unveil_core.workspace.assumptions import recorded_assumptions
from unveil_core.workspace.journal import PARTIAL, commit, open_partial, recover
from unveil_core.workspace.made import made_by
from unveil_core.workspace.workspace import Workspace

__all__ = ["run_block", "run_stages"]

TRIM_EVERY_S = 1.0
"""Seconds between returns of freed memory, each of which takes some milliseconds."""

KILLED = "the last run ended here: killed, or out of memory or power; this run continues it"
"""Such a run could not say it itself."""


class _Stop(threading.Event):
    """Whether the run is to end.

    Attributes:
        at_once: while no progress is told, as while PyTorch is loaded, a signal does not wait for it.
    """

    at_once = False

    def heed(self, *_: object) -> None:
        """What a signal does."""
        self.set()
        if self.at_once:
            raise Interrupted


@contextmanager
def _signals(flag: _Stop) -> Iterator[None]:
    """SIGINT and SIGTERM (and Ctrl+Break on Windows) raise the flag; the next progress call ends the work.

    They reach the main thread alone: a run in another one heeds what its caller does.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heeded = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGBREAK") if hasattr(signal, n)]
    previous = {s: signal.signal(s, flag.heed) for s in heeded}
    try:
        with heeding(flag):
            yield
    finally:
        for s, handler in previous.items():
            signal.signal(s, handler)


def _follows(stage: Stage, recorded: dict[str, Any]) -> dict[str, str]:
    """The input hashes of the stages whose outputs a stage reads: they show at a glance what is stale."""
    return {
        name: entry["input_hash"]
        for name, entry in recorded.items()
        if name != stage.name and "input_hash" in entry and depends_on(stage.inputs, entry.get("outputs", ()))
    }


@contextmanager
def _room_on(root: Path) -> Iterator[None]:
    """Errors for lack of disk space become one line that says so."""
    try:
        yield
    except OSError as error:
        if full := full_disk(error, root):
            raise DiskFullError(full) from error
        raise


def run_stages(
    workspace: Workspace,
    stages: Sequence[Stage],
    settings: RunSettings,
    drive: Path,
    *,
    force: bool = False,
    notices: Sequence[Notice] = (),
    expected: Expected | None = None,
    reporter: Reporter = silent,
) -> list[str]:
    """Run stages in order, each only if something that it depends on has changed.

    Args:
        workspace: where.
        stages: in the order of their dependence.
        settings: recorded in workspace.json.
        drive: the drive as the user gave it.
        force: run them even if they are up to date.
        notices: the first events, before those of any stage.
        expected: what the run will take, by which events tell the time left; None = they do not.
        reporter: receives each event.
    Returns:
        names of the stages that ran.
    Raises:
        Cancelled: SIGINT or SIGTERM came; the workspace resumes.
        DiskFullError: no room; the workspace resumes.
        OutOfMemoryError: no memory; the workspace resumes.
        UnveilError: bad input; the stage's partial output is gone.
    """
    ran: list[str] = []
    for stage in stages:
        if stage.check is not None:
            stage.check(settings)
    stop = _Stop()
    check_device(settings.device)
    with _room_on(workspace.root), workspace.lock(), _signals(stop), old_objects_set_aside():
        recover(workspace)
        killed = [
            name for name, entry in workspace.state().get("stages", {}).items() if entry.get("status") == "running"
        ]
        notices = [*notices, *(Notice(name, KILLED) for name in killed)]
        digests = Digests(workspace)
        workspace.update(drive=str(drive), settings=settings.to_json(), versions=_versions())
        for notice in notices:
            reporter(workspace.log(notice.stage, notice.message, level=notice.level, **dict[str, Any](notice.details)))
        for stage in stages:
            _check_inputs(stage, workspace)
            if stage.inputs:
                let_go()
            wanted = input_hash(stage, workspace, settings, drive, digests)
            all_recorded = workspace.state().get("stages", {})
            recorded, follows = all_recorded.get(stage.name, {}), _follows(stage, all_recorded)
            if not force and is_current(stage, workspace, recorded, wanted, digests):
                if recorded.get("status") != "done" or recorded.get("follows") != follows or "attempt" in recorded:
                    # After a broken-off attempt with other settings, or made from other inputs of the same content.
                    kept = {k: v for k, v in recorded.items() if k != "attempt"}
                    workspace.replace_stage(stage.name, {**kept, "status": "done", "follows": follows})
                shutil.rmtree(workspace.root / f"{PARTIAL}{stage.name}", ignore_errors=True)
                reporter(workspace.log(stage.name, "up to date", done=1, total=1))
                if expected is not None:
                    expected.clock.end(stage.name)
                continue
            if force:
                shutil.rmtree(parts_of(workspace.root, stage.name), ignore_errors=True)
            _Attempt(workspace, stage, settings, drive, stop, reporter, expected).make(wanted, follows, digests)
            ran.append(stage.name)
            digests.save()
    return ran


def run_block(
    workspace: Workspace,
    stage: Stage,
    number: int,
    settings: RunSettings,
    drive: Path,
    *,
    reporter: Reporter = silent,
) -> bool:
    """Make one block of a stage and keep it for the stage; several processes may, each another block.

    Args:
        number: of the block, from 0.
        settings, drive: as for the stage, whose next run takes the block if they are the same.
    Returns:
        False where the stage is up to date and needs no block.
    Raises:
        SettingsError: the stage has no such block.
        WorkspaceError: what the stage reads is missing; another run has the workspace.
    """
    if stage.run_block is None:
        raise SettingsError(f"Not made in blocks: {stage.name}", mend=f"run `unveil {stage.name}`")
    stop = _Stop()
    check_device(settings.device)
    with _room_on(workspace.root), _signals(stop):
        with workspace.lock():
            recover(workspace)
            _check_inputs(stage, workspace)
            digests = Digests(workspace)
            wanted = input_hash(stage, workspace, settings, drive, digests)
            recorded = workspace.state().get("stages", {}).get(stage.name, {})
            if is_current(stage, workspace, recorded, wanted, digests):
                return False
            count = len(cut_into_blocks(read_imported(workspace.drive_dir, points=False)).blocks)
            if not 0 <= number < count:
                raise SettingsError(f"Not a block: {number}", mend=f"use 0 to {count - 1}")
            partial = open_partial(workspace, stage.name, wanted)
        with workspace.lock(shared=True):
            attempt = _Attempt(workspace, stage, settings, drive, stop, reporter)
            with working_on(settings.device) as used, attempt.mechanisms():
                stage.run_block(attempt.context(partial), number)
            for line in used.notes:
                reporter(workspace.log(stage.name, line, level="notice"))
            if stop.is_set():
                raise Cancelled(stage.name)
            if error := _change_of(stage, workspace, digests):
                raise error
            note = note_of_block(workspace.root, stage.name, number)
            note.parent.mkdir(parents=True, exist_ok=True)
            note.touch()
    return True


def _check_inputs(stage: Stage, workspace: Workspace) -> None:
    missing = [n for n in stage.inputs if not (workspace.root / n).exists()]
    if missing:
        raise WorkspaceError(
            f"has no {missing[0]}, which {stage.name} needs",
            path=workspace.root,
            mend="run the stages before it, or `unveil run`",
        )


def _check_nothing_changed(stage: Stage, workspace: Workspace, digests: Digests) -> None:
    """Raise an error where a file that a stage read is another one than when it began."""
    error = _change_of(stage, workspace, digests)
    if error is not None:
        # Named after what was there before, and made of who knows what.
        shutil.rmtree(parts_of(workspace.root, stage.name), ignore_errors=True)
        raise error


def _change_of(stage: Stage, workspace: Workspace, digests: Digests) -> UnveilError | None:
    """What is said where a file was changed under a stage that read it; None where none was."""
    changed = digests.changed()
    if changed is None:
        return None
    kind = WorkspaceError if changed.is_relative_to(workspace.root) else DriveError
    return kind(
        f"Changed or removed while {stage.name} read it",
        path=changed,
        mend="leave it alone during a run, and run again: finished stages stay",
    )


@dataclass
class _Attempt:
    """One stage being run."""

    workspace: Workspace
    stage: Stage
    settings: RunSettings
    drive: Path
    stop: _Stop
    reporter: Reporter
    expected: Expected | None = None
    last_logged: float = 0.0
    last_trimmed: float = 0.0

    def make(self, wanted: str, follows: dict[str, str], digests: Digests) -> None:
        """Run the stage and commit its outputs under the input hash ``wanted``, which ``digests`` were taken for."""
        stage, workspace = self.stage, self.workspace
        partial = open_partial(workspace, stage.name, wanted)
        begun_before = (partial / SCRATCH).exists()
        chosen = stage.chosen(self.settings)
        started = time.monotonic()
        workspace.update_stage(stage.name, status="running", attempt={"settings": chosen})
        if self.expected is not None:
            self.expected.clock.begin(stage.name)
        self.reporter(workspace.log(stage.name, "started"))
        try:
            self._load()
            with working_on(self.settings.device) as used, self.mechanisms():
                facts = stage.run(self.context(partial))
            if self.stop.is_set():
                raise Cancelled(stage.name)
            _check_nothing_changed(stage, workspace, digests)
        except BaseException as error:
            said = self._ended(error, partial, digests)
            if said is error:
                raise
            raise said from error
        # Sequences of frames and what they are made of refer to each other: without this they stay for the whole run.
        free_cycles()
        return_free_memory()
        seconds = round(time.monotonic() - started, 2)
        record = {
            "status": "done",
            "seconds": seconds,
            "peak_memory_mb": peak_memory_mb(),
            "input_hash": wanted,
            "settings": chosen,
            "outputs": list(stage.outputs),
            "follows": follows,
            **({} if used.device is None else {"device": used.device.name}),
            **(facts or {}),
        }
        if used.notes:
            record["device_notes"] = used.notes
        commit(workspace, stage.name, partial, stage.outputs, record)
        digests.trust(made_by(workspace.root, stage.name))
        for note in used.notes:
            self.reporter(workspace.log(stage.name, note, level="notice"))
        for _, assumption in recorded_assumptions({stage.name: record}):
            if not assumption.holds:
                self.reporter(workspace.log(stage.name, assumption.message(), level="notice"))
        if self.expected is not None:
            self.expected.clock.end(stage.name)
        self.reporter(workspace.log(stage.name, "done", done=1, total=1, seconds=seconds, **self._left(1, 1)))
        if self.expected is not None and not begun_before:
            self.expected.ended(stage.name, seconds)

    def mechanisms(self) -> AbstractContextManager[None]:
        """A block in which those mechanisms of the stage do not work that the run does without."""
        return without(of_stage(self.stage.name, self.settings.without))

    def _load(self) -> None:
        """Import what the stage's function is made of."""
        load = getattr(self.stage.run, "load", None)
        if load is not None and not self.stop.is_set():
            self.stop.at_once = True
            try:
                load()
            finally:
                self.stop.at_once = False

    def _ended(self, error: BaseException, partial: Path, digests: Digests) -> BaseException:
        """Record that an attempt ended early, and return what is to be said of it."""
        stage, workspace = self.stage, self.workspace
        said = error
        if isinstance(error, KeyboardInterrupt):
            said = Cancelled(stage.name)
        elif is_out_of_memory(error):
            held = peak_memory_mb()
            traceback.clear_frames(error.__traceback__)  # what they hold is wanted now
            if is_out_of_gpu_memory(error):
                said = GpuMemoryError(workspace.root, stage.name)
            else:
                smaller = None if self.expected is None else self.expected.forecast.with_less_memory(held)
                said = OutOfMemoryError(workspace.root, stage.name, held, smaller)
        elif not isinstance(error, UnveilError | Cancelled):
            try:
                _check_nothing_changed(stage, workspace, digests)
            except UnveilError as change:
                said = change  # a file that vanished or grew may lead to any error
        # What was computed so far serves the next attempt, unless it may be what is wrong.
        if not isinstance(said, Cancelled | OutOfMemoryError | GpuTooSmallError | OSError):
            shutil.rmtree(partial, ignore_errors=True)
            Parts(parts_of(workspace.root, stage.name)).drop_unfinished()
        self._record_end(said, error)
        return said

    def context(self, partial: Path) -> StageContext:
        """What the stage works with; ``partial``: the folder that it writes in."""
        cache = FrameCache(self.settings.memory_bytes)
        return StageContext(self.workspace, self.settings, self.progress, self.drive, partial, cache)

    def progress(self, done: int, total: int, message: str = "", **metrics: float) -> None:
        """What the stage calls after each unit of work; raises Cancelled where the run is to stop."""
        if self.stop.is_set():
            raise Cancelled(self.stage.name)
        now = time.monotonic()
        if done >= total or now - self.last_logged > 0.2:  # a log of every step would be larger than the result
            self.last_logged = now
            rounded: dict[str, Any] = {k: round(v, 5) for k, v in metrics.items()}
            left = self._left(done, total)
            self.reporter(self.workspace.log(self.stage.name, message, done=done, total=total, **rounded, **left))
        if now - self.last_trimmed > TRIM_EVERY_S:
            return_free_memory()
            self.last_trimmed = time.monotonic()

    def _left(self, done: int, total: int) -> dict[str, Any]:
        """Time left of the whole run, seconds, as part of an event; nothing where that is not known."""
        if self.expected is None:
            return {}
        return {"left_s": round(self.expected.clock.left(self.stage.name, done, total))}

    def _record_end(self, said: BaseException, error: BaseException) -> None:
        """Record how an attempt ended; the entries of the result that lies there stay."""
        status = "cancelled" if isinstance(said, Cancelled) else "failed"
        detail: dict[str, Any] = {}
        if not isinstance(said, UnveilError | Cancelled):
            detail["traceback"] = "".join(traceback.format_exception(error))
        # A full disk has no room for this either; the error itself is what must be said.
        with suppress(OSError, MemoryError, WorkspaceError):
            self.workspace.update_stage(self.stage.name, status=status)
            self.reporter(self.workspace.log(self.stage.name, str(said), level="error", **detail))


def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version

    from unveil_core import __version__

    found = {"unveil": __version__, "python": platform.python_version()}
    for name in ("torch", "numpy", "numba", "opencv-contrib-python-headless"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found

"""The stage graph and its runner: skip what is up to date, redo what changed, survive a kill at any moment.

A stage writes into a folder of its own; when it has finished, its outputs are renamed into place under a journal, so that after
``kill -9`` the workspace holds either the old or the new result of a stage, and the next run goes on from there.
"""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import Cancelled, DiskFullError, UnveilError, WorkspaceError
from unveil_core.base.files import disk_is_full, write_json_atomic
from unveil_core.base.onnx_files import files_of
from unveil_core.base.peak_memory import peak_memory_mb
from unveil_core.base.progress import Progress
from unveil_core.drives.marked import files_named, read_marked
from unveil_core.inpaint.single_image.onnx_models import load_reference
from unveil_core.inpaint.single_image.registry import inpainter
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

__all__ = ["Digests", "Reporter", "Stage", "StageContext", "depends_on", "input_hash", "run_stages", "silent"]

Reporter = Callable[[dict[str, object]], None]
"""Receives each event as it is logged."""


def silent(event: dict[str, object]) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Stage:
    """One step from files to files.

    Attributes:
        name: the verb on the command line.
        body: does the work.
        inputs: files and folders read, relative to the workspace.
        optional: read too, but older workspaces lack them.
        outputs: files and folders written, relative to the workspace.
        settings: names of the RunSettings that influence the result.
        version: raised when the body's result changes.
        drive_digest: whether the drive outside the workspace is an input (the import).
    """

    name: str
    body: Callable[[StageContext], None]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: tuple[str, ...] = ()
    version: int = 1
    drive_digest: bool = False
    optional: tuple[str, ...] = ()


@dataclass(frozen=True)
class StageContext:
    """What a stage's body gets.

    Attributes:
        workspace: to read from.
        settings: of the run.
        progress: to call after each unit of work.
        drive: path of the drive as the user gave it.
        partial: where outputs are written, see :meth:`output`.
    """

    workspace: Workspace
    settings: RunSettings
    progress: Progress
    drive: Path
    partial: Path

    def output(self, relative: str) -> Path:
        """The path to write an output to; it moves to the same place in the workspace when the stage has finished."""
        path = self.partial / relative
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


# ----------------------------------------------------------------------------------------------------------------- digests


class Digests:
    """Content digests of files, remembered by size and time of change."""

    def __init__(self, workspace: Workspace) -> None:
        self.path = workspace.root / ".digests.json"
        self.known: dict[str, list] = {}  # type: ignore[type-arg]
        with suppress(OSError, ValueError):
            self.known = json.loads(self.path.read_text())

    def of_file(self, path: Path) -> str:
        stat = path.stat()
        key = str(path)
        held = self.known.get(key)
        if held and held[0] == stat.st_size and held[1] == stat.st_mtime_ns:
            return str(held[2])
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
        self.known[key] = [stat.st_size, stat.st_mtime_ns, digest]
        return digest

    def of(self, path: Path) -> list[tuple[str, str]]:
        """(relative name, digest) of a file or of all files in a folder."""
        if path.is_dir():
            return [(str(p.relative_to(path)), self.of_file(p)) for p in sorted(path.rglob("*")) if p.is_file()]
        return [("", self.of_file(path))] if path.is_file() else [("", "absent")]

    def save(self) -> None:
        write_json_atomic(self.path, self.known)


def input_hash(stage: Stage, workspace: Workspace, settings: RunSettings, drive: Path, digests: Digests) -> str:
    """Digest of everything that a stage's result depends on: settings, the content of its inputs, its version."""
    values = settings.to_json()
    for name, path in settings.networks.items():  # what is in the files counts, not where they lie
        if name in stage.settings:
            values[name] = [(p.name.removeprefix(path.name), digests.of_file(p)) for p in files_of(path)]
    if settings.marked is not None and "marked" in stage.settings:
        path = Path(settings.marked)
        pictures = [p for m in read_marked(path) if m.mattes is not None for p in files_named(m.mattes)]
        values["marked"] = [digests.of_file(p) for p in (path, *pictures)]
    parts: list[object] = [stage.name, stage.version, {k: values[k] for k in stage.settings}]
    parts += [(name, digests.of(workspace.root / name)) for name in (*stage.inputs, *stage.optional)]
    if stage.drive_digest:
        from unveil_core.drives import open_drive

        opened = open_drive(drive)
        files = [opened.root] if opened.root.is_file() else []
        for f in opened.frames:
            files += [p for p in (f.image_path, f.semantic_path, f.instance_path, f.mask_path) if p is not None]
        parts += [(str(p), digests.of(p)) for p in files]
        parts += [hashlib.blake2b(opened.points.positions.tobytes(), digest_size=16).hexdigest()]
        parts += [[f.camera.world_to_camera.tolist() for f in opened.frames]]
    return hashlib.blake2b(json.dumps(parts, sort_keys=True).encode(), digest_size=16).hexdigest()


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

"""A batch: drives, and the tasks that unveil them, each a plain command that can be repeated.

DIR/batch.json          drives and tasks, see :class:`Task`
DIR/drives/NAME/        the workspace of each drive
DIR/tasks/ID.json       what became of a task: status, tries, seconds, the last line that it said
DIR/tasks/ID.log        all that it said

A drive of one block is one task. A longer one has a task that prepares it, one for each block of the stages that are made in
blocks, and between them tasks that put the blocks together; these depend on one another.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.checks.fields import checked
from unveil_core.base.checks.names import file_name, is_file_name, name_key
from unveil_core.base.errors import DriveError, SettingsError, UnveilError, WorkspaceError
from unveil_core.base.files import read_json, write_json_atomic
from unveil_core.base.kernels.device import CPU, name_of_device
from unveil_core.base.output.written import GENERATOR
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.forecast.forecast import forecast
from unveil_core.forecast.machine import Machine, this_machine
from unveil_core.pipeline.forecasting import workload_of
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.output_place import check_folder_place
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace, is_workspace

__all__ = ["Batch", "BatchDrive", "Task", "plan_batch", "read_batch"]

VERSION = 1

LONGEST_ID_BYTES = 200
"""Of a task: a drive's name, a step and a number; a file is named after it, and names have 255 bytes at most."""


@dataclass(frozen=True)
class BatchDrive:
    """Attributes:
    name: of its workspace.
    drive: path of the drive; workspace: of the results.
    frames, blocks: how many it has.
    memory_mb: that a task of it needs, as forecast; seconds: of all its tasks together, on this machine.
    gpus: that a task of it needs: one with ``--device cuda``, else none. Workers and templates ask for it.
    """

    name: str
    drive: str
    workspace: str
    frames: int
    blocks: int
    memory_mb: int = 0
    seconds: int = 0
    gpus: int = 0


@dataclass(frozen=True)
class Task:
    """A command of ``unveil``.

    Attributes:
        id: unique in the batch, and a file name.
        drive: name of its drive; step: what it does, the same for all blocks of a stage; block: its number or None.
        arguments: after ``unveil``.
        after: ids of the tasks that must have succeeded.
    """

    id: str
    drive: str
    step: str
    block: int | None
    arguments: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class Batch:
    """A manifest.

    Attributes:
        root: its folder.
        drives, tasks: in the order of planning; tasks come after those that they depend on.
        files: names of templates that were written into the folder.
    """

    root: Path
    drives: tuple[BatchDrive, ...]
    tasks: tuple[Task, ...]
    files: tuple[str, ...] = ()

    def save(self) -> None:
        """Write ``batch.json``."""
        self.root.mkdir(parents=True, exist_ok=True)
        content = {
            "version": VERSION,
            "generator": GENERATOR,
            "files": list(self.files),
            "drives": [asdict(d) for d in self.drives],
            "tasks": [asdict(t) for t in self.tasks],
        }
        write_json_atomic(self.root / "batch.json", content)


def read_batch(root: Path) -> Batch:
    """The batch in a folder.

    Raises:
        WorkspaceError: there is none, or it is damaged.
    """
    path = root / "batch.json"
    try:
        data: Any = read_json(path)
        if data["version"] != VERSION:
            raise ValueError(f"version {data['version']}")
        files = data.get("files", [])
        if not isinstance(files, list) or not all(map(is_file_name, files)):
            raise ValueError("a file that is none of the folder")
        drives = tuple(checked(BatchDrive, d) for d in data["drives"])
        tasks = tuple(checked(Task, t) for t in data["tasks"])
        names = {drive.name for drive in drives}
        if len({name_key(name) for name in names}) < len(drives) or not all(map(is_file_name, names)):
            raise ValueError("two drives of one name, or a name that no file can have")
        known: set[str] = set()
        for task in tasks:
            named = re.fullmatch(r"[\w.-]+", task.id) and len(task.id.encode()) <= LONGEST_ID_BYTES
            ends = task.arguments and task.arguments[-1] != "--until"  # which names a stage
            if not named or not ends or task.drive not in names or not set(task.after) <= known or task.id in known:
                raise ValueError(f"task {task.id!r}")
            known.add(task.id)
    except (OSError, KeyError, TypeError, ValueError, AttributeError) as error:
        raise WorkspaceError(f"Not a batch: {error}", path=path, mend="run `unveil batch plan`") from error
    return Batch(root, drives, tasks, tuple(files))


def plan_batch(
    drives: Sequence[Path],
    root: Path,
    settings: RunSettings,
    options: Sequence[str] = (),
    *,
    replace: bool = False,
    leave_out: Callable[[Path, UnveilError], None] | None = None,
) -> Batch:
    """Plan the tasks of some drives.

    Args:
        drives: to unveil, each for itself.
        root: of the batch.
        settings: of all drives; options: the same as options of ``unveil run``.
        replace: whether a batch.json of other drives, or of another program, may be written over when the plan is saved.
        leave_out: told of each drive that cannot be read, which the batch then goes without; None = that is an error.
    Raises:
        DriveError: a drive that cannot be read.
        SettingsError: no drive; or a folder that is, holds, or lies in a drive, or is in use for something else.
    """
    before = _batch_before(root, drives, replace)
    planned: list[BatchDrive] = []
    tasks: list[Task] = []
    machine = this_machine(device=_device_of(settings))
    for path in drives:
        name = _name(path, [d.name for d in planned], root / "drives")
        try:
            drive = _planned(path, name, root, settings, machine)
        except UnveilError as error:
            if leave_out is None:
                raise
            leave_out(path, error)
            continue
        planned.append(drive)
        tasks += _tasks_of(drive, tuple(options))
    if not planned:
        raise SettingsError("no drive to plan", mend="name one or more that can be read")
    return Batch(root, tuple(planned), tuple(tasks), () if before is None else before.files)


def _device_of(settings: RunSettings) -> str:
    """The device whose times forecast the tasks: with a card they are others, which runs keep apart. A machine that only plans need
    not have the card that its workers have."""
    try:
        return name_of_device(settings.device)
    except SettingsError:
        return CPU.name


def _batch_before(root: Path, drives: Sequence[Path], replace: bool) -> Batch | None:
    """The batch that a folder holds already; None where the folder is free.

    Raises:
        SettingsError: it is no place for a batch of these drives.
    """
    check_folder_place(root, drives)
    path = root / "batch.json"
    mend = "name another folder with -o"
    if not os.path.lexists(path):
        # What a batch keeps there would lie among somebody's files.
        taken = next((root / name for name in ("drives", "tasks") if os.path.lexists(root / name)), None)
        if taken is not None:
            raise SettingsError("Not of a batch, and so not replaced", path=taken, mend=mend)
        return None
    try:
        before = read_batch(root)
    except UnveilError as error:
        if replace and path.is_file() and not path.is_symlink():
            return None
        raise SettingsError(
            "Not a batch, and so not replaced", path=path, mend=f"{mend}, or add --replace to write over it"
        ) from error
    known, wanted = ({_absolute(Path(d.drive)) for d in before.drives}, {_absolute(p) for p in drives})
    if not replace and (lost := sorted(known - wanted)):
        raise SettingsError(
            f"Holds the plan of other drives, as {lost[0]}", path=path, mend=f"{mend}, or add --replace to plan anew"
        )
    return before


def _absolute(path: Path) -> str:
    return str(path.absolute())


def _planned(path: Path, name: str, root: Path, settings: RunSettings, machine: Machine) -> BatchDrive:
    opened = open_drive(path, settings.drive_options)
    if not opened.frames:
        raise DriveError("has no frames", path=path)
    placement = place_drive(opened, scale=settings.scale, up=settings.up, camera_height_m=settings.camera_height)
    work = workload_of(localized(opened, placement), settings)
    expected = forecast(work, [stage.name for stage in STAGES], machine)
    return BatchDrive(
        name,
        str(path.absolute()),
        str((root / "drives" / name).absolute()),
        work.frames,
        work.blocks,
        round(expected.memory_mb),
        round(sum(expected.seconds.values())),
        int(settings.device == "cuda" or _device_of(settings) != CPU.name),
    )


def _name(path: Path, taken: Sequence[str], workspaces: Path) -> str:
    """A name for a drive's workspace that is no other's, in this plan or one before."""
    whole = path.absolute()
    stem = whole.parent.name if whole.suffix == ".json" else whole.name
    plain = file_name(re.sub(r"[^\w-]+", "_", stem).strip("_")[:80] or "drive")
    name, number = plain, 2
    keys = {name_key(other) for other in taken}
    while name_key(name) in keys or _is_others(workspaces / name, path):
        name, number = f"{plain}_{number}", number + 1
    return name


def _is_others(workspace: Path, drive: Path) -> bool:
    """Whether a folder is there, and is not the workspace of a drive."""
    if not os.path.lexists(workspace):
        return False
    if not is_workspace(workspace):
        return not workspace.is_dir() or any(workspace.iterdir())
    recorded = Workspace(workspace).state().get("drive")
    return recorded is not None and recorded != _absolute(drive)


def _tasks_of(drive: BatchDrive, options: tuple[str, ...]) -> list[Task]:
    run = ("run", drive.drive, "-o", drive.workspace, *options)
    if drive.blocks == 1:
        return [Task(f"{drive.name}.all", drive.name, "all", None, run, ())]
    names = [stage.name for stage in STAGES]
    in_blocks = [k for k, stage in enumerate(STAGES) if stage.run_block is not None]
    tasks = [Task(f"{drive.name}.prepare", drive.name, "prepare", None, (*run, "--until", names[in_blocks[0] - 1]), ())]
    for place, following in zip(in_blocks, [*in_blocks[1:], len(STAGES)], strict=True):
        stage, until = names[place], names[following - 1]
        before = tasks[-1].id
        blocks = [
            Task(
                f"{drive.name}.{stage}.{number:04d}",
                drive.name,
                stage,
                number,
                ("run-block", drive.workspace, stage, str(number)),
                (before,),
            )
            for number in range(drive.blocks)
        ]
        tasks += blocks
        ids = tuple(task.id for task in blocks)
        tasks.append(Task(f"{drive.name}.{until}", drive.name, until, None, (*run, "--until", until), ids))
    return tasks

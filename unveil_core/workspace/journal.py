"""Finished outputs are renamed into place under a journal: after ``kill -9`` a workspace holds the old result of a stage or the
new one, with the record that belongs to it, never a mixture.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from unveil_core.base.checks.names import file_name, is_file_name, is_inside
from unveil_core.base.disk.links import refuse_links
from unveil_core.base.disk.open_safely import LARGEST_STATE, read_bytes
from unveil_core.base.disk.rights import keep_rights, rights_of
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import full_disk, move, patiently, read_own_json, write_atomic, write_json_atomic
from unveil_core.workspace.made import half_written, keep_strangers, note_made
from unveil_core.workspace.workspace import Workspace

__all__ = ["PARTIAL", "commit", "open_partial", "recover"]

PARTIAL = ".partial-"
"""How the folders begin in which stages write."""
MEND = "delete it; the stage is run again"
INPUTS = ".inputs"
"""File in such a folder with the digest of what the stage reads: only an attempt with the same may go on from it."""


def commit(workspace: Workspace, stage: str, partial: Path, outputs: Sequence[str], record: dict[str, Any]) -> None:
    """Rename a finished stage's outputs over the old ones and record them; once begun, it is finished at the next start.

    Args:
        partial: folder in the workspace that holds the new outputs.
        outputs: files and folders, relative to the workspace.
        record: entries of the stage in workspace.json.
    Raises:
        WorkspaceError: the lock is not held any more; nothing is changed then.
    """
    if workspace.held is not None:
        workspace.held.check()
    note = note_made(partial, stage, outputs)
    made = [partial / name for name in outputs]
    keep_rights((path for path in made if path.exists()), _rights(workspace, partial))
    entry = {"stage": stage, "partial": partial.name, "outputs": [*outputs, note], "record": record}
    write_json_atomic(_journal(workspace), entry)
    _finish(workspace, entry)


def _rights(workspace: Workspace, partial: Path) -> int:
    """Of the photographs, which a stage's results show."""
    drive = partial / "drive" if (partial / "drive").is_dir() else workspace.drive_dir
    return rights_of(drive / name for name in ("images", "footage"))


def recover(workspace: Workspace) -> None:
    """Finish an interrupted commit, and throw away what no stage can go on from.

    Raises:
        WorkspaceError: the journal is damaged, or names something outside the workspace; the workspace holds a symbolic link, or
            is one of another version, of which nothing is changed.
    """
    workspace.state()
    refuse_links(workspace.root)
    path = _journal(workspace)
    if path.is_file():
        entry: Any = _read(path)
        if not _is_sound(entry):
            raise WorkspaceError("Not a journal of this program", path=path, mend=MEND)
        try:
            _finish(workspace, entry)
        except OSError as error:
            if full_disk(error, path) is not None:
                raise
            raise WorkspaceError(f"asks for what cannot be done: {error.strerror}", path=path, mend=MEND) from error
    for stage in workspace.state()["stages"]:
        folder = workspace.root / f"{PARTIAL}{stage}"
        if is_file_name(stage) and not (folder / INPUTS).is_file():
            shutil.rmtree(folder, ignore_errors=True)
    for file in half_written(workspace.root):
        file.unlink()
    workspace.end_cut_event()


def open_partial(workspace: Workspace, stage: str, input_hash: str) -> Path:
    """The folder that a stage writes in: with all that an interrupted attempt with the same inputs left there, else empty."""
    partial = workspace.root / f"{PARTIAL}{stage}"
    mark = partial / INPUTS
    if mark.is_file() and read_bytes(mark, LARGEST_STATE, links=False) == input_hash.encode():
        return partial
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir()
    try:
        write_atomic(mark, lambda stream: stream.write(input_hash.encode()))
    except OSError:
        shutil.rmtree(partial, ignore_errors=True)
        raise
    return partial


def _read(path: Path) -> Any:
    try:
        return read_own_json(path)
    except (OSError, ValueError) as error:
        raise WorkspaceError(f"Not a journal of this program: {error}", path=path, mend=MEND) from error


def _journal(workspace: Workspace) -> Path:
    return workspace.root / ".journal.json"


def _finish(workspace: Workspace, entry: dict[str, Any]) -> None:
    partial = workspace.root / entry["partial"]
    recorded = workspace.state()["stages"].get(entry["stage"], {})
    for name in entry["outputs"]:
        source, target = partial / name, workspace.root / name
        if not source.exists():
            continue  # moved before the interruption
        target.parent.mkdir(parents=True, exist_ok=True)
        keep_strangers(workspace.root, entry["stage"], name, source, recorded)
        if target.is_dir():
            patiently(shutil.rmtree, target)
        elif source.is_dir():
            target.unlink(missing_ok=True)
        move(source, target)
    # What is recorded replaces the entry: nothing of the result before it may stay.
    workspace.replace_stage(entry["stage"], entry["record"])
    shutil.rmtree(partial, ignore_errors=True)
    with suppress(FileNotFoundError):
        _journal(workspace).unlink()


def _is_sound(entry: Any) -> bool:
    """Whether an entry is what :func:`commit` writes: a workspace may come from a stranger, and recovery removes folders."""
    if (
        not isinstance(entry, dict)
        or not isinstance(entry.get("record"), dict)
        or not isinstance(entry.get("stage"), str)
    ):
        return False
    partial, outputs = entry.get("partial"), entry.get("outputs")
    if not isinstance(partial, str) or not partial.startswith(PARTIAL) or "/" in partial or "\\" in partial:
        return False
    if not file_name(partial[len(PARTIAL) :], "") == partial[len(PARTIAL) :] != "" or not _is_json(entry):
        return False
    return isinstance(outputs, list) and all(map(is_inside, outputs))


def _is_json(entry: Any) -> bool:
    """Whether it can be written again: Python reads NaN and infinity, which JSON does not have."""
    try:
        json.dumps(entry, allow_nan=False).encode()
    except ValueError:
        return False
    return True

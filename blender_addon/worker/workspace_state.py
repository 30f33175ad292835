# SPDX-License-Identifier: GPL-3.0-or-later
"""How the stages of a workspace stand, read from its workspace.json. No bpy here.

This is quick enough for every redraw and sees changed settings at once. What has changed outside, in the drive's files
say, only ``unveil status`` can tell, which digests them; a run finds out by itself in any case.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from ..formats.open_safely import LARGEST_SCENE, LARGEST_STATE, json_in, open_file
from ..formats.table.run_settings import of_stage

__all__ = ["SOLVING", "STAGES", "StageState", "WorkspaceState", "read", "stages_of"]

STAGES = {
    "import": "Import",
    "objects": "Find Objects",
    "segment": "Labels, Motion",
    "choose": "Choose",
    "reconstruct": "Reconstruct",
    "ground": "Ground",
    "instances": "Objects in 3D",
    "remove": "Remove",
    "inpaint": "Inpaint",
    "reoptimize": "Re-optimize",
    "deliver": "Deliver",
    "mesh": "Mesh",
    "report": "Report",
}
"""Names for people by verb, in the order of their dependence."""


SOLVING = {
    "decode": "Decode",
    "look": "Look at Frames",
    "features": "Find Features",
    "match": "Match Frames",
    "map": "Find Cameras",
    "rest": "Place the Rest",
    "points": "Points",
}
"""Names for people of the steps of ``unveil solve``, likewise."""


def stages_of(verb: str) -> tuple[str, ...]:
    """The stages that a verb of ``unveil`` goes through, in order; none of a verb that tells of none."""
    if verb == "run":
        return tuple(STAGES)
    if verb == "import":
        return ("import", "objects")
    if verb == "solve":
        return tuple(SOLVING)
    return (verb,) if verb in STAGES else ()


@dataclass(frozen=True)
class StageState:
    """Attributes:
    name: the verb.
    state: "to do", "running", "done", "stale" or "failed".
    seconds: that it took, where it is done.
    message: why it failed, or that it was broken off, in one line.
    changed: settings that are not those that it was made with.
    """

    name: str
    state: str
    seconds: float | None = None
    message: str = ""
    changed: tuple[str, ...] = ()


@dataclass(frozen=True)
class WorkspaceState:
    """Attributes:
    root: the folder.
    exists: whether there is a workspace.
    problem: one line if there is none, or it is damaged.
    drive: what was imported.
    stages: by name, in order.
    """

    root: Path
    exists: bool
    problem: str = ""
    drive: str = ""
    stages: dict[str, StageState] = field(default_factory=dict)


def read(root: str | Path, wanted: Mapping[str, object] | None = None) -> WorkspaceState:
    """Read the states.

    Args:
        root: the workspace.
        wanted: settings that a run would have, under their names in workspace.json; what was made with others is stale.
            Names that are not in it are not compared.
    """
    root = Path(root)
    try:
        data = json_in(root / "workspace.json")
        recorded = {str(name): _entry(entry) for name, entry in data.get("stages", {}).items()}
    except FileNotFoundError:
        return _none(root, "No results yet")
    except OSError as error:
        return _none(root, f"{root}: Not readable: {error.strerror}")
    except (ValueError, AttributeError, TypeError, RecursionError):
        return _none(root, f"{root / 'workspace.json'}: Damaged (run again into a new folder)")
    # Asked for only where it matters: whoever looks holds the lock himself for a moment.
    in_use = any(entry.get("status") == "running" for entry in recorded.values()) and _in_use(root)
    stages: dict[str, StageState] = {}
    for name in STAGES:
        entry, here = recorded.get(name, {}), of_stage(name, wanted or {})
        made_with = _chosen(root, here) if name == "choose" else {}
        state = _state({**entry, "settings": {**(entry.get("settings") or {}), **made_with}}, here, in_use)
        if state == "done" and not _follows(entry, recorded, stages):
            state = "stale"
        message = _why_failed(root, name) if state == "failed" else ""
        if state in ("to do", "stale") and entry.get("status") == "running":
            message = "was broken off; Unveil goes on from here"
        changed = _changed({**(entry.get("settings") or {}), **made_with}, here) if state == "stale" else ()
        seconds = _seconds(entry.get("seconds")) if state == "done" else None
        stages[name] = StageState(name, state, seconds, message, changed)
    return WorkspaceState(root, True, drive=str(data.get("drive", "")), stages=stages)


def _entry(entry: object) -> dict:  # type: ignore[type-arg]
    if not isinstance(entry, dict) or not isinstance(entry.get("settings") or {}, dict):
        raise TypeError("a stage is no object")
    return entry


def _seconds(value: object) -> float | None:
    """A time that a file tells, None where it is none."""
    plain = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e9
    return float(value) if plain else None  # type: ignore[arg-type]


def _none(root: Path, problem: str) -> WorkspaceState:
    return WorkspaceState(root, False, problem, stages={name: StageState(name, "to do") for name in STAGES})


def _state(entry: Mapping[str, object], wanted: Mapping[str, object], in_use: bool) -> str:
    """A stage's state by its entry alone. A cancelled, killed or failed attempt leaves the finished result as it was."""
    status = entry.get("status")
    if status == "running" and in_use:
        return "running"
    attempt = entry.get("attempt")
    attempted = attempt.get("settings") if isinstance(attempt, dict) else None
    if status == "failed" and ("input_hash" not in entry or _fits(attempted, wanted)):
        return "failed"
    if "input_hash" not in entry:
        return "to do"
    return "done" if _fits(entry.get("settings"), wanted) else "stale"


def _fits(settings: object, wanted: Mapping[str, object]) -> bool:
    """Whether recorded settings are the wanted ones, as far as both name them."""
    return not isinstance(settings, dict) or all(wanted[k] == v for k, v in settings.items() if k in wanted)


def _changed(settings: Mapping[str, object], wanted: Mapping[str, object]) -> tuple[str, ...]:
    """Names of recorded settings that are not the wanted ones."""
    return tuple(name for name, value in settings.items() if name in wanted and wanted[name] != value)


def _chosen(root: Path, wanted: Mapping[str, object]) -> dict[str, object]:
    """What was chosen in the end, as settings: one choice can be put in several ways, and comes to the same."""
    if not wanted.get("remove") and not wanted.get("instances"):
        return {}  # everything that can be removed: that is one of the ways
    try:
        made = json_in(root / "selection.json")
        found = {"remove": made["removed"], "instances": made["instances"]}
        return {k: wanted.get(k) if set(v) == set(wanted.get(k) or ()) else v for k, v in found.items()}  # type: ignore[call-overload]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}


def _follows(entry: Mapping[str, object], recorded: Mapping[str, dict], stages: Mapping[str, StageState]) -> bool:  # type: ignore[type-arg]
    """Whether the stages that it was made from are up to date, and are what they were then."""
    made_from = entry.get("follows")
    if not isinstance(made_from, dict):
        return True
    return all(
        recorded.get(name, {}).get("input_hash") == digest and (name not in stages or stages[name].state == "done")
        for name, digest in made_from.items()
    )


def _in_use(root: Path) -> bool:
    """Whether a process works there: it holds a lock that goes with it, on a file and, but on Windows, on the folder, which stays
    where a cleaner removes the file."""
    if os.name != "nt":
        with suppress(OSError):  # it cannot be opened: the file may tell
            folder = os.open(root, os.O_RDONLY | os.O_CLOEXEC | getattr(os, "O_DIRECTORY", 0))
            try:
                if _is_locked(folder, in_folder=True):
                    return True
            finally:
                os.close(folder)
    try:
        with open_file(root / ".lock", LARGEST_STATE, os.O_RDWR) as file:
            return _is_locked(file.fileno())
    except OSError:
        return False


def _is_locked(handle: int, *, in_folder: bool = False) -> bool:
    """Whether another process has locked what is open; some file systems have no locks on folders."""
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not in_folder or error.errno in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)
    return False


def _why_failed(root: Path, stage: str) -> str:
    """The latest error of a stage; only the end of the log is read, which may be long."""
    try:
        with open_file(root / "events.jsonl", LARGEST_SCENE) as stream:
            stream.seek(0, os.SEEK_END)
            stream.seek(max(stream.tell() - 65536, 0))
            lines = stream.read().decode("utf-8", "replace").splitlines()
    except OSError:
        return ""
    for line in reversed(lines):
        try:
            event = json.loads(line)
        except (ValueError, RecursionError):
            continue
        if isinstance(event, dict) and event.get("stage") == stage and event.get("level") == "error":
            return next(iter(str(event.get("message") or "").splitlines()), "")
    return ""

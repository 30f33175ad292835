"""The status of a workspace's stages: what a run would do, without doing it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import UnveilError, WorkspaceError
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage
from unveil_core.pipeline.up_to_date import Digests, changed_result, depends_on, input_hash, is_current
from unveil_core.workspace.workspace import Workspace

__all__ = ["StageState", "explained_states", "stage_states", "stages_not_begun"]

CHANGED = "the drive, a file that is read, or the program has changed"


@dataclass(frozen=True)
class StageState:
    """Attributes:
    state: "done" (up to date), "stale" (there, but something that it depends on has changed, or will), "running", "failed", or
        "to do" (also after a cancelled or killed run). What depends on a
        drive that is gone cannot be determined and counts as done.
    why: what a run would make it for, in a few words; empty where it is done or runs.
    """

    state: str
    why: str = ""


def stage_states(
    workspace: Workspace, settings: RunSettings | None = None, drive: Path | None = None
) -> dict[str, str]:
    """State of each stage by name, in the order of their dependence, see :func:`explained_states`."""
    return {name: found.state for name, found in explained_states(workspace, settings, drive).items()}


def explained_states(
    workspace: Workspace,
    settings: RunSettings | None = None,
    drive: Path | None = None,
    stages: Sequence[Stage] = STAGES,
) -> dict[str, StageState]:
    """State of each stage and why it is so, by name, in the order of their dependence; nothing is written.

    Args:
        workspace: where.
        settings: that a run would have; those recorded by default.
        drive: likewise.
        stages: in the order of their dependence.
    """
    recorded = workspace.state()
    settings = settings or RunSettings.from_json(recorded.get("settings", {}))
    drive = Path(str(recorded.get("drive", ""))) if drive is None else drive
    digests = Digests(workspace)
    running = _in_use(workspace)
    states: dict[str, StageState] = {}
    will_change: dict[str, str] = {}
    for stage in stages:
        entry = recorded.get("stages", {}).get(stage.name, {})
        status = entry.get("status")
        if status == "running" and running:
            found = StageState("running")
        else:
            state = _state_at_rest(stage, workspace, settings, drive, digests, entry)
            after = next((name for output, name in will_change.items() if depends_on(stage.inputs, (output,))), "")
            state = "stale" if state == "done" and after else state
            why = ""
            if state == "to do":
                why = "not made yet"
            elif state == "stale":
                why = _changed(stage, entry, settings) or _damaged(stage, workspace, digests)
                why = why or (f"follows {after}" if after else CHANGED)
            if status == "failed" and state != "done":
                state, why = "failed", "failed the last time"
            found = StageState(state, why)
        states[stage.name] = found
        if found.state != "done":
            will_change.update(dict.fromkeys(stage.outputs, stage.name))
    return states


def stages_not_begun(why: str = "not made yet") -> dict[str, StageState]:
    """The states of a workspace that is still to be made."""
    return {stage.name: StageState("to do", why) for stage in STAGES}


def _changed(stage: Stage, entry: dict[str, Any], settings: RunSettings) -> str:
    """The settings that are not those that a stage was made with, as ``quality draft -> high``."""
    before, now = entry.get("settings"), stage.chosen(settings)
    if not isinstance(before, dict):
        return ""
    pairs = ((name, before[name], now[name]) for name in stage.settings if name in before and before[name] != now[name])
    return ", ".join(f"{name} {_word(old)} -> {_word(new)}" for name, old, new in pairs)


def _damaged(stage: Stage, workspace: Workspace, digests: Digests) -> str:
    """The file of a stage's result that is another one than the stage wrote."""
    path = changed_result(stage.name, workspace, digests)
    if path is None:
        return ""
    return f"{path.relative_to(workspace.root).as_posix()} {'was changed since' if path.is_file() else 'is gone'}"


def _word(value: object) -> str:
    if value in (None, [], ()):
        return "auto"
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _state_at_rest(
    stage: Stage, workspace: Workspace, settings: RunSettings, drive: Path, digests: Digests, entry: dict[str, Any]
) -> str:
    """ "done", "stale" or "to do", by what lies there, whatever became of later attempts."""
    if "input_hash" not in entry or not all((workspace.root / n).exists() for n in stage.outputs):
        return "to do"
    try:
        wanted = input_hash(stage, workspace, settings, drive, digests)
    except UnveilError:
        return "done"
    return "done" if is_current(stage, workspace, entry, wanted, digests) else "stale"


def _in_use(workspace: Workspace) -> bool:
    try:
        with workspace.lock():
            return False
    except WorkspaceError:
        return True
    except OSError:  # where nothing can be written no run is active
        return False

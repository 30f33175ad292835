"""The status of a workspace's stages: what a run would do, without doing it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unveil_core.base.errors import UnveilError, WorkspaceError
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage
from unveil_core.pipeline.up_to_date import Digests, depends_on, input_hash, is_current
from unveil_core.workspace.workspace import Workspace

__all__ = ["stage_states"]


def stage_states(workspace: Workspace, settings: RunSettings | None = None) -> dict[str, str]:
    """State of each stage, in the order of their dependence; nothing is written.

    Args:
        workspace: where.
        settings: that a run would have; those recorded by default.
    Returns:
        by name of the stage: "done" (up to date), "stale" (there, but something that it depends on has changed, or will),
        "running", "failed", or "to do" (also after a cancelled or killed run). What depends on a drive that is gone
        cannot be determined and counts as done.
    """
    recorded = workspace.state()
    settings = settings or RunSettings.from_json(recorded.get("settings", {}))
    drive = Path(str(recorded.get("drive", "")))
    digests = Digests(workspace)
    running = _in_use(workspace)
    states: dict[str, str] = {}
    will_change: set[str] = set()
    for stage in STAGES:
        entry = recorded.get("stages", {}).get(stage.name, {})
        status = entry.get("status")
        if status == "running" and running:
            state = "running"
        else:
            state = _state_at_rest(stage, workspace, settings, drive, digests, entry)
            if state == "done" and depends_on(stage.inputs, will_change):
                state = "stale"
            if status == "failed" and state != "done":
                state = "failed"
        states[stage.name] = state
        if state != "done":
            will_change.update(stage.outputs)
    return states


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
    return "done" if is_current(stage, workspace, entry, wanted) else "stale"


def _in_use(workspace: Workspace) -> bool:
    try:
        with workspace.lock():
            return False
    except WorkspaceError:
        return True
    except OSError:  # where nothing can be written no run is active
        return False

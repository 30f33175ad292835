"""How the stages of a workspace stand: what a run would do, without doing it."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import UnveilError, WorkspaceError
from unveil_core.pipeline.digests import Digests, input_hash
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.runner import depends_on
from unveil_core.pipeline.settings import RunSettings
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
        cannot be told and counts as done.
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
        there = all((workspace.root / n).exists() for n in stage.outputs) and "input_hash" in entry
        if entry.get("status") == "running" and running:
            state = "running"
        elif entry.get("status") == "failed":
            state = "failed"
        elif not there:
            state = "to do"
        elif entry.get("status") != "done" or depends_on(stage.inputs + stage.optional, will_change):
            state = "stale"
        else:
            try:
                state = (
                    "done" if entry["input_hash"] == input_hash(stage, workspace, settings, drive, digests) else "stale"
                )
            except UnveilError:
                state = "done"
        states[stage.name] = state
        if state != "done":
            will_change.update(stage.outputs)
    return states


def _in_use(workspace: Workspace) -> bool:
    try:
        with workspace.lock():
            return False
    except WorkspaceError:
        return True
    except OSError:  # where nothing can be written nobody works
        return False

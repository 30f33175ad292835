# SPDX-License-Identifier: GPL-3.0-or-later
"""How the stages of a scene's workspace stand, for the panel: drawing it touches no disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy

from ..choice import fixes, marks, selection
from ..scene import versions
from ..worker import workspace_state
from ..worker.run_arguments import recorded, selection_arguments
from ..worker.states_watch import StatesWatch
from ..worker.workspace_state import WorkspaceState
from .job.redrawing import redraw
from .operators_run import workspace_of

__all__ = ["stage_states"]

LOOK_S = 0.1
UNKNOWN = "?"


def stage_states(scene: bpy.types.Scene) -> WorkspaceState | None:
    """How the stages stand with the scene's settings; None without a workspace, or as long as it was not read."""
    root = workspace_of(scene)
    if root is None:
        return None
    chosen = selection.chosen_arguments(scene)
    marked = selection.marked_file(scene) or UNKNOWN
    files = ["--marked", marked, "--corrections", fixes.file_of(scene) or "none"]
    wanted = recorded(scene.unveil, selection_arguments([*chosen, *files]), bpy.path.abspath)
    windows = versions.has_window()
    found = _watch.latest(root, wanted, wait=not windows)
    if windows and _watch.pending and not bpy.app.timers.is_registered(_arrived):
        bpy.app.timers.register(_arrived, first_interval=LOOK_S, persistent=True)
    return found


def _read(root: Path, wanted: Mapping[str, object]) -> WorkspaceState:
    if wanted.get("marked") == UNKNOWN:  # marks were there once: the run goes on naming their file
        path = root / marks.FILE
        wanted = {**wanted, "marked": str(path) if path.is_file() else None}
    return workspace_state.read(root, wanted)


_watch = StatesWatch(_read)


def _arrived() -> float | None:
    """What Blender's timer calls as long as states are being read."""
    if _watch.pending:
        return LOOK_S
    if _watch.changed:
        redraw(bpy.context)
    return None


def unregister() -> None:
    _watch.forget()
    if bpy.app.timers.is_registered(_arrived):
        bpy.app.timers.unregister(_arrived)

# SPDX-License-Identifier: GPL-3.0-or-later
"""How the work stands, in words, and the one button that leads on: import, choose, unveil, check, deliver."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy

from ..choice import selection
from ..choice.fixing.operators_doubts import was_looked_through
from ..scene import view
from ..scene.images import compositing
from ..work.stage_states import stage_states
from ..worker.workspace_state import STAGES, WorkspaceState
from .telling import python_state

__all__ = ["Step", "next_step", "stale_stages"]

WORK = tuple(name for name in STAGES if name not in ("import", "report"))
"""Stages of a run that make what an artist waits for."""
NEED_PYTHON = ("unveil.open_drive", "unveil.import_drive", "unveil.run", "unveil.plates", "unveil.outline_object")


@dataclass(frozen=True)
class Step:
    """Attributes:
    said: how it stands; icon: of that.
    operator: of the button; text: on it; sign: its icon; options: for the operator.
    """

    said: str
    icon: str
    operator: str
    text: str
    sign: str = "NONE"
    options: dict[str, Any] = field(default_factory=dict)


def next_step(context: bpy.types.Context) -> Step:
    """What an artist does next. Touches no disk."""
    step = _step(context.scene)
    if step.operator in NEED_PYTHON and python_state.is_missing(context):
        return Step("Unveil Needs Its Python (2 GB)", "ERROR", "unveil.show_preferences", "Install…", "IMPORT")
    return step


def _step(scene: bpy.types.Scene) -> Step:
    collection = view.shown_drive(scene)
    if collection is None and not selection.current(scene):
        if scene.unveil.drive:
            return Step("Drive Chosen", "FILE_FOLDER", "unveil.import_drive", "Import", "IMPORT")
        return Step("Nothing Imported Yet", "INFO", "unveil.open_drive", "Import Street Drive…", "IMPORT")
    if collection is None:
        return Step("Not in This Scene", "INFO", "unveil.load_workspace", "Bring It Back", "FILE_REFRESH")
    if selection.problem(scene):
        if selection.lists_nothing(scene):
            return Step(
                "No Labelled Objects", "INFO", "unveil.outline_object", "Outline by Clicks", "RESTRICT_SELECT_OFF"
            )
        said = "Nothing Chosen Yet"
        return Step(said, "INFO", "unveil.choose", "Choose Vehicles and People", "CHECKMARK", {"which": "MOVABLE"})
    if not collection.get("unveil_clean"):
        return Step("Ready to Unveil", "CHECKMARK", "unveil.run", "Unveil", "PLAY")
    changed = stale_stages(stage_states(scene))
    if changed:
        said = f"Changed Since: {STAGES[changed[0]]}" + (f" + {len(changed) - 1}" if len(changed) > 1 else "")
        return Step(said, "FILE_REFRESH", "unveil.run", "Unveil Again", "PLAY")
    if not was_looked_through(collection):
        return Step("Empty Street Ready", "CHECKMARK", "unveil.next_doubtful", "Check Doubtful Frames", "VIEWZOOM")
    if not any(compositing.group_of(scene, str(c["unveil_track"])) for c in compositing.tracks_of(scene)):
        return Step("Checked", "CHECKMARK", "unveil.plates", "Write Plates", "NODE_COMPOSITING")
    if not collection.get(view.CG):
        return Step("Plates Written", "CHECKMARK", "unveil.set_up_cg", "Set Up for CG", "RENDER_STILL")
    return Step("Ready to Render", "CHECKMARK", "render.render", "Render Frame", "RENDER_STILL")


def stale_stages(found: WorkspaceState | None) -> list[str]:
    """Stages whose results are older than what was chosen and set."""
    return (
        [] if found is None else [name for name in WORK if name in found.stages and found.stages[name].state == "stale"]
    )

"""The states of a scene that a workspace may hold: without what was removed, with everything, and as somebody edited it."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.workspace.workspace import Workspace

__all__ = ["SCENE_STATES", "check_scene_state", "scene_file"]

SCENE_STATES = ("empty", "full", "edited")
"""The first is meant where nobody says."""
_MENDS = {
    "empty": "run `unveil reoptimize`",
    "full": "run `unveil reconstruct`",
    "edited": "edit the Gaussians in Blender 5.3, and press Keep Edited Gaussians",
}


def check_scene_state(state: str) -> None:
    """Check that there is such a state.

    Raises:
        SettingsError: there is none.
    """
    if state not in SCENE_STATES:
        raise SettingsError(f"Not a state: {state}", mend=f"use {', '.join(SCENE_STATES)}")


def scene_file(workspace: Workspace, state: str) -> Path:
    """The surfels of a state.

    Raises:
        SettingsError: there is no such state. WorkspaceError: the workspace does not hold it yet.
    """
    check_scene_state(state)
    path = {
        "empty": workspace.surfels_empty,
        "full": workspace.surfels_full,
        "edited": workspace.root / "surfels/edited.ply",
    }[state]
    if not path.is_file():
        raise WorkspaceError(f"Not made yet: the {state} scene", path=path, mend=_MENDS[state])
    return path

"""A workspace keeps the drive that it was made from: another one would replace, in time, all that is there."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import WorkspaceError
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.up_to_date import Digests, input_hash
from unveil_core.workspace.workspace import Workspace

__all__ = ["check_same_drive"]


def check_same_drive(workspace: Workspace, drive: Path) -> None:
    """Check that a drive is the one that a workspace was made from, or has the same files in another place.

    Raises:
        WorkspaceError: the workspace has results of another one.
    """
    state = workspace.state()
    recorded = str(state.get("drive", ""))
    imported = state["stages"].get("import", {})
    if "input_hash" not in imported or _place_of(Path(recorded)) == _place_of(drive):
        return
    known = {**state.get("settings", {}), **(imported.get("settings") or {})}
    moved = input_hash(STAGES[0], workspace, RunSettings.from_json(known), drive, Digests(workspace))
    if moved != imported["input_hash"]:
        raise WorkspaceError(
            f"has results of another drive, {recorded}",
            path=workspace.root,
            mend="name another folder with -o, or add --replace to have them replaced",
        )


def _place_of(drive: Path) -> Path:
    """The same for a folder and the transforms.json in it."""
    found = drive.resolve()
    return found.parent if found.name == "transforms.json" else found

"""A workspace keeps the drive that it was made from: another one would replace, in time, all that is there."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.disk.open_safely import read_bytes
from unveil_core.base.errors import DriveError, WorkspaceError
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.imported import read_imported
from unveil_core.workspace.workspace import Workspace

__all__ = ["check_same_drive", "place_of"]

LOOKED_AT = 3
"""Photographs that are compared: the first, the last and one between."""


def check_same_drive(workspace: Workspace, place: Path, drive: Drive) -> None:
    """Check that a drive is the one that a workspace was made from, or has been moved since: the one is no longer there, and the
    other has the same photographs.

    Args:
        place: of the drive, as the user named it; drive: as read from there.
    Raises:
        WorkspaceError: the workspace has results of another one.
    """
    state = workspace.state()
    recorded = str(state.get("drive", ""))
    if "input_hash" not in state["stages"].get("import", {}) or place_of(Path(recorded)) == place_of(place):
        return
    if Path(recorded).exists() or not _same_photographs(workspace, drive):
        raise WorkspaceError(
            f"has results of another drive, {recorded}",
            path=workspace.root,
            mend="name another folder with -o, or add --replace to have them replaced",
        )


def place_of(drive: Path) -> Path:
    """Where a drive lies: the same for a folder and the transforms.json in it."""
    found = drive.resolve()
    return found.parent if found.name == "transforms.json" else found


def _same_photographs(workspace: Workspace, drive: Drive) -> bool:
    """Whether frames of one name have the same file, as they have where a drive was moved, or other frames of it are chosen."""
    try:
        imported = {(f.camera_name, f.name): f for f in read_imported(workspace.drive_dir, points=False).frames}
        both = [(f, imported[f.camera_name, f.name]) for f in drive.frames if (f.camera_name, f.name) in imported]
        chosen = {k * (len(both) - 1) // (LOOKED_AT - 1) for k in range(LOOKED_AT)} if both else set()
        return bool(both) and all(_photograph(both[k][0]) == _photograph(both[k][1]) for k in chosen)
    except (DriveError, OSError):
        return False


def _photograph(frame: Frame) -> bytes:
    """The file of a frame as read, or of an imported one as it came."""
    if frame.image_bytes is not None:
        return frame.image_bytes()
    return read_bytes(frame.footage_path)

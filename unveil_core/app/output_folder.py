"""Folders that a verb writes to beside a workspace's own."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.graph import STAGES
from unveil_core.workspace.output_place import check_file_place, check_place
from unveil_core.workspace.workspace import Workspace

__all__ = ["check_output_folder", "drives_of"]


def check_output_folder(
    workspace: Workspace, output: Path, *, may_be_root: bool = False, for_file: Path | None = None
) -> None:
    """Refuse what is no folder of the user's own: what stages write is theirs, and running them again would take it away.

    Args:
        may_be_root: for a single file in the folder, which may lie in the workspace itself; that the folder is a file is then told
            when it is written, with the name of the file.
        for_file: that file: it may lie beside a drive, a folder of results may not hold one.
    Raises:
        SettingsError: it is a file, or the workspace's; or see :func:`check_place`.
    """
    if output.exists() and not output.is_dir():
        if may_be_root:
            return
        raise SettingsError("is a file", path=output, mend="name a folder")
    root, target = workspace.root.resolve(), output.resolve()
    taken = {Path(name).parts[0] for stage in STAGES for name in stage.outputs}
    if (target == root and not may_be_root) or any(target.is_relative_to(root / name) for name in taken):
        raise SettingsError("is the workspace's own folder", path=output, mend="name another one")
    if for_file is None:
        check_place(output, drives_of(workspace))
    else:
        check_file_place(for_file, drives_of(workspace))


def drives_of(workspace: Workspace) -> list[Path]:
    """The drive that a workspace was made from, where it says so."""
    recorded = workspace.state().get("drive")
    return [Path(recorded)] if isinstance(recorded, str) and Path(recorded).is_absolute() else []

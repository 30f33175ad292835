"""Folders that a verb writes to beside a workspace's own."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.graph import STAGES
from unveil_core.workspace.workspace import Workspace

__all__ = ["check_output_folder"]


def check_output_folder(workspace: Workspace, output: Path, *, may_be_root: bool = False) -> None:
    """Refuse what is no folder of the user's own: what stages write is theirs, and running them again would take it away.

    Args:
        may_be_root: for a single file in the folder, which may lie in the workspace itself; that the folder is a file is then told
            when it is written, with the name of the file.
    Raises:
        SettingsError: it is a file, or the workspace's.
    """
    if output.exists() and not output.is_dir():
        if may_be_root:
            return
        raise SettingsError("is a file", path=output, mend="name a folder")
    root, target = workspace.root.resolve(), output.resolve()
    taken = {Path(name).parts[0] for stage in STAGES for name in stage.outputs}
    if (target == root and not may_be_root) or any(target.is_relative_to(root / name) for name in taken):
        raise SettingsError("is the workspace's own folder", path=output, mend="name another one")

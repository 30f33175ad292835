"""Files of hand-marked objects that stages read: the list itself and its mattes."""

from __future__ import annotations

from pathlib import Path

from unveil_core.drives.marked import files_named, read_marked
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

__all__ = ["files_of_marked"]


def files_of_marked(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """See ``Stage.outside``; nothing where the settings name no file."""
    if settings.marked is None:
        return []
    path = Path(settings.marked)
    pictures = [p for m in read_marked(path) if m.mattes is not None for p in files_named(m.mattes)]
    return [(p.name, p) for p in (path, *pictures)]

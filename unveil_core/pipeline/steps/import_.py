"""Stage ``import``: the drive in one layout, undistorted, in metres, at the working size."""

from __future__ import annotations

from pathlib import Path

from unveil_core.drives import open_drive
from unveil_core.drives.importing import import_drive
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Facts, Stage, StageContext
from unveil_core.workspace.workspace import Workspace

__all__ = ["STAGE"]

WORKING_SIZE_PX = {"draft": 512, "standard": 768, "high": 1600}
"""Longer image side that larger images are reduced to, pixels."""


def run(context: StageContext) -> Facts:
    """drive/: undistorted, in metres with z up."""
    settings = context.settings
    side = settings.max_side or WORKING_SIZE_PX[settings.quality]
    drive = open_drive(context.drive)
    placement = place_drive(drive, scale=settings.scale, up=settings.up)
    import_drive(drive, context.output("drive"), max_side=side, placement=placement, progress=context.progress)
    return placement.to_json()


def files_of_drive(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    """Everything that a drive consists of. Where it lies counts too: the workspace refers to its ground truth."""
    opened = open_drive(drive)
    files = [*opened.sources]
    for f in opened.frames:
        files += [p for p in (f.image_path, f.semantic_path, f.instance_path, f.mask_path) if p is not None]
    return [(str(path), path) for path in files]


STAGE = Stage("import", run, (), ("drive",), ("max_side", "quality", "scale", "up"), outside=files_of_drive)

"""Stage ``import``: the drive in one layout, undistorted, recentred, at the working size."""

from __future__ import annotations

from unveil_core.drives import open_drive
from unveil_core.drives.importing import import_drive
from unveil_core.pipeline.stage import Stage, StageContext

__all__ = ["STAGE"]

MAX_SIDE = {"draft": 512, "standard": 768, "high": 1600}
"""Longer image side that larger images are reduced to, pixels."""


def run(context: StageContext) -> None:
    """drive/: undistorted, recentred."""
    side = context.settings.max_side or MAX_SIDE[context.settings.quality]
    import_drive(open_drive(context.drive), context.output("drive"), max_side=side, progress=context.progress)


STAGE = Stage("import", run, (), ("drive",), ("max_side", "quality"), drive_digest=True)

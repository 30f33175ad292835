# SPDX-License-Identifier: GPL-3.0-or-later
"""A workspace in the scene: its drive, the lists of what can go, and whatever stages have made of it."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..choice import fixes, selection
from ..formats.drive_files import read_drive
from ..formats.files import one_line
from ..scene import blocks, drive_scene, results

__all__ = ["load", "loaded"]


def load(context: bpy.types.Context, workspace: str | Path) -> list[str]:
    """Bring a workspace into the scene, or up to date where it is there.

    Returns:
        what of the results is there, by kind.
    Raises:
        ValueError: the workspace holds no imported drive, or a file is damaged; one line that names it.
        OSError: a file cannot be read, or a link not be made.
    """
    scene, progress = context.scene, context.window_manager
    progress.progress_begin(0, 3)  # shown by the pointer: Blender waits for seconds where a drive is big
    try:
        blocks.look_up([str(workspace)])
        drive = read_drive(Path(bpy.path.abspath(str(workspace))), drive_scene.metre_of(scene))
        placed = drive_scene.place(scene, drive)
        progress.progress_update(1)
        selection.fill(scene, drive)  # the artist's marks go into the drive's collection, so that comes first
        fixes.restore(scene, drive)
        if scene.unveil.set_up_scene:
            drive_scene.set_up(context, placed)
        progress.progress_update(2)
        return results.load(context, placed, drive)
    finally:
        progress.progress_end()


def loaded(operator: bpy.types.Operator, context: bpy.types.Context, workspace: str) -> bool:
    """Bring a workspace into the scene; what is wrong with it is reported in one line."""
    try:
        load(context, workspace)
    except (OSError, ValueError) as error:
        operator.report({"ERROR"}, one_line(error, blocks.absolute(workspace)))
        return False
    return True

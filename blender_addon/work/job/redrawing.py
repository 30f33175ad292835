# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws anew what tells of a job: the sidebars, the preferences and the status bar, and nothing more expensive."""

from __future__ import annotations

import bpy

__all__ = ["redraw"]


def redraw(context: bpy.types.Context, *, everything: bool = False) -> None:
    """Draw the sidebars anew.

    Args:
        everything: the views, too, after results were loaded.
    """
    for window in context.window_manager.windows:
        if not window.modal_operators:  # a tool in use writes its keys into the status bar
            with context.temp_override(window=window):
                window.workspace.status_text_set_internal(None)  # which draws it
        for area in window.screen.areas:
            if everything:
                area.tag_redraw()
            elif area.type in ("VIEW_3D", "PREFERENCES"):
                for region in area.regions:
                    if region.type in ("UI", "WINDOW") and (area.type, region.type) != ("VIEW_3D", "WINDOW"):
                        region.tag_redraw()

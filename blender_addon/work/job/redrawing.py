# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws anew what tells of a job: the sidebars and the preferences, and nothing more expensive."""

from __future__ import annotations

import bpy

__all__ = ["redraw"]


def redraw(context: bpy.types.Context, *, everything: bool = False) -> None:
    """Draw the sidebars anew.

    Args:
        everything: the views, too, after results were loaded.
    """
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if everything:
                area.tag_redraw()
            elif area.type in ("VIEW_3D", "PREFERENCES"):
                for region in area.regions:
                    if region.type in ("UI", "WINDOW") and (area.type, region.type) != ("VIEW_3D", "WINDOW"):
                        region.tag_redraw()

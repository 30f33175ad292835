# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab, opened where work begins elsewhere: a new file has the sidebar closed."""

from __future__ import annotations

from functools import partial

import bpy

__all__ = ["TAB", "open_tab", "tab_in_sight"]

TAB = "Unveil"
DRAWN_S = 0.2
"""By then the sidebar was drawn: before, it knows no tabs."""


def open_tab(context: bpy.types.Context) -> None:
    """Open the sidebar of the largest 3D view, with the add-on's tab before all others."""
    screen = context.window.screen if context.window is not None else None
    views = [area for area in (screen.areas if screen is not None else ()) if area.type == "VIEW_3D"]
    if not views:
        return
    view = max(views, key=lambda area: area.width * area.height)
    view.spaces.active.show_region_ui = True
    bpy.app.timers.register(partial(_choose, views.index(view)), first_interval=DRAWN_S)


def _choose(index: int) -> None:
    """By its place: an area that is gone must not be touched."""
    windows = bpy.context.window_manager.windows
    views = [area for area in (windows[0].screen.areas if windows else ()) if area.type == "VIEW_3D"]
    for region in views[index].regions if index < len(views) else ():
        if region.type == "UI":
            try:
                region.active_panel_category = TAB
            except TypeError:  # it has no such tab yet
                return
            region.tag_redraw()


def tab_in_sight() -> bool:
    """Whether a 3D view shows the add-on's tab: its first section tells what a job tells."""
    areas = (area for window in bpy.context.window_manager.windows for area in window.screen.areas)
    sidebars = (
        region
        for area in areas
        if area.type == "VIEW_3D" and area.spaces.active.show_region_ui
        for region in area.regions
        if region.type == "UI"
    )
    return any(getattr(region, "active_panel_category", "") == TAB for region in sidebars)

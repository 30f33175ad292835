# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's tab: one panel a section, in the order of work. Each section is a subclass of :class:`Section` in its owner's file.

====  ========  =====================================================
0     (none)    how it stands, the next step, progress
1     Shot      footage, cameras
2     Remove    what goes
3     Unveil    settings of the run
4     Look      before and after, what is shown
5     Fix       frames by doubt, painting
6     Output    plates, clip, mesh, the compositor, CG
====  ========  =====================================================
"""

from __future__ import annotations

from typing import Any

__all__ = ["Section", "is_narrow", "split"]

NARROW_PX = 300
"""Of a sidebar at which every label is drawn as large as Blender does by default; its own width is 255."""


class Section:
    """What the panels share; ``bl_order`` is the number above."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Unveil"


def split(layout: Any) -> Any:
    """A column whose properties have their names to the left, as Blender's own panels have them."""
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    return column


def is_narrow(context: Any) -> bool:
    """Whether the sidebar has room for little beside a name."""
    region = context.region
    return region is not None and 0 < region.width < NARROW_PX * context.preferences.system.ui_scale

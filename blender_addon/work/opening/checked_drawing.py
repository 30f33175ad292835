# SPDX-License-Identifier: GPL-3.0-or-later
"""What a check told of a drive, drawn."""

from __future__ import annotations

import textwrap
from pathlib import Path

import bpy

from ... import __package__ as ADDON  # not this folder: Blender knows the add-on by the package above
from .checked import Checked

__all__ = ["draw_checked"]

CHARACTERS = 78
"""Of a line of the dialog."""


def draw_checked(layout: bpy.types.UILayout, found: Checked | None, drive: str) -> None:
    """What a check told of a drive.

    Args:
        found: None where none was made.
    """
    box = layout.box()
    box.label(text=drive, icon="FILE_FOLDER", translate=False)
    if found is None:
        return
    if found.error:
        column = box.column(align=True)
        column.alert = True
        for i, line in enumerate(_wrapped(found.error)):
            column.label(text=line, icon="BLANK1" if i else "ERROR", translate=False)
        if found.lacks_python:
            button = box.operator("preferences.addon_show", text="Open the Preferences of Unveil", icon="PREFERENCES")
            button.module = ADDON
        return
    column = box.column(align=True)
    for key, value in found.facts:
        row = column.split(factor=0.25)
        row.label(text=key.capitalize())
        row.label(text=value, translate=False)
    column = box.column(align=True)
    for told, icon in ((found.findings, "ERROR"), (found.assumed, "INFO")):
        for text in told:
            for i, line in enumerate(_wrapped(text)):
                column.label(text=line, icon="BLANK1" if i else icon, translate=False)
    if found.page:
        box.operator("wm.url_open", text="Show Path, Points and Labels", icon="URL").url = Path(found.page).as_uri()


def _wrapped(text: str) -> list[str]:
    """Lines that fit: labels do not wrap by themselves."""
    return textwrap.wrap(text, CHARACTERS, break_on_hyphens=False) or [""]

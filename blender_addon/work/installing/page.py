# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of the preferences: whether all is ready, one button that makes it so, and the rest under *Advanced*."""

from __future__ import annotations

import textwrap
from typing import Any

import bpy

from ...worker.interpreter import Found
from ...worker.session import session

__all__ = ["draw", "state_of"]

LICENSES = (
    ("Add-on", "GPL-3.0-or-later"),
    ("Program that it installs", "Apache-2.0"),
)
CHARACTER_PX = 7.5


def state_of(found: Found | None, looking: bool) -> tuple[str, str]:
    """In a few words whether Unveil can work here, and an icon.

    Args:
        found: the Python that has unveil; None where there is none, or none was looked for yet.
        looking: whether it is looked at.
    """
    if session.busy and session.last is not None and session.last.stage == "environment":
        return "Installing…", "SORTTIME"
    if looking:
        return "Looking…", "SORTTIME"
    if found is None:
        return "Not Installed", "ERROR"
    return ("Ready", "CHECKMARK") if found.ok else ("Not Ready", "ERROR")


def draw(layout: Any, chosen: Any, found: Found | None, *, looking: bool, may_install: bool) -> None:
    """All of it.

    Args:
        chosen: the add-on's preferences; the others as :func:`state_of`.
        may_install: whether there is a way to install as things stand.
    """
    if found is not None and not found.ok and not chosen.python and not found.facts.get("unveil"):
        found = None  # any Python of the system: nobody has named it, and it never had unveil
    said, icon = state_of(found, looking)
    layout.label(text=said, icon=icon)
    if session.busy and session.last is not None and session.last.stage == "environment":
        state = session.last
        layout.progress(factor=state.fraction, text=state.message)
        layout.operator("unveil.cancel", icon="CANCEL")
    elif found is None or not found.ok:
        _install(layout, may_install)
    state = session.last
    if state is not None and not state.running and state.stage == "environment" and state.error:
        _lines(layout, state.error, "ERROR")
    if found is not None:
        facts = layout.box().column(align=True)
        lines = [line for line in found.lines() if line != "Ready."]
        for line in lines:
            _lines(facts, line, "ERROR" if line == found.problem else "INFO" if line in found.advice() else "BLANK1")
    elif not looking:
        layout.label(text="The program runs in a Python of its own: 2 GB on disk, more with CUDA", icon="BLANK1")
    if found is not None and found.ok:
        layout.label(text="Where it is: 3D View, sidebar (N), tab Unveil; or File > Import", icon="BLANK1")
    row = layout.row()
    row.operator("unveil.check_python", icon="VIEWZOOM")
    row.operator("unveil.check_for_updates", icon="FILE_REFRESH")
    header, body = layout.panel("unveil_advanced", default_closed=True)
    header.label(text="Advanced")
    if body is not None:
        _advanced(body, chosen, found)


def _install(layout: Any, may_install: bool) -> None:
    row = layout.row()
    row.scale_y = 1.5
    if may_install:
        row.operator("unveil.create_environment", text="Install (2 GB)", icon="IMPORT")
        return
    row.operator("extensions.userpref_allow_online", text="Enable Online Access", icon="INTERNET")
    layout.label(text="Or name a Folder of Wheels under Advanced, to install without a network", icon="BLANK1")


def _advanced(layout: Any, chosen: Any, found: Found | None) -> None:
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    column.prop(chosen, "python")
    if hasattr(chosen, "segmenter"):
        column.prop(chosen, "segmenter")
    column.prop(chosen, "wheels")
    column.prop(chosen, "install_from")
    index = column.row()
    index.enabled = not chosen.wheels.strip()
    index.prop(chosen, "torch_index")
    if found is not None and found.ok:
        column.operator("unveil.create_environment", text="Install Again", icon="IMPORT")
    told = layout.column(align=True)
    for part, license_name in LICENSES:
        row = told.split(factor=0.4)
        row.label(text=part)
        row.label(text=license_name)


def _lines(layout: Any, text: str, icon: str) -> None:
    """A text in as many rows as it takes: labels do not wrap by themselves."""
    context = bpy.context
    width = (context.region.width if context.region is not None else 0) or 500
    characters = max(int(width / (CHARACTER_PX * (context.preferences.system.ui_scale or 1.0))) - 6, 30)
    for i, line in enumerate(textwrap.wrap(text, characters, break_on_hyphens=False) or [""]):
        layout.label(text=line, icon="BLANK1" if i else icon)

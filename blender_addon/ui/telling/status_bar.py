# SPDX-License-Identifier: GPL-3.0-or-later
"""A job in Blender's status bar, whatever is open: its bar, the time left and *Cancel*; at its end what came of it."""

from __future__ import annotations

from typing import Any

import bpy

from ...scene import versions
from ...worker.session import session
from . import progress

__all__ = ["told"]

EVERY_S = 0.5
LONGEST = 90
"""Characters of an outcome: the bar is one line."""
_drawn: object = None
_dismissed: int = 0
"""The job whose outcome was read, by its state."""


def told() -> tuple[str, str]:
    """What the bar says when nothing runs, and its icon; empty where that was read, or nothing has run."""
    state = session.last
    if state is None or session.busy or id(state) == _dismissed:
        return "", ""
    text, icon = progress.outcome(state)
    return (text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"), icon


def dismiss() -> None:
    """Say no more of the latest job."""
    global _dismissed
    _dismissed = id(session.last)


def _draw(self: Any, context: bpy.types.Context) -> None:
    state, job = session.last, session.job
    row = self.layout.row(align=True)
    if session.busy and state is not None and job is not None:
        part = progress.whole(state, session.age_s)
        row.label(text=f"{session.title}: {progress.stage_said(state)}")
        bar = row.row()
        bar.ui_units_x = 7
        bar.progress(factor=part, text=f"{100 * part:.0f} %")
        row.label(text=progress.time_left(state))
        row.operator("unveil.cancel", text="", icon="CANCEL")
        return
    text, icon = told()
    if text:
        row.label(text=text, icon=icon)
        row.operator("unveil.show_report", text="Report")
        row.operator("unveil.dismiss", text="", icon="X")


def _tick() -> float:
    """Draw the bar anew where what it says has changed: nothing else tells Blender of it."""
    global _drawn
    state = session.last
    drawn: object = told()
    if session.busy and state is not None:
        part = progress.whole(state, session.age_s)
        drawn = progress.stage_said(state), round(part, 2), int(state.seconds_left() or 0) // 5
    if drawn != _drawn:
        _drawn = drawn
        for window in bpy.context.window_manager.windows:
            window.workspace.status_text_set_internal(None)
    return EVERY_S


def register() -> None:
    bpy.types.STATUSBAR_HT_header.append(_draw)
    if versions.has_window():
        bpy.app.timers.register(_tick, first_interval=EVERY_S, persistent=True)


def unregister() -> None:
    global _drawn, _dismissed
    _drawn, _dismissed = None, 0
    bpy.types.STATUSBAR_HT_header.remove(_draw)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)

# SPDX-License-Identifier: GPL-3.0-or-later
"""A job in Blender's status bar, whatever is open: its bar, the time left and *Cancel*; at its end what came of it."""

from __future__ import annotations

from typing import Any
from weakref import ref

import bpy

from ..scene import versions
from ..worker.job_state import JobState
from ..worker.session import session
from .telling import progress

__all__ = ["dismiss", "redraw_bars", "status_text", "told"]

EVERY_S = 0.5
WIDTH = 18.0
"""Of the bar, in Blender's units of a button's height."""
LONGEST = 90
"""Characters of an outcome: the bar is one line."""
_drawn: object = None
_dismissed: ref[JobState] | None = None
"""The job whose outcome was read."""


def told() -> tuple[str, str]:
    """What the bar says when nothing runs, and its icon; empty where that was read, or nothing has run."""
    state = session.last
    if state is None or session.busy or (_dismissed is not None and _dismissed() is state):
        return "", ""
    text, icon = progress.outcome(state)
    return (text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"), icon


def dismiss() -> None:
    """Say no more of the latest job."""
    global _dismissed
    _dismissed = None if session.last is None else ref(session.last)


def status_text() -> tuple[float, str]:
    """How far the job is, 0 to 1, and a line: what runs, and how long it still takes."""
    state = session.last
    if state is None:
        return 0.0, session.title
    left = progress.time_left(state)
    last = f"results wait for {session.waiting}" if session.waiting else left
    line = progress.job_said(state)
    return progress.whole(state, session.age_s), "  ·  ".join(part for part in (line, last) if part)


def _draw(self: Any, context: bpy.types.Context) -> None:
    state, job = session.last, session.job
    row = self.layout.row(align=True)
    if job is not None and state is not None:
        part, text = status_text()
        bar = row.row()
        bar.ui_units_x = WIDTH
        bar.progress(factor=part, text=text)
        button = row.row()
        button.enabled = not job.cancelling and state.running
        button.operator("unveil.cancel", text="", icon="CANCEL")
        return
    text, icon = told()
    if text:
        row.label(text=text, icon=icon)
        row.operator("unveil.show_report", text="Report")
        row.operator("unveil.dismiss", text="", icon="X")


def redraw_bars() -> None:
    """Draw the status bar of each window anew.

    Blender draws that of the window in context, and does not ask whether there is one: after a file was opened there is none.
    """
    for window in bpy.context.window_manager.windows:
        with bpy.context.temp_override(window=window):
            window.workspace.status_text_set_internal(None)


def _tick() -> float:
    """Draw the bar anew where what it says has changed: nothing else tells Blender of it."""
    global _drawn
    state = session.last
    drawn: object = told()
    if session.busy and state is not None:
        part, _ = status_text()
        drawn = progress.stage_said(state), round(part, 2), int(state.seconds_left() or 0) // 5, session.waiting
    if drawn != _drawn:
        _drawn = drawn
        redraw_bars()
    return EVERY_S


def register() -> None:
    bpy.types.STATUSBAR_HT_header.prepend(_draw)
    if versions.has_window():
        bpy.app.timers.register(_tick, first_interval=EVERY_S, persistent=True)


def unregister() -> None:
    global _drawn, _dismissed
    _drawn = _dismissed = None
    bpy.types.STATUSBAR_HT_header.remove(_draw)
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)

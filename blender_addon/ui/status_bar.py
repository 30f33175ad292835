# SPDX-License-Identifier: GPL-3.0-or-later
"""A running job in Blender's status bar, which is in sight with the sidebar closed and in any workspace."""

from __future__ import annotations

import bpy

from ..work.job.job_operator import stage_line
from ..worker.job_state import duration
from ..worker.session import session

__all__ = ["status_text"]

WIDTH = 14.0
"""Of the bar, in Blender's units of a button's height."""


def status_text() -> tuple[float, str]:
    """How far the stage is, 0 to 1, and a line: what runs, and how long it still takes."""
    state = session.last
    if state is None:
        return 0.0, session.title
    line = stage_line(state)
    parts = [session.title] if session.title not in (line, "Unveil") else []
    parts.append(line if state.stage else state.message or line)
    left = state.seconds_left()
    if session.waiting:
        parts.append(f"results wait for {session.waiting}")
    elif left is not None:
        parts.append(f"{duration(left)} left")
    return state.fraction, "  ·  ".join(parts)


def _draw(self: bpy.types.Header, context: bpy.types.Context) -> None:
    job, state = session.job, session.last
    if job is None or state is None:
        return
    fraction, text = status_text()
    row = self.layout.row(align=True)
    bar = row.row()
    bar.ui_units_x = WIDTH
    bar.progress(factor=fraction, text=text)
    button = row.row()
    button.enabled = not job.cancelling and state.running
    button.operator("unveil.cancel", text="", icon="CANCEL")


def register() -> None:
    bpy.types.STATUSBAR_HT_header.prepend(_draw)


def unregister() -> None:
    bpy.types.STATUSBAR_HT_header.remove(_draw)

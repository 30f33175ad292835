# SPDX-License-Identifier: GPL-3.0-or-later
"""What ends by itself is told where the artist looks: as Blender's own reports, which need neither sidebar nor preferences."""

from __future__ import annotations

import bpy

from ...scene import versions
from ...worker.job_state import JobState, duration
from ...worker.session import session
from .sidebar import tab_in_sight

__all__ = ["tell", "tell_end"]


def tell(text: str, kind: str = "INFO") -> None:
    """Report a line from a timer, which Blender does not let report by itself.

    Args:
        text: one line.
        kind: "INFO", "WARNING" or "ERROR"; an error pops up.
    """
    windows = bpy.context.window_manager.windows
    if not versions.has_window() or not windows:
        return
    with bpy.context.temp_override(window=windows[0]):
        bpy.ops.unveil.tell("INVOKE_DEFAULT", text=text, kind=kind)


def tell_end(title: str, state: JobState, shown: bool, workspace: str) -> None:
    """How a job ended.

    Args:
        title: of the job; state: once it was concluded.
        shown: whether what it made is in the open file, where it makes anything.
        workspace: that it worked on.
    """
    if state.status == "cancelled":
        tell(f"{title}: cancelled; start it again to go on", "WARNING")
    elif state.status != "done":
        # What pops up lies over the sidebar, where the pointer is, and stays until that leaves it.
        tell(f"{title}: {state.error}", "WARNING" if tab_in_sight() else "ERROR")
    elif shown:
        tell(f"{title}: done in {duration(session.took_s)}")
    else:
        tell(f"{title}: done. Its results are in {workspace}: they load when its file is opened again", "WARNING")

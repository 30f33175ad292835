# SPDX-License-Identifier: GPL-3.0-or-later
"""The log of the latest job as a text block, known by a custom property: its name may change."""

from __future__ import annotations

from typing import Any

import bpy

from ...worker.job_state import JobState

__all__ = ["log_text", "write_log"]

MARK = "unveil_log"


def log_text() -> Any:
    """The text block, or None."""
    return next((text for text in bpy.data.texts if text.get(MARK)), None)


def write_log(state: JobState) -> Any:
    """Put a job's log into the text block, which is made if need be; the cursor goes to its end."""
    text = log_text() or bpy.data.texts.new("Unveil log")
    text[MARK] = True
    text.from_string("\n".join(state.log) + "\n")
    text.cursor_set(max(len(text.lines) - 1, 0))
    return text

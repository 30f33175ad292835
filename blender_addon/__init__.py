# SPDX-License-Identifier: GPL-3.0-or-later
"""Unveil in Blender: a drive in, the empty street out. The heavy work runs in a Python of its own (see ``worker/``).

Importing this package imports nothing else, so that the folders without bpy can be used, and tested, without Blender.
"""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module

__all__ = ["register", "unregister"]

MODULES = (
    "worker.session",
    "scene.settings",
    "scene.view",
    "scene.operators_view",
    "scene.operators_detail",
    "scene.edits.operators_splats",
    "scene.overlays.points",
    "scene.overlays.compared",
    "scene.overlays.drawn_pictures",
    "scene.overlays.wipe_gizmo",
    "scene.cg.operators_cg",
    "choice.fixes",
    "choice.quick.filters",
    "choice.selection",
    "choice.operators_selection",
    "choice.operators_fixes",
    "choice.box_gizmos",
    "choice.quick.operators_quick",
    "choice.fixing.operators_doubts",
    "choice.fixing.operators_clone",
    "choice.fixing.operators_versions",
    "choice.tool",
    "work.preferences",
    "work.job.operators_telling",
    "work.job.following",
    "work.stage_states",
    "work.operators_import",
    "work.opening.operators_open_drive",
    "work.opening.operators_footage",
    "work.operators_shot",
    "work.operators_workspace",
    "work.operators_run",
    "work.operators_preview",
    "work.operators_outline",
    "work.masks.operators_roto",
    "work.masks.operators_paint_mask",
    "work.operators_plates",
    "work.operators_environment",
    "work.saved.handlers",
    "work.command_line",
    "work.delivering.operators_deliver",
    "work.installing.operators_updates",
    "ui.previews",
    "ui.telling.python_state",
    "ui.status_bar",
    "ui.telling.operators_telling",
    "ui.panel_run",
    "ui.panel_drive",
    "ui.panel_selection",
    "ui.panel_masks",
    "ui.panel_results",
    "ui.panel_fixes",
    "ui.panel_output",
    "ui.entries.menu",
    "ui.entries.keymap",
)
"""Whatever is registered stands in one of these, in this order: Blender's classes in ``CLASSES``, all else in ``register()`` and
``unregister()``, either of which may be missing."""

_steps_back = ExitStack()
"""What takes back what was registered, the latest first."""


def register() -> None:
    """Register everything; where one step fails, those before it are taken back."""
    global _steps_back
    import bpy

    with ExitStack() as steps_back:
        for name in MODULES:
            module = import_module(f".{name}", __package__)
            for cls in getattr(module, "CLASSES", ()):
                bpy.utils.register_class(cls)
                steps_back.callback(bpy.utils.unregister_class, cls)
            if hasattr(module, "register"):
                module.register()
            if hasattr(module, "unregister"):
                steps_back.callback(module.unregister)
        _steps_back = steps_back.pop_all()


def unregister() -> None:
    """Take everything back, which also ends a job that still runs."""
    _steps_back.close()

# SPDX-License-Identifier: GPL-3.0-or-later
"""Unveil in Blender: a drive in, the empty street out. The heavy work runs in a Python of its own (see ``jobs``).

Importing this package imports nothing else, so that the modules without bpy can be used, and tested, without Blender.
"""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module

__all__ = ["register", "unregister"]

MODULES = (
    "session",
    "properties",
    "selection",
    "view",
    "operators_view",
    "previews",
    "preferences",
    "operators_import",
    "operators_selection",
    "operators_run",
    "operators_environment",
    "panels",
    "panel_drive",
    "panel_selection",
    "panel_run",
    "panel_results",
    "box_gizmos",
    "handlers",
    "command_line",
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

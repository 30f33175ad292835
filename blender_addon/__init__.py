# SPDX-License-Identifier: GPL-3.0-or-later
"""Unveil in Blender: a drive in, the empty street out. The heavy work runs in a Python of its own (see ``jobs``).

Importing this package imports nothing else, so that the modules without bpy can be used, and tested, without Blender.
"""

from __future__ import annotations

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
    "panel_scene",
    "panel_run",
    "box_gizmos",
    "handlers",
    "command_line",
)
"""Modules with ``register()`` and ``unregister()``, in the order of registration. Nothing but registration happens there."""


def register() -> None:
    """Register all classes; what was registered is taken back when one of them fails."""
    done = []
    try:
        for name in MODULES:
            module = import_module(f".{name}", __package__)
            module.register()
            done.append(module)
    except Exception:
        for module in reversed(done):
            module.unregister()
        raise


def unregister() -> None:
    """The reverse, which also ends a job that still runs."""
    for name in reversed(MODULES):
        import_module(f".{name}", __package__).unregister()

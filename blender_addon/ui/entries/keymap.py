# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys of the 3D view, as the add-on proposes them: the artist changes them in Blender's Keymap preferences."""

from __future__ import annotations

from typing import Any

import bpy

__all__ = ["KEYS"]

KEYS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("unveil.before_after", {"type": "B", "value": "PRESS", "shift": True, "alt": True}),
    ("unveil.next_doubtful", {"type": "N", "value": "PRESS", "shift": True, "alt": True}),
)
"""Operator and key; none of them is taken in Blender's own keymaps."""
_made: list[tuple[Any, Any]] = []


def register() -> None:
    configuration = bpy.context.window_manager.keyconfigs.addon
    if configuration is None:  # without a window
        return
    keymap = configuration.keymaps.new(name="Object Mode", space_type="EMPTY")
    for operator, key in KEYS:
        _made.append((keymap, keymap.keymap_items.new(operator, **key)))


def unregister() -> None:
    while _made:
        keymap, item = _made.pop()
        keymap.keymap_items.remove(item)

# SPDX-License-Identifier: GPL-3.0-or-later
"""What goes, as arguments of the command."""

from __future__ import annotations

from typing import Any

__all__ = ["arguments", "problem"]


def arguments(scene: Any) -> list[str]:
    """Options of ``unveil run`` that say what is removed, as ``["--remove", "car"]``; none: all that can be."""
    return []


def problem(scene: Any) -> str:
    """One line on why nothing can be removed as things stand, or an empty string."""
    return ""


def register() -> None:
    pass


def unregister() -> None:
    pass

# SPDX-License-Identifier: GPL-3.0-or-later
"""Clicks as ``unveil mask`` reads them, and the objects that it made of them. No bpy here."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..formats.open_safely import json_in

__all__ = ["FOLDER", "Outlined", "clicks_text", "is_of_footage", "outlined_in"]

FOLDER = "outlines"
"""Of a workspace, for the mattes of objects that were clicked."""
CLICKS, MARKED = "clicks.json", "marked.json"

Place = tuple[float, float]


@dataclass(frozen=True)
class Outlined:
    """One object: its name, and the folder of its mattes."""

    name: str
    mattes: Path


def clicks_text(name: str, track: str, frame: str, inside: Sequence[Place], outside: Sequence[Place]) -> str:
    """A file of strokes: places are shares of the camera's picture, from its upper left corner."""
    entry = {
        "object": name,
        "frame": f"{track}/{frame}",
        "inside": [list(p) for p in inside],
        "outside": [list(p) for p in outside],
        "of": "camera",
    }
    return json.dumps([entry], indent=1) + "\n"


def outlined_in(folder: Path) -> list[Outlined]:
    """The objects that ``unveil mask`` wrote into a folder, in their order.

    Raises:
        OSError: there are none. ValueError: its file is damaged.
    """
    content: Any = json_in(folder / MARKED)
    try:
        return [Outlined(str(e["class"]), _inside(folder, str(e["mattes"]))) for e in content]
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{folder / MARKED}: is damaged (outline the objects again)") from error


def _inside(folder: Path, name: str) -> Path:
    path = (folder / name).resolve()
    if not path.is_relative_to(folder.resolve()):
        raise ValueError(f"{folder / MARKED}: names a folder elsewhere (outline the objects again)")
    return path


def is_of_footage(mattes: Path) -> bool:
    """Whether mattes are those of ``unveil mask``, which lie over the footage in its lens."""
    return (mattes.parent.parent / CLICKS).is_file() and mattes.parent.name == "mattes"

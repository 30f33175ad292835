# SPDX-License-Identifier: GPL-3.0-or-later
"""The choice that a workspace was made with, in its own words as long as nobody changes it: one choice can be put in several ways.

The files that it names, of marks and corrections, may lie elsewhere; they are read there until something of them is changed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["file_elsewhere", "in_its_words", "remembered"]

LISTS = {"--remove": ("remove", str), "--instances": ("instances", int), "--per-object": ("per_object", str)}


def remembered(words: Sequence[str], recorded: Mapping[str, Any]) -> str:
    """What is to be kept with the scene.

    Args:
        words: the options of the choice as the lists put it.
        recorded: settings of the workspace, from whoever made it.
    Returns:
        JSON, empty where the workspace does not tell.
    """
    own: list[str] = []
    for option, (name, kind) in LISTS.items():
        value = recorded.get(name)
        if not isinstance(value, list) or not all(type(part) is kind for part in value):
            return ""
        own += [option, ",".join(str(part) for part in value)] if value else []
    return json.dumps({"words": list(words), "own": own})


def in_its_words(words: Sequence[str], kept: str) -> list[str]:
    """The options of a choice: those that the workspace has, where the choice is still the same.

    Args:
        kept: by :func:`remembered`.
    """
    try:
        found = json.loads(kept or "{}")
    except (ValueError, RecursionError):
        found = {}
    same = isinstance(found, dict) and found.get("words") == list(words) and isinstance(found.get("own"), list)
    return [str(word) for word in found["own"]] if same else list(words)


def file_elsewhere(workspace: Path, recorded: Mapping[str, Any], name: str) -> str:
    """A file that the workspace was made with and that is not its own; empty where it has its own, or none.

    Args:
        name: of the setting, "marked" or "corrections".
    """
    path = recorded.get(name)
    if not isinstance(path, str) or (workspace / f"{name}.json").exists() or not Path(path).is_file():
        return ""
    return path

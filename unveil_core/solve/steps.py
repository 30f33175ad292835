"""What of a solve is done: a run that goes on does only what is missing or changed."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from unveil_core.base.files import read_own_json, write_json_atomic

__all__ = ["Steps", "facts_of_files"]

VERSION = 1
"""Of what steps leave behind: what another version left is made anew."""


def facts_of_files(paths: list[Path]) -> list[list[Any]]:
    """What tells whether files are the same: names, sizes, times of change."""
    return [[str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns] for p in paths]


class Steps:
    """Steps in a folder, each with what it was made from and what it found, one JSON file a step."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.chain = folder, f"{VERSION}"
        folder.mkdir(parents=True, exist_ok=True)

    def begin(self, name: str, made_from: Any) -> dict[str, Any] | None:
        """What a step found before, where all that it was made from is the same, this and the steps before; else None."""
        told = json.dumps([self.chain, name, made_from], sort_keys=True, default=str)
        self.chain = hashlib.sha256(told.encode()).hexdigest()
        try:
            held = read_own_json(self.folder / f"{name}.json")
        except (OSError, ValueError):
            return None
        if isinstance(held, dict) and held.get("made_from") == self.chain and isinstance(held.get("found"), dict):
            found: dict[str, Any] = held["found"]
            return found
        return None

    def going_on(self, name: str) -> bool:
        """Whether the step that was begun last was begun before from the same, and ended halfway; it counts as begun now."""
        place = self.folder / f"{name}.json"
        try:
            held = read_own_json(place)
            same = isinstance(held, dict) and held.get("made_from") == self.chain
        except (OSError, ValueError):
            same = False
        write_json_atomic(place, {"made_from": self.chain, "found": None})
        return same

    def done(self, name: str, found: dict[str, Any]) -> dict[str, Any]:
        """Keep what the step that was begun last found."""
        write_json_atomic(self.folder / f"{name}.json", {"made_from": self.chain, "found": found})
        return found

"""What of a solve is done: a run that goes on does only what is missing or changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.output.stamps import is_unchanged, stamp_of
from unveil_core.base.output.written import GENERATOR, record_of
from unveil_core.base.output.written import RECORD as MARK

__all__ = ["Steps", "facts_of_files"]

VERSION = 2
"""Of what steps leave behind: what another version left is made anew."""


def facts_of_files(paths: list[Path]) -> list[list[Any]]:
    """What tells whether files are the same: names, sizes, times of change."""
    return [[str(p.resolve()), p.stat().st_size, p.stat().st_mtime_ns] for p in paths]


class Steps:
    """Steps in a folder, each with what it was made from, what it found and which files it left, one JSON file a step."""

    def __init__(self, folder: Path) -> None:
        """Steps in a folder that is empty, not there yet, or of a solve before.

        Raises:
            SettingsError: it is somebody's.
        """
        self.folder, self.chain = folder, f"{VERSION}"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # what is in it shows photographs
        if record_of(folder / MARK) is None:
            if any(folder.iterdir()):
                raise SettingsError(
                    "Not written by Unveil, and so not used",
                    path=folder,
                    mend="move it away, or name another folder with -o",
                )
            write_json_atomic(folder / MARK, {"generator": GENERATOR})

    def begin(self, name: str, made_from: Any) -> dict[str, Any] | None:
        """What a step found before, where all that it was made from is the same, this and the steps before, and the files that it
        left are whole; else None."""
        told = json.dumps([self.chain, name, made_from], sort_keys=True, default=str)
        self.chain = hashlib.sha256(told.encode()).hexdigest()
        try:
            held = read_own_json(self.folder / f"{name}.json")
        except (OSError, ValueError):
            return None
        if not isinstance(held, dict) or held.get("made_from") != self.chain:
            return None
        found, files = held.get("found"), held.get("files")
        if not isinstance(found, dict) or not isinstance(files, dict):
            return None
        whole = all(Path(n).name == n and is_unchanged(self.folder / n, stamp) for n, stamp in files.items())
        return found if whole else None

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

    def done(self, name: str, found: dict[str, Any], files: Sequence[Path] = ()) -> dict[str, Any]:
        """Keep what the step that was begun last found, and how the files are that it left in the folder."""
        stamps = {f.name: stamp_of(f) for f in files}
        write_json_atomic(self.folder / f"{name}.json", {"made_from": self.chain, "found": found, "files": stamps})
        return found

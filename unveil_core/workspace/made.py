"""What stages made in a workspace, by name: a stage's new outputs take the place of its old ones, and of nothing else.

A workspace is a folder in which people work, too: a compositor's script beside the frames, notes in ``report/``. With its outputs
each stage leaves a list of them, ``.made/STAGE.json``. What is not on it is somebody's and stays where it is when the stage runs
again; where a new output has its name, it is put into ``kept/``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

from unveil_core.base.files import move, write_json_atomic
from unveil_core.base.output.written import GENERATOR, files_in, record_of, strangers

__all__ = ["KEPT", "half_written", "keep_strangers", "note_made"]

MADE = ".made"
KEPT = "kept"
"""Folder for what is somebody's and has the name of a new output."""
OWN = r"\.(workspace\.json|\.journal\.json|\.digests\.json|\.exports\.json|metrics\.json)\.[a-z0-9_]{8}\.partial"
"""Temporary names of the files that are written in a workspace itself."""
TEMPORARY = r"\..*\.partial(\.\w+)?|\..*\.npz\.\w+\.new"
"""Those of files in the folders that stages write in: of results, of movies (the suffix tells the format), and of what is kept."""
WRITTEN_IN = (".partial-", ".blocks", MADE)
"""How these folders begin."""


def note_made(partial: Path, stage: str, outputs: Sequence[str]) -> str:
    """List the outputs in the folder that a stage wrote them in; returns the list's own name, an output more."""
    files: list[str] = []
    for name in outputs:
        place = partial / name
        files += [f"{name}/{inside}" for inside in files_in(place)] if place.is_dir() else [name] * place.is_file()
    note = f"{MADE}/{stage}.json"
    write_json_atomic(partial / note, {"generator": GENERATOR, "files": files})
    return note


def keep_strangers(root: Path, stage: str, name: str, source: Path, recorded: Mapping[str, Any]) -> None:
    """Before an output takes the place of what lies there, take out what the stage did not make.

    Args:
        root: of the workspace.
        stage, name: whose output; source: where it lies now, a file or a folder.
        recorded: the stage's entry in workspace.json. Versions before left no list: what they record as an output is all theirs.
    """
    target, note = root / name, record_of(root / MADE / f"{stage}.json")
    if (
        not os.path.lexists(target)
        or name.startswith(f"{MADE}/")
        or (note is None and name in recorded.get("outputs", ()))
    ):
        return
    listed = note.get("files") if note is not None else None
    own = [n for n in listed if isinstance(n, str)] if isinstance(listed, list) else []
    if not target.is_dir():
        if name not in own:
            _put_aside(root, target)
        return
    for stranger in list(strangers(target, [n.removeprefix(f"{name}/") for n in own if n.startswith(f"{name}/")])):
        there = source / stranger.relative_to(target)
        if source.is_dir() and not os.path.lexists(there) and _may_make(there.parent):
            move(stranger, there)
        else:
            _put_aside(root, stranger)


def _may_make(folder: Path) -> bool:
    """Make a folder, unless a file is in its way."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        return False
    return True


def _put_aside(root: Path, path: Path) -> None:
    for number in count(1):
        place = root / (KEPT if number == 1 else f"{KEPT}_{number}") / path.relative_to(root)
        if not os.path.lexists(place) and _may_make(place.parent):
            move(path, place)
            return


def half_written(root: Path) -> Iterator[Path]:
    """Files that a kill left half-written in a workspace: only where the program writes, by the names that it gives."""
    with os.scandir(root) as entries:
        for entry in list(entries):
            if entry.is_dir(follow_symlinks=False) and entry.name.startswith(WRITTEN_IN):
                for place, _, names in os.walk(entry.path):
                    yield from (Path(place, name) for name in names if re.fullmatch(TEMPORARY, name))
            elif re.fullmatch(OWN, entry.name):
                yield Path(entry.path)

"""What stages made in a workspace, by name: a stage's new outputs take the place of its old ones, and of nothing else.

A workspace is a folder in which people work, too: a compositor's script beside the frames, notes in ``report/``. With its outputs
each stage leaves a list of them with their stamps, ``.made/STAGE.json``. What is not on it, or was changed since, is somebody's and
stays where it is when the stage runs again; where a new output has its name, it is put into ``kept/``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

from unveil_core.base.files import move, write_json_atomic
from unveil_core.base.output.stamps import Stamp, is_as_it_was, stamp_of
from unveil_core.base.output.written import GENERATOR, files_in, stamps_in, strangers

__all__ = ["KEPT", "half_written", "keep_strangers", "made_by", "note_made"]

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
    stamps = {name: stamp_of(partial / name) for name in files}
    write_json_atomic(partial / note, {"generator": GENERATOR, "files": stamps})
    return note


def made_by(root: Path, stage: str) -> dict[str, Stamp | None]:
    """The files of a workspace that a stage made, relative to it, each with its stamp; those of older versions have none."""
    return stamps_in(root / MADE, f"{stage}.json") or {}


def keep_strangers(root: Path, stage: str, name: str, source: Path, recorded: Mapping[str, Any]) -> None:
    """Before an output takes the place of what lies there, take out what the stage did not make.

    Args:
        root: of the workspace.
        stage, name: whose output; source: where it lies now, a file or a folder.
        recorded: the stage's entry in workspace.json. Versions before left no list: what they record as an output is all theirs.
    """
    target, note = root / name, stamps_in(root / MADE, f"{stage}.json")
    if (
        not os.path.lexists(target)
        or name.startswith(f"{MADE}/")
        or (note is None and name in recorded.get("outputs", ()))
    ):
        return
    listed = {n: stamp for n, stamp in (note or {}).items() if n == name or n.startswith(f"{name}/")}
    own = [n for n, stamp in listed.items() if is_as_it_was(root / n, stamp)]
    if not target.is_dir():
        if name not in own:
            _put_aside(root, target)
        return
    for stranger in list(strangers(target, [n.removeprefix(f"{name}/") for n in own])):
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

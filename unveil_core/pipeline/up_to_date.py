"""Digests of everything that a stage depends on: they decide whether it is up to date."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from unveil_core.base.disk.open_safely import LARGEST_TEXT
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.output.stamps import Stamp, digest_of
from unveil_core.base.surroundings.user_cache import user_cache_folder
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.source_digest import code_digest
from unveil_core.pipeline.stage import Stage
from unveil_core.workspace.made import made_by
from unveil_core.workspace.workspace import Workspace

__all__ = ["Digests", "changed_result", "depends_on", "input_hash", "is_current"]

CONTENT_MARKS = 2
"""Of a file's marks those by which a stage's inputs are watched: size and time. The system's time changes with rights and names,
too, for a stage may link to what it reads, and network file systems may number a file anew while hours of work go on."""


LONGEST_UNUSED_S = 90 * 86400.0
"""After that what is remembered for a workspace is forgotten: perhaps there is none any more."""


class Digests:
    """Content digests of files, remembered by what tells that a file is another one: size, time of change, the system's own time
    of change and its number of the file. Programs that copy set the first two as they were; where any of the four is another,
    as in a copy of the workspace, the content is read again, and it alone counts.

    Those of the workspace's own files lie in it. Those of files outside, which may be private and which strangers may name, lie in
    the user's cache: who gets the workspace is not told what lies where on this machine.
    """

    def __init__(self, workspace: Workspace) -> None:
        self.root = workspace.root
        self.path = workspace.root / ".digests.json"
        name = hashlib.blake2b(os.fsencode(os.path.realpath(self.root)), digest_size=16).hexdigest()
        self.outside_path = user_cache_folder() / "outside" / f"{name}.json"
        self.known = {k: v for k, v in _remembered(self.path).items() if _lies_inside(k)}
        self.known |= {k: v for k, v in _remembered(self.outside_path).items() if os.path.isabs(k)}
        self.used: set[str] = set()
        self._read: dict[Path, list[int]] = {}

    def of_file(self, path: Path) -> str:
        """The digest of a file's content; it is read only if the file may be another one than last time."""
        marks = _marks(path.stat())
        key = str(path.relative_to(self.root)) if path.is_relative_to(self.root) else str(path.absolute())
        self.used.add(key)
        self._read[path] = marks[:CONTENT_MARKS]
        held = self.known.get(key)
        if held is not None and held[:-1] == marks:
            return str(held[-1])
        digest = digest_of(path, links=True)
        self.known[key] = [*marks, digest]
        return digest

    def agrees(self, path: Path, stamp: Stamp) -> bool:
        """Whether a file has the content that its stamp tells of."""
        if not stamp[2]:
            return path.stat().st_size == stamp[0]
        return self.of_file(path) == stamp[2]

    def trust(self, files: Mapping[str, Stamp | None]) -> None:
        """Take the digests of files that were written just now, relative to the workspace, from their stamps."""
        for name, stamp in files.items():
            if stamp is not None and stamp[2]:
                self.known[name] = [*_marks((self.root / name).stat()), stamp[2]]
                self.used.add(name)

    def of(self, path: Path) -> list[tuple[str, str]]:
        """(relative name, digest) of a file or of all files in a folder."""
        if path.is_dir():
            return [(str(p.relative_to(path)), self.of_file(p)) for p in sorted(path.rglob("*")) if p.is_file()]
        return [("", self.of_file(path))] if path.is_file() else [("", "absent")]

    def of_outside(self, files: Iterable[tuple[str, Path]]) -> list[tuple[str, str]]:
        """(name, digest) of files outside the workspace, each given with the name under which it counts."""
        return [(name, self.of_file(path) if path.is_file() else "absent") for name, path in files]

    def begin(self) -> None:
        """From now on, look which files are asked for: those that the next stage reads."""
        self._read = {}

    def changed(self) -> Path | None:
        """The first file of those asked for since :meth:`begin` that is gone, or has another size or time of change; None = none.

        A file of equal content but another time counts, too: what was read in between is not known.
        """
        for path, marks in self._read.items():
            try:
                found = _marks(path.stat())
            except OSError:
                return path
            if found[:CONTENT_MARKS] != marks:
                return path
        return None

    def save(self) -> None:
        """Write what is remembered; files that are gone are forgotten."""
        kept = {k: v for k, v in self.known.items() if k in self.used or os.path.isfile(self.root / k)}
        write_json_atomic(self.path, {k: v for k, v in kept.items() if _lies_inside(k)})
        outside = {k: v for k, v in kept.items() if os.path.isabs(k)}
        with suppress(OSError):  # without it they are read again
            folder = self.outside_path.parent
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if outside:
                write_json_atomic(self.outside_path, outside)
            for file in folder.glob("*.json"):
                if file.stat().st_mtime < time.time() - LONGEST_UNUSED_S:
                    file.unlink()


def _remembered(path: Path) -> dict[str, list]:  # type: ignore[type-arg]
    """What a file of digests holds; nothing where it is not there or damaged."""
    with suppress(OSError, ValueError):
        known = read_own_json(path, LARGEST_TEXT)
        return {k: v for k, v in known.items() if _is_digest(v)} if isinstance(known, dict) else {}
    return {}


def _lies_inside(key: str) -> bool:
    """Whether a key is that of a file of the workspace."""
    return not os.path.isabs(key) and ".." not in Path(key).parts


def _marks(stat: os.stat_result) -> list[int]:
    """What tells that a file is another one, :data:`CONTENT_MARKS` first."""
    return [stat.st_size, stat.st_mtime_ns, stat.st_ino, stat.st_ctime_ns]


def _is_digest(entry: object) -> bool:
    """Whether an entry is a file's marks and its digest; those of before had fewer, and are taken anew."""
    return isinstance(entry, list) and [type(v) for v in entry] == [int, int, int, int, str]


def input_hash(stage: Stage, workspace: Workspace, settings: RunSettings, drive: Path, digests: Digests) -> str:
    """Digest of everything that a stage's result depends on: code, settings, and the content of all files that it reads."""
    digests.begin()
    files = settings.files  # of these the content counts, see Stage.outside
    parts: list[object] = [stage.name, stage.variant, code_digest(stage.run)]
    parts += [{k: value for k, value in stage.chosen(settings).items() if k not in files}]
    parts += [(name, digests.of(workspace.root / name)) for name in stage.inputs]
    if stage.outside is not None:
        parts += [digests.of_outside(stage.outside(workspace, settings, drive))]
    return hashlib.blake2b(json.dumps(parts, sort_keys=True).encode(), digest_size=16).hexdigest()


def depends_on(inputs: Sequence[str], outputs: Sequence[str] | set[str]) -> bool:
    """Whether an input is one of the outputs, a folder that holds one, or lies in one."""
    return any(a == b or a.startswith(f"{b}/") or b.startswith(f"{a}/") for a in inputs for b in outputs)


def is_current(stage: Stage, workspace: Workspace, recorded: Mapping[str, Any], wanted: str, digests: Digests) -> bool:
    """Whether a stage's outputs are there, as the stage wrote them, and were made from what its input hash ``wanted`` says."""
    there = recorded.get("input_hash") == wanted and all((workspace.root / n).exists() for n in stage.outputs)
    return there and changed_result(stage.name, workspace, digests) is None


def changed_result(stage: str, workspace: Workspace, digests: Digests) -> Path | None:
    """The first file that a stage made which is gone, or is another one since: a person's, or a damaged one; None = none."""
    for name, stamp in made_by(workspace.root, stage).items():
        path = workspace.root / name
        if not path.is_file() or (stamp is not None and not digests.agrees(path, stamp)):
            return path
    return None

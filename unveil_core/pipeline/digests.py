"""Digests of everything that a stage depends on: they decide whether it is up to date."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path

from unveil_core.base.files import write_json_atomic
from unveil_core.base.onnx_files import files_of
from unveil_core.drives.marked import files_named, read_marked
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage
from unveil_core.workspace.workspace import Workspace

__all__ = ["Digests", "input_hash"]


class Digests:
    """Content digests of files, remembered by size and time of change."""

    def __init__(self, workspace: Workspace) -> None:
        self.path = workspace.root / ".digests.json"
        self.known: dict[str, list] = {}  # type: ignore[type-arg]
        with suppress(OSError, ValueError):
            self.known = json.loads(self.path.read_text())

    def of_file(self, path: Path) -> str:
        stat = path.stat()
        key = str(path)
        held = self.known.get(key)
        if held and held[0] == stat.st_size and held[1] == stat.st_mtime_ns:
            return str(held[2])
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
        self.known[key] = [stat.st_size, stat.st_mtime_ns, digest]
        return digest

    def of(self, path: Path) -> list[tuple[str, str]]:
        """(relative name, digest) of a file or of all files in a folder."""
        if path.is_dir():
            return [(str(p.relative_to(path)), self.of_file(p)) for p in sorted(path.rglob("*")) if p.is_file()]
        return [("", self.of_file(path))] if path.is_file() else [("", "absent")]

    def save(self) -> None:
        write_json_atomic(self.path, self.known)


def input_hash(stage: Stage, workspace: Workspace, settings: RunSettings, drive: Path, digests: Digests) -> str:
    """Digest of everything that a stage's result depends on: settings, the content of its inputs, its version."""
    values = settings.to_json()
    for name, path in settings.networks.items():  # what is in the files counts, not where they lie
        if name in stage.settings:
            values[name] = [(p.name.removeprefix(path.name), digests.of_file(p)) for p in files_of(path)]
    if settings.marked is not None and "marked" in stage.settings:
        path = Path(settings.marked)
        pictures = [p for m in read_marked(path) if m.mattes is not None for p in files_named(m.mattes)]
        values["marked"] = [digests.of_file(p) for p in (path, *pictures)]
    parts: list[object] = [stage.name, stage.version, {k: values[k] for k in stage.settings}]
    parts += [(name, digests.of(workspace.root / name)) for name in (*stage.inputs, *stage.optional)]
    if stage.drive_digest:
        from unveil_core.drives import open_drive

        opened = open_drive(drive)
        files = [opened.root] if opened.root.is_file() else []
        for f in opened.frames:
            files += [p for p in (f.image_path, f.semantic_path, f.instance_path, f.mask_path) if p is not None]
        parts += [(str(p), digests.of(p)) for p in files]
        parts += [hashlib.blake2b(opened.points.positions.tobytes(), digest_size=16).hexdigest()]
        parts += [[f.camera.world_to_camera.tolist() for f in opened.frames]]
    return hashlib.blake2b(json.dumps(parts, sort_keys=True).encode(), digest_size=16).hexdigest()

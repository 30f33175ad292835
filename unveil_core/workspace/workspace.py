"""A workspace: the folder that all stages read and write. Files are the interface."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from unveil_core.base.disk.links import EVENTS, LOCK, refuse_links
from unveil_core.base.disk.lock import WRITABLE, Lock, may_lock
from unveil_core.base.disk.open_safely import LARGEST_STATE, RefusedFileError, open_in_place, read_bytes
from unveil_core.base.errors import DiskFullError, WorkspaceError
from unveil_core.base.files import full_disk, parsed_json, read_own_json, write_json_atomic
from unveil_core.base.output.written import GENERATOR, is_ours

__all__ = ["Workspace", "is_workspace"]

FORMAT = 1
"""Of workspace.json, raised when a workspace can no longer be read by the versions before."""
WORKSPACE = "workspace.json"
LARGEST_EVENTS = 1 << 28
"""Bytes of events.jsonl: hundred times that of the longest runs."""
BEGUN = (LOCK, ".workspace.json.")
"""How the files begin that are in a workspace before its workspace.json."""


class Workspace:
    """Paths and state of a workspace folder.

    Attributes:
        root: the folder.
        made: whether :meth:`create` made the folder, so that who called it may remove it again.
        held: the lock of :meth:`lock`, None before the first.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.made = Path(root), False
        self.held: Lock | None = None

    # ------------------------------------------------------------------------------------------------------- open, create

    @staticmethod
    def open(root: str | Path) -> Workspace:
        """Open an existing workspace.

        Raises:
            WorkspaceError: there is none, or its workspace.json is damaged, of another version, or another program's; or it holds a
                link, a pipe or a device.
        """
        workspace = Workspace(Path(root))
        if not workspace.workspace_json.is_file():
            raise WorkspaceError("Not a workspace", path=root, mend="make one with `unveil run` or `unveil import`")
        refuse_links(workspace.root)
        workspace.state()
        return workspace

    @staticmethod
    def may_be(root: str | Path) -> bool:
        """Whether a folder is a workspace; where it is not, check that it may become one. Nothing is written.

        Raises:
            WorkspaceError: it is a file, or holds something else.
        """
        workspace = Workspace(Path(root))
        if workspace.workspace_json.is_file():
            workspace.state()
            return True
        if workspace.root.exists() and not workspace.root.is_dir():
            raise WorkspaceError("Not a folder", path=root, mend="name a folder for the workspace")
        if workspace.root.is_dir() and not all(p.name.startswith(BEGUN) for p in workspace.root.iterdir()):
            if workspace.workspace_json.is_file():
                return True  # made by another process in this moment
            raise WorkspaceError("Not empty, and not a workspace", path=root, mend="name a new or empty folder")
        if not may_lock(workspace.root / LOCK):
            raise WorkspaceError(
                "Another program's file", path=workspace.root / LOCK, mend="name a new or empty folder"
            )
        return False

    @staticmethod
    def create(root: str | Path) -> Workspace:
        """Open a workspace, or make one in a folder that is empty or not there yet.

        Raises:
            WorkspaceError: the folder holds something else, or a link, a pipe or a device in a workspace; cannot be written; or is
                just being made by another process.
            DiskFullError: no room.
        """
        workspace = Workspace(Path(root))
        if Workspace.may_be(root):
            refuse_links(workspace.root)
            return workspace
        try:
            workspace.root.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                workspace.root.mkdir()
                workspace.made = True
            with workspace.lock():
                if not workspace.workspace_json.is_file():
                    write_json_atomic(
                        workspace.workspace_json, {"format": FORMAT, "generator": GENERATOR, "stages": {}}
                    )
        except OSError as error:
            if full := full_disk(error, Path(root)):
                raise DiskFullError(full) from error
            raise WorkspaceError(f"cannot be written: {error.strerror}", path=root, mend=WRITABLE) from error
        return workspace

    # -------------------------------------------------------------------------------------------------------------- paths

    @property
    def workspace_json(self) -> Path:
        """Drive, settings, versions, and the state of each stage."""
        return self.root / WORKSPACE

    @property
    def events_jsonl(self) -> Path:
        """What happened, a JSON object a line."""
        return self.root / EVENTS

    @property
    def drive_dir(self) -> Path:
        """The imported drive."""
        return self.root / "drive"

    @property
    def labels_json(self) -> Path:
        """The labels that occur."""
        return self.root / "labels.json"

    @property
    def selection_json(self) -> Path:
        """The classes and objects that are removed."""
        return self.root / "selection.json"

    @property
    def objects_json(self) -> Path:
        """The single objects that can be removed, found before a scene is reconstructed."""
        return self.root / "objects.json"

    @property
    def surfels_full(self) -> Path:
        """The scene with everything in it."""
        return self.root / "surfels" / "full.ply"

    @property
    def exposure_json(self) -> Path:
        """Exposure and white balance of the photographs; absent in workspaces of before, which have none."""
        return self.root / "surfels" / "exposure.json"

    @property
    def ground_npz(self) -> Path:
        """Path, street and terrain, see :mod:`unveil_core.ground.files`."""
        return self.root / "ground" / "ground.npz"

    @property
    def surfels_empty(self) -> Path:
        """The empty street."""
        return self.root / "surfels" / "empty.ply"

    # -------------------------------------------------------------------------------------------------------------- state

    def state(self) -> dict[str, Any]:
        """The parsed workspace.json.

        Raises:
            WorkspaceError: it is damaged, or of another version.
        """
        try:
            data = read_own_json(self.workspace_json)
        except (OSError, ValueError) as error:
            raise WorkspaceError(f"cannot be read: {error}", path=self.workspace_json) from error
        parts = [data.get(n, {}) for n in ("stages", "settings", "versions")] if isinstance(data, dict) else [None]
        entries = parts[0].values() if isinstance(parts[0], dict) else ()
        if not all(isinstance(part, dict) for part in (*parts, *entries)):
            raise WorkspaceError(
                "Not what a workspace says of itself: expected an object with an object for each stage",
                path=self.workspace_json,
                mend="restore the file, or begin a new workspace",
            )
        if not _is_ours(data):
            raise WorkspaceError(
                "Another program's file, and not of a workspace",
                path=self.workspace_json,
                mend="name a new or empty folder",
            )
        if data["format"] != FORMAT:
            raise WorkspaceError(
                f"has format {data['format']!r}, this version reads {FORMAT}",
                path=self.workspace_json,
                mend="use the version of Unveil that made it",
            )
        return data

    def update(self, **values: object) -> None:
        """Set top-level entries of workspace.json."""
        write_json_atomic(self.workspace_json, {**self.state(), **values})

    def update_stage(self, name: str, **values: object) -> None:
        """Set entries of one stage."""
        state = self.state()
        state.setdefault("stages", {}).setdefault(name, {}).update(values)
        write_json_atomic(self.workspace_json, state)

    def replace_stage(self, name: str, entry: dict[str, Any]) -> None:
        """Put ``entry`` in the place of all entries of one stage."""
        state = self.state()
        state.setdefault("stages", {})[name] = entry
        write_json_atomic(self.workspace_json, state)

    def log(
        self, stage: str, message: str = "", *, level: str = "info", done: int = 0, total: int = 0, **metrics: object
    ) -> dict[str, object]:
        """Append an event; returns it.

        Raises:
            WorkspaceError: its file is a link, a pipe or a device.
        """
        event: dict[str, object] = {
            "t": round(time.time(), 3),
            "stage": stage,
            "done": done,
            "total": total,
            "message": message,
            "level": level,
            **metrics,
        }
        with self._events(os.O_WRONLY | os.O_APPEND | os.O_CREAT, "ab") as stream:
            stream.write(json.dumps(event).encode() + b"\n")
        return event

    def _events(self, flags: int, mode: str) -> BinaryIO:
        """The file of events, open to be written in place."""
        try:
            return os.fdopen(open_in_place(self.events_jsonl, flags), mode)  # type: ignore[return-value]
        except RefusedFileError as error:
            mend = "remove it, or put a copy in its place"
            raise WorkspaceError(f"cannot be written: {error.strerror}", path=self.events_jsonl, mend=mend) from error

    def end_cut_event(self) -> None:
        """End the last line where a kill or a full disk cut it short: the next event would be lost with it."""
        with suppress(FileNotFoundError), self._events(os.O_RDWR, "rb+") as stream:
            if stream.seek(0, os.SEEK_END) and stream.seek(-1, os.SEEK_END) >= 0 and stream.read(1) != b"\n":
                stream.write(b"\n")

    def events(self) -> list[dict[str, Any]]:
        """All events; a last line that was cut short by a kill is left out.

        Raises:
            WorkspaceError: the file cannot be read, or is none.
        """
        try:
            content = read_bytes(self.events_jsonl, LARGEST_EVENTS, links=False)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise WorkspaceError(
                f"cannot be read: {error.strerror}", path=self.events_jsonl, mend="move it away"
            ) from error
        found = []
        for line in content.decode("utf-8", errors="replace").splitlines():
            with suppress(ValueError):
                event = parsed_json(line)
                if isinstance(event, dict):
                    found.append(event)
        return found

    # --------------------------------------------------------------------------------------------------------------- lock

    def lock(self, *, shared: bool = False) -> Lock:
        """A context in which no other process works here, or with ``shared`` only others that share, each on a block of its own."""
        self.held = Lock(self.root / LOCK, shared=shared)
        return self.held


def is_workspace(root: Path) -> bool:
    """Whether a folder is a workspace of this program, of whatever version."""
    try:
        path = root / WORKSPACE
        return path.is_file() and _is_ours(parsed_json(read_bytes(path, LARGEST_STATE)))
    except (OSError, ValueError):
        return False


def _is_ours(data: object) -> bool:
    """Whether what a workspace.json holds is of this program: other programs have files of this name. Versions before named
    themselves when the first stage ran, and not in a file of their own."""
    if not isinstance(data, dict) or "format" not in data or not isinstance(data.get("stages"), dict):
        return False
    versions = data.get("versions")
    return is_ours(data) or (isinstance(versions, dict) and "unveil" in versions)

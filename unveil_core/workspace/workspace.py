"""A workspace: the folder that all stages read and write. Files are the interface."""

from __future__ import annotations

import json
import os
import platform
import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DiskFullError, InUseError, WorkspaceError
from unveil_core.base.file_locks import TAKEN, lock_file
from unveil_core.base.files import full_disk, parsed_json, write_json_atomic
from unveil_core.base.output.written import GENERATOR, is_ours

__all__ = ["Workspace", "is_workspace"]

FORMAT = 1
"""Of workspace.json, raised when a workspace can no longer be read by the versions before."""
WORKSPACE = "workspace.json"
LOCK = ".lock"
LONGEST_SIGNATURE = 1000
"""Bytes in a lock file: a process and a host."""
WRITABLE = "make it writable, or name another folder"
NO_LOCKS_VARIABLE = "UNVEIL_NO_LOCKS"
"""Of the environment; set to 1, a workspace whose file system has no locks is used all the same."""
SIGNED_AT = 1
"""Where in its file the holder is named: on Windows the byte that is locked, the first, cannot be read."""
BEGUN = (LOCK, ".workspace.json.")
"""How the files begin that are in a workspace before its workspace.json."""


class Workspace:
    """Paths and state of a workspace folder.

    Attributes:
        root: the folder.
        made: whether :meth:`create` made the folder, so that who called it may remove it again.
    """

    def __init__(self, root: Path) -> None:
        self.root, self.made = Path(root), False

    # ------------------------------------------------------------------------------------------------------- open, create

    @staticmethod
    def open(root: str | Path) -> Workspace:
        """Open an existing workspace.

        Raises:
            WorkspaceError: there is none, or its workspace.json is damaged, of another version, or another program's.
        """
        workspace = Workspace(Path(root))
        if not workspace.workspace_json.is_file():
            raise WorkspaceError("is no workspace", path=root, mend="make one with `unveil run` or `unveil import`")
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
            raise WorkspaceError("is a file", path=root, mend="name a folder for the workspace")
        if workspace.root.is_dir() and not all(p.name.startswith(BEGUN) for p in workspace.root.iterdir()):
            if workspace.workspace_json.is_file():
                return True  # made by another process in this moment
            raise WorkspaceError("is not empty and no workspace", path=root, mend="name a new or empty folder")
        if not _may_lock(workspace.root / LOCK):
            raise WorkspaceError("is another program's", path=workspace.root / LOCK, mend="name a new or empty folder")
        return False

    @staticmethod
    def create(root: str | Path) -> Workspace:
        """Open a workspace, or make one in a folder that is empty or not there yet.

        Raises:
            WorkspaceError: the folder holds something else, cannot be written, or is just being made by another process.
            DiskFullError: no room.
        """
        workspace = Workspace(Path(root))
        if Workspace.may_be(root):
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
        return self.root / "events.jsonl"

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
            data = parsed_json(self.workspace_json.read_text("utf-8"))
        except (OSError, ValueError) as error:
            raise WorkspaceError(f"cannot be read: {error}", path=self.workspace_json) from error
        parts = [data.get(n, {}) for n in ("stages", "settings", "versions")] if isinstance(data, dict) else [None]
        entries = parts[0].values() if isinstance(parts[0], dict) else ()
        if not all(isinstance(part, dict) for part in (*parts, *entries)):
            raise WorkspaceError(
                "is not what a workspace says of itself: expected an object with an object for each stage",
                path=self.workspace_json,
                mend="restore the file, or begin a new workspace",
            )
        if not _is_ours(data):
            raise WorkspaceError(
                "is another program's, and not of a workspace",
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
        """Append an event; returns it."""
        event: dict[str, object] = {
            "t": round(time.time(), 3),
            "stage": stage,
            "done": done,
            "total": total,
            "message": message,
            "level": level,
            **metrics,
        }
        with self.events_jsonl.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(event) + "\n")
        return event

    def end_cut_event(self) -> None:
        """End the last line where a kill or a full disk cut it short: the next event would be lost with it."""
        with suppress(FileNotFoundError), self.events_jsonl.open("rb+") as stream:
            if stream.seek(0, os.SEEK_END) and stream.seek(-1, os.SEEK_END) >= 0 and stream.read(1) != b"\n":
                stream.write(b"\n")

    def events(self) -> list[dict[str, Any]]:
        """All events; a last line that was cut short by a kill is left out."""
        if not self.events_jsonl.is_file():
            return []
        found = []
        for line in self.events_jsonl.read_text("utf-8", errors="replace").splitlines():
            with suppress(ValueError):
                event = parsed_json(line)
                if isinstance(event, dict):
                    found.append(event)
        return found

    # --------------------------------------------------------------------------------------------------------------- lock

    def lock(self, *, shared: bool = False) -> Lock:
        """A context in which no other process works here, or with ``shared`` only others that share, each on a block of its own."""
        return Lock(self.root / LOCK, shared=shared)


def is_workspace(root: Path) -> bool:
    """Whether a folder is a workspace of this program, of whatever version."""
    try:
        path = root / WORKSPACE
        return path.is_file() and _is_ours(parsed_json(path.read_bytes()))
    except (OSError, ValueError):
        return False


def _is_ours(data: object) -> bool:
    """Whether what a workspace.json holds is of this program: other programs have files of this name. Versions before named
    themselves when the first stage ran, and not in a file of their own."""
    if not isinstance(data, dict) or "format" not in data or not isinstance(data.get("stages"), dict):
        return False
    versions = data.get("versions")
    return is_ours(data) or (isinstance(versions, dict) and "unveil" in versions)


def _may_lock(path: Path) -> bool:
    """Whether a lock file that lies in a folder without workspace.json was left by this program: it is signed or still empty."""
    try:
        if not os.path.lexists(path):
            return True
        if path.is_symlink() or not path.is_file() or path.stat().st_size > LONGEST_SIGNATURE:
            return False
        signed = path.read_bytes()
    except OSError:
        return False
    return not signed or re.fullmatch(rb"\0\d+ on [^\0\r\n]*", signed) is not None


class Lock:
    """One process at a time, or several that share. The operating system drops the lock with the process, however it ends.

    Entering raises an InUseError where another process has it, and a WorkspaceError where the file system has no locks (some
    network file systems) or the folder cannot be written.
    """

    def __init__(self, path: Path, *, shared: bool = False) -> None:
        self.path, self.shared = path, shared
        self._handle: int | None = None

    def __enter__(self) -> Lock:
        try:
            # Never through a link: the file is cut and written.
            self._handle = os.open(self.path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
        except FileNotFoundError as error:
            raise WorkspaceError("is not there any more", path=self.path.parent, mend="run it again") from error
        except OSError as error:
            if self.path.is_symlink():
                raise WorkspaceError("is a symbolic link", path=self.path, mend="remove the link") from error
            if full := full_disk(error, self.path.parent):
                raise DiskFullError(full) from error
            problem = f"cannot be written: {error.strerror}"
            raise WorkspaceError(problem, path=self.path.parent, mend=WRITABLE) from error
        for patience in (0.05, 0.1, 0.2, 0.0):  # somebody may only look whether it is free, which takes no time
            try:
                lock_file(self._handle, self.shared)
                break
            except OSError as error:
                if error.errno not in TAKEN and os.environ.get(NO_LOCKS_VARIABLE) == "1":
                    break
                if error.errno in TAKEN and patience:
                    time.sleep(patience)
                    continue
                holder = self._holder(self._handle)
                os.close(self._handle)
                self._handle = None
                if error.errno in TAKEN:
                    problem = f"is in use by another process{holder}"
                    raise InUseError(problem, path=self.path.parent, mend="wait or stop it") from error
                raise WorkspaceError(
                    f"is on a file system without locks, so two runs would not be kept apart: {error.strerror}",
                    path=self.path.parent,
                    mend=f"use a local disk; where no other run can come, set {NO_LOCKS_VARIABLE}=1",
                ) from error
        self._sign(self._handle)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _sign(self, handle: int) -> None:
        """Write who holds the lock into its file; of several who share it nobody."""
        with suppress(OSError):  # on a full disk it holds all the same
            os.ftruncate(handle, 0)
            if not self.shared:
                os.lseek(handle, SIGNED_AT, os.SEEK_SET)
                os.write(handle, f"{os.getpid()} on {platform.node()}".encode())

    @staticmethod
    def _holder(handle: int) -> str:
        """Who wrote that, for the message; nothing where it cannot be told."""
        try:
            os.lseek(handle, SIGNED_AT, os.SEEK_SET)
            signed = os.read(handle, 200).decode(errors="replace")
        except OSError:
            return ""
        return f", {signed}" if re.fullmatch(r"\d+ on [\w.-]+", signed) else ""

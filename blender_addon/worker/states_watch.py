# SPDX-License-Identifier: GPL-3.0-or-later
"""The states of a workspace's stages for drawing, which must not wait for a disk: a thread reads them. No bpy here."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from . import workspace_state
from .workspace_state import WorkspaceState

__all__ = ["StatesWatch"]

OLD_S = 1.0
"""Older states are read again when they are asked for."""


class StatesWatch:
    """Keeps the latest states of one workspace.

    Attributes:
        pending: whether a thread is reading.
        changed: whether something new has come since :meth:`latest` was last asked.
    """

    def __init__(self, read: Callable[[Path, Mapping[str, object]], WorkspaceState] = workspace_state.read) -> None:
        self._read = read
        self._lock = threading.Lock()
        self._key: object = None
        self._found: WorkspaceState | None = None
        self._at = 0.0
        self.pending = self.changed = False

    def latest(self, root: Path, wanted: Mapping[str, object], *, wait: bool = False) -> WorkspaceState | None:
        """The states as they were last read; None where they never were. Has them read again where they are old.

        Args:
            root: the workspace; wanted: settings that a run would have.
            wait: read now, here.
        """
        key = (str(root), repr(wanted))
        if wait:
            self._take(key, self._read(root, wanted))
        with self._lock:
            fresh = key == self._key and time.monotonic() - self._at < OLD_S
            if not fresh and not self.pending:
                self.pending = True
                threading.Thread(target=self._look, args=(key, root, wanted), name="unveil-states", daemon=True).start()
            self.changed = False
            return self._found if self._found is not None and self._found.root == root else None

    def _look(self, key: object, root: Path, wanted: Mapping[str, object]) -> None:
        try:
            self._take(key, self._read(root, wanted))
        finally:
            self.pending = False

    def _take(self, key: object, found: WorkspaceState) -> None:
        with self._lock:
            self.changed = self.changed or found != self._found
            self._key, self._found, self._at = key, found, time.monotonic()

    def forget(self) -> None:
        """Read anew next time."""
        with self._lock:
            self._key = None

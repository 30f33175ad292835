"""All readers that are fuzzed."""

from __future__ import annotations

from tests.fuzz import readers_addon, readers_binary, readers_drive_text, readers_workspace_text, whole_drives
from tests.fuzz.reader import Reader

__all__ = ["INPUTS", "READERS"]

INPUTS = {"text": 100_000, "binary": 20_000, "drive": 2_000}
"""Tried of each reader of a kind, where nothing else is asked for."""
GROUPS = (readers_drive_text, readers_workspace_text, readers_addon, readers_binary, whole_drives)
READERS: dict[str, Reader] = {reader.name: reader for group in GROUPS for reader in group.READERS}

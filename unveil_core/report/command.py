"""The command that repeats a run, from the settings that workspace.json records."""

from __future__ import annotations

import re
import shlex
from typing import Any

from unveil_core.base.wording import setting_as_option

__all__ = ["repeating_command"]

NAME = re.compile(r"[a-z][a-z_]{0,40}")


def repeating_command(state: dict[str, Any], workspace: str) -> list[str] | None:
    """The words of ``unveil run DRIVE -o WORKSPACE ...`` with every setting, each quoted for a shell.

    Args:
        state: workspace.json, of a stranger perhaps: a setting that is none, or that holds more than visible characters, gives no
            command, for people paste it.
        workspace: a name for the new workspace.
    """
    drive, settings = state.get("drive"), state.get("settings")
    if not drive or not isinstance(settings, dict):
        return None
    words = ["unveil", "run", str(drive), "-o", workspace]
    for name, value in settings.items():
        if not NAME.fullmatch(name):
            return None
        usual = value is not False if name == "adapt" else value is None or value is False or value in ([], "")
        if not usual:
            words.append(setting_as_option(name, value))
    return [shlex.quote(word) for word in words] if all(word.isprintable() for word in words) else None

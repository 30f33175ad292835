"""The command that repeats a run, from the settings that workspace.json records."""

from __future__ import annotations

import re
import shlex
from typing import Any

__all__ = ["repeating_command"]

SWITCHES = {"adapt": (False, "--no-adaptation")}
"""Settings that are options without a value: where they have this value, the option is given."""
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
        if name in SWITCHES:
            words += [SWITCHES[name][1]] if value is SWITCHES[name][0] else []
        elif value is not None and value != [] and value != "":
            # Joined, because a value may begin with a dash.
            words.append(f"--{name.replace('_', '-')}={_text(value)}")
    return [shlex.quote(word) for word in words] if all(word.isprintable() for word in words) else None


def _text(value: Any) -> str:
    return ",".join(str(v) for v in value) if isinstance(value, list) else str(value)

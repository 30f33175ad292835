"""The command that repeats a run, from the settings that workspace.json records. The page is given to others: it has no paths."""

from __future__ import annotations

import re
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any

from unveil_core.base.wording import setting_as_option

__all__ = ["SETTINGS", "name_of_path", "repeating_command"]

SETTINGS = frozenset(
    (
        "adapt", "baselines", "camera_height", "cameras", "corrections", "device", "frames", "inpainter",
        "instance_maps", "instances", "iterations", "keyframes", "label_classes", "labels", "marked", "mask_removes",
        "memory", "model", "movers", "order", "per_object", "pose_convention", "poses", "quality", "reference_inpainter",
        "remove", "scale", "scene", "seed", "segmenter", "sh_degree", "shadows", "splats", "sweeps", "up", "without", "work_side",
    )
)  # fmt: skip
"""Of a run; named here again because they are defined above this package: a test compares the two. Others give no command, for a
workspace of a stranger may record options that write elsewhere."""
BARE, QUOTABLE = re.compile(r"[\w./:,=+@-]+"), re.compile(r"[^\"$`\\%!]+")
"""Words that mean the same to each shell as they are, and in double quotes: POSIX shells, cmd.exe and PowerShell."""


def name_of_path(text: str, *, of_drive: bool = False) -> str:
    """What a path leads to, without the folders that it lies in, which may tell of a person or a client; other texts as they are.

    Args:
        of_drive: a file of JSON describes the folder that it lies in: that is named, too.
    """
    windows = PureWindowsPath(text)
    path = windows if windows.drive or "\\" in text else PurePosixPath(text)
    if not (path.is_absolute() or windows.drive or text.startswith(("~", "/", "\\")) or ".." in path.parts):
        return text
    parts = [part for part in path.parts if part not in (path.anchor, "..", "~")]
    return "/".join(parts[-2:] if of_drive and path.suffix.lower() == ".json" else parts[-1:])


def repeating_command(state: dict[str, Any], workspace: str) -> list[str] | None:
    """The words of ``unveil run DRIVE -o WORKSPACE ...`` with every setting as any shell takes them, without folders.

    Args:
        state: workspace.json, of a stranger perhaps: a setting that is none, or a word that some shell would not take as it is,
            gives no command, for people paste it.
        workspace: a name for the new workspace.
    """
    drive, settings = name_of_path(str(state.get("drive") or ""), of_drive=True), state.get("settings")
    if not drive or not isinstance(settings, dict):
        return None
    words = ["unveil", "run", _no_option(drive), "-o", _no_option(workspace)]
    for name, value in settings.items():
        if name not in SETTINGS:
            return None
        usual = value is not False if name == "adapt" else value is None or value is False or value in ([], "")
        if not usual:
            words.append(setting_as_option(name, _without_folders(value)))
    quoted = [_quoted(word) for word in words]
    return None if None in quoted else [word for word in quoted if word is not None]


def _without_folders(value: object) -> object:
    if isinstance(value, list | tuple):
        return [_without_folders(v) for v in value]
    return name_of_path(value) if isinstance(value, str) else value


def _no_option(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name


def _quoted(word: str) -> str | None:
    """A word as all shells read it; None = there is no such way."""
    if BARE.fullmatch(word):
        return word
    return f'"{word}"' if word.isprintable() and QUOTABLE.fullmatch(word) else None

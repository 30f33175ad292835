# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil`` as options of the ``unveil`` command, and as workspace.json records them. No bpy here."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..formats.table.run_settings import SHOWN, SUN, RunSetting, same, sun_of

__all__ = [
    "adopt",
    "default_workspace",
    "other_drive",
    "recorded",
    "replaced",
    "selection_arguments",
    "settings_arguments",
]

ANYTHING = {
    "--remove": "auto",
    "--instances": "auto",
    "--marked": "none",
    "--corrections": "none",
    "--per-object": "none",
}
"""The options of a choice, and how to say that nothing is chosen: everything removable goes."""
NOTHING = {**ANYTHING, "--remove": "", "--instances": ""}
"""How to say that a choice names none of that kind."""


def settings_arguments(settings: Any, absolute: Callable[[str], str] = str) -> list[str]:
    """Options that say everything that ``settings`` says, so that nothing recorded before comes through.

    Each is one word, for a value may begin with a dash.

    Args:
        settings: a ``scene.unveil``.
        absolute: makes Blender's ``//paths`` absolute.
    """
    return [setting.argument(value) for setting, value in _values(settings, absolute)]


def replaced(arguments: Sequence[str], **values: str) -> list[str]:
    """Options with other values: ``replaced(options, quality="draft")``."""
    names = {name: f"--{name.replace('_', '-')}=" for name in values}
    kept = [word for word in arguments if not word.startswith(tuple(names.values()))]
    return [*kept, *(f"{names[name]}{value}" for name, value in values.items())]


def selection_arguments(chosen: Sequence[str]) -> list[str]:
    """A choice that says of each kind what goes, or that nothing does, so that nothing recorded before comes through.

    Args:
        chosen: options, as ``["--remove", "car"]``; empty for no choice: everything removable goes.
    """
    given = dict(zip(chosen[::2], chosen[1::2], strict=True))
    usual = NOTHING if given else ANYTHING
    return [word for name, none in usual.items() for word in (name, given.get(name, none))]


def recorded(settings: Any, selection: Sequence[str] = (), absolute: Callable[[str], str] = str) -> dict[str, object]:
    """The same under the names and with the values that workspace.json has once they were used.

    Args:
        settings: a ``scene.unveil``.
        selection: options that say what goes, as ``["--remove", "car", "--instances", "3,7"]``.
        absolute: as above.
    """
    found: dict[str, object] = {setting.name: value for setting, value in _values(settings, absolute)}
    found |= {"marked": None, "corrections": None, "per_object": []}
    for option, value in zip(selection[::2], selection[1::2], strict=True):
        if option == "--remove":
            found["remove"] = [] if value == "auto" else _names(value)
        elif option == "--instances":
            found["instances"] = [] if value == "auto" else [int(part) for part in _names(value)]
        elif option == "--per-object":
            found["per_object"] = [] if value == "none" else _names(value)
        elif option in ("--marked", "--corrections"):
            found[option[2:]] = None if value == "none" else value
    return found


def adopt(settings: Any, found: Mapping[str, object]) -> None:
    """Take over what a workspace was made with; what it does not tell, or tells wrongly, stays as it is.

    What a property cannot hold exactly, as a number of 64 bits, stays exact in ``made_with`` until somebody changes the property.

    Args:
        settings: a ``scene.unveil``.
        found: settings under their names in workspace.json, from whoever made it.
    """
    taken: dict[str, object] = {}
    for setting in SHOWN:
        if setting.name not in found:
            continue
        value = found[setting.name]
        shown = setting.shown(value)
        if shown is None:
            continue
        sun = sun_of(str(value)) if shown == "given" else None
        with suppress(TypeError, ValueError, OverflowError):  # none of the choices, too large a number
            setattr(settings, setting.name, shown)
            for name, angle in zip(SUN, sun or (), strict=False):
                setattr(settings, name, angle)
            taken[setting.name] = value
    settings.made_with = json.dumps(taken)


def _values(settings: Any, absolute: Callable[[str], str]) -> Iterator[tuple[RunSetting, Any]]:
    """Each setting with the value that workspace.json will have."""
    try:
        made_with = json.loads(settings.made_with or "{}")
    except (ValueError, RecursionError):
        made_with = {}
    for setting in SHOWN:
        value = made_with.get(setting.name) if isinstance(made_with, dict) else None
        known = isinstance(made_with, dict) and setting.name in made_with and _still(settings, setting, value)
        yield setting, value if known else setting.recorded(settings, absolute)


def _still(settings: Any, setting: RunSetting, value: Any) -> bool:
    """Whether a property is as it was when ``value`` was taken over."""
    shown = setting.shown(value)
    if shown is None or not same(getattr(settings, setting.name), shown):
        return False
    sun = sun_of(value) if shown == "given" else None
    return all(same(getattr(settings, name), angle) for name, angle in zip(SUN, sun or (), strict=False))


def default_workspace(drive: str | Path, blend: str = "") -> Path:
    """Where results go if nobody says: beside the .blend, or beside the drive."""
    drive = Path(drive)
    folder = drive if drive.suffix == "" else drive.parent
    return (Path(blend).parent if blend else folder.parent) / f"{folder.name}_unveiled"


def other_drive(drive: str | Path, known: str) -> str:
    """The drive that a workspace was made from, where it is another than the one that is to be imported; else empty.

    Args:
        known: as workspace.json has it; empty where it has none.
    """
    return known if known and _place_of(Path(known)) != _place_of(Path(drive)) else ""


def _place_of(drive: Path) -> Path:
    """The same for a folder and the transforms.json in it."""
    found = drive.resolve()
    return found.parent if found.name == "transforms.json" else found


def _names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]

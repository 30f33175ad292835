# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil`` as options of the ``unveil`` command, and as workspace.json records them. No bpy here."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

__all__ = ["default_workspace", "recorded", "selection_arguments", "settings_arguments"]

NOTHING = {"--remove": "", "--instances": "", "--marked": "none"}
"""The options of a choice, and how to say that it names none of that kind."""


def settings_arguments(settings: Any, absolute: Callable[[str], str] = str) -> list[str]:
    """Options that say everything that ``settings`` says, so that nothing recorded before comes through.

    Args:
        settings: a ``scene.unveil``.
        absolute: makes Blender's ``//paths`` absolute.
    """
    return [
        "--quality",
        settings.quality,
        "--device",
        settings.device,
        "--seed",
        str(settings.seed),
        "--shadows",
        _shadows(settings),
        "--movers",
        settings.movers,
        "--order",
        settings.order,
        "--keyframes",
        settings.keyframes.strip() or "auto",
        "--inpainter",
        _inpainter(settings, absolute),
        "--reference-inpainter",
        _file(settings.reference_inpainter, absolute) or "none",
        "--work-side",
        str(settings.work_side) if settings.work_side else "auto",
    ]


def selection_arguments(chosen: Sequence[str]) -> list[str]:
    """A choice that says of each kind what goes, or that nothing does, so that nothing recorded before comes through.

    Args:
        chosen: options, as ``["--remove", "car"]``; empty for no choice, which stays empty: everything removable goes.
    """
    given = dict(zip(chosen[::2], chosen[1::2], strict=True))
    return [word for name, none in NOTHING.items() for word in (name, given.get(name, none))] if given else []


def recorded(settings: Any, selection: Sequence[str] = (), absolute: Callable[[str], str] = str) -> dict[str, object]:
    """The same under the names and with the values that workspace.json has once they were used.

    Args:
        settings: a ``scene.unveil``.
        selection: options that say what goes, as ``["--remove", "car", "--instances", "3,7"]``.
        absolute: as above.
    """
    found: dict[str, object] = {
        "quality": settings.quality,
        "device": settings.device,
        "seed": settings.seed,
        "shadows": _shadows(settings),
        "movers": settings.movers,
        "order": settings.order,
        "keyframes": [] if settings.keyframes.strip() in ("", "auto") else _names(settings.keyframes),
        "inpainter": _inpainter(settings, absolute),
        "reference_inpainter": _file(settings.reference_inpainter, absolute) or None,
        "work_side": settings.work_side or None,
        "marked": None,
    }
    for option, value in zip(selection[::2], selection[1::2], strict=True):
        if option == "--remove":
            found["remove"] = _names(value)
        elif option == "--instances":
            found["instances"] = [int(part) for part in _names(value)]
        elif option == "--marked":
            found["marked"] = None if value == "none" else value
    return found


def default_workspace(drive: str | Path, blend: str = "") -> Path:
    """Where results go if nobody says: beside the .blend, or beside the drive."""
    drive = Path(drive)
    folder = drive if drive.suffix == "" else drive.parent
    return (Path(blend).parent if blend else folder.parent) / f"{folder.name}_unveiled"


def _names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _shadows(settings: Any) -> str:
    if settings.shadows != "given":
        return str(settings.shadows)
    return f"{math.degrees(settings.sun_azimuth):.6g},{math.degrees(settings.sun_elevation):.6g}"


def _file(path: str, absolute: Callable[[str], str]) -> str:
    return str(Path(absolute(path)).expanduser().absolute()) if path.strip() else ""


def _inpainter(settings: Any, absolute: Callable[[str], str]) -> str:
    name = settings.inpainter.strip() or "exemplar"
    return _file(name, absolute) if name.lower().endswith(".onnx") else str(name)

# SPDX-License-Identifier: GPL-3.0-or-later
"""``scene.unveil`` as options of the ``unveil`` command, and as workspace.json records them. No bpy here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = [
    "adopt",
    "default_workspace",
    "other_drive",
    "recorded",
    "replaced",
    "selection_arguments",
    "settings_arguments",
]

PLAIN = ("quality", "device", "seed", "movers", "order", "inpainter")
"""Settings that the panel has as workspace.json has them."""
NOTHING = {"--remove": "", "--instances": "", "--marked": "none", "--corrections": "none", "--per-object": "none"}
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
        "--cameras",
        ",".join(_names(settings.cameras)) or "auto",
        "--frames",
        settings.frames.strip() or "auto",
    ]


def replaced(arguments: Sequence[str], **values: str) -> list[str]:
    """Options with other values: ``replaced(options, quality="draft")``."""
    found = list(arguments)
    for name, value in values.items():
        found[found.index(f"--{name.replace('_', '-')}") + 1] = value
    return found


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
        "cameras": [] if settings.cameras.strip() == "auto" else _names(settings.cameras),
        "frames": settings.frames.strip() if settings.frames.strip() not in ("", "auto") else None,
        "marked": None,
        "corrections": None,
        "per_object": [],
    }
    for option, value in zip(selection[::2], selection[1::2], strict=True):
        if option == "--remove":
            found["remove"] = _names(value)
        elif option == "--instances":
            found["instances"] = [int(part) for part in _names(value)]
        elif option == "--per-object":
            found["per_object"] = [] if value == "none" else _names(value)
        elif option in ("--marked", "--corrections"):
            found[option[2:]] = None if value == "none" else value
    return found


def adopt(settings: Any, found: Mapping[str, object]) -> None:
    """Take over what a workspace was made with; what it does not tell, or tells wrongly, stays as it is.

    Args:
        settings: a ``scene.unveil``.
        found: settings under their names in workspace.json, from whoever made it.
    """
    wanted: dict[str, object] = {name: found[name] for name in PLAIN if name in found}
    shadows = found.get("shadows")
    if isinstance(shadows, str):
        sun = shadows.partition(",")
        if shadows in ("auto", "off"):
            wanted["shadows"] = shadows
        elif all(_is_number(part) for part in sun[::2]):
            wanted |= {
                "shadows": "given",
                "sun_azimuth": math.radians(float(sun[0])),
                "sun_elevation": math.radians(float(sun[2])),
            }
    for name in ("keyframes", "cameras"):
        if isinstance(listed := found.get(name), list) and all(isinstance(v, str) for v in listed):
            wanted[name] = ",".join(listed)
    for name, none in (("reference_inpainter", ""), ("frames", ""), ("work_side", 0)):
        if name in found:
            wanted[name] = none if found[name] is None else found[name]
    for name, value in wanted.items():
        if type(value) is type(getattr(settings, name)):
            with suppress(TypeError, ValueError, OverflowError):  # none of the choices, too large a number
                setattr(settings, name, value)


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


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


def _shadows(settings: Any) -> str:
    if settings.shadows != "given":
        return str(settings.shadows)
    return f"{math.degrees(settings.sun_azimuth):.6g},{math.degrees(settings.sun_elevation):.6g}"


def _file(path: str, absolute: Callable[[str], str]) -> str:
    return str(Path(absolute(path)).expanduser().absolute()) if path.strip() else ""


def _inpainter(settings: Any, absolute: Callable[[str], str]) -> str:
    name = settings.inpainter.strip() or "exemplar"
    return _file(name, absolute) if name.lower().endswith(".onnx") else str(name)

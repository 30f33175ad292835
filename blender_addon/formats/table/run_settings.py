# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of a run, as ``settings.json`` lists them, which is made from the table of the command. No bpy here."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["ADVANCED", "BASIC", "CHOSEN", "GROUPS", "SHOWN", "SUN", "RunSetting", "of_stage", "same"]

AUTO = "auto"
CHOSEN = ("remove", "instances", "marked", "per_object", "corrections")
"""Settings that are no properties of their own: what is chosen in the lists says them."""
SUN = ("sun_azimuth", "sun_elevation")
"""Further properties of the shadows, radians."""


@dataclass(frozen=True)
class RunSetting:
    """A row of the table.

    Attributes:
        name: in workspace.json, and of the property; option: of the command; label: for people.
        shape: "flag", "choice", "whole", "number", "text", "file", "folder", "network", "list" or "sun".
        items: of a list, "str" or "int".
        default: in workspace.json; usual: in words, where it follows from something.
        help: a line; group: a heading; measure: "m", "px" or empty; expert: whether it stands under *Advanced*.
        choices: (name, label, description).
        low, high: of a number.
    """

    name: str
    option: str
    label: str
    shape: str
    items: str
    default: Any
    usual: str
    help: str
    group: str
    measure: str
    expert: bool
    choices: list[list[str]]
    low: float | None
    high: float | None

    @property
    def nothing(self) -> Any:
        """The value of the property that stands for the default, where the default is no such value."""
        if self.shape == "choice":
            return AUTO
        if self.shape in ("whole", "number"):
            return -1 if self.low == 0 else 0
        return ""

    @property
    def start(self) -> Any:
        """The value that the property has at first."""
        if self.default is None or isinstance(self.default, list):
            return self.nothing
        return self.default

    def shown(self, value: Any) -> Any:
        """What the property has where workspace.json has ``value``; None where it cannot have it.

        Of the shadows it is a text: "auto", "off", or "given".
        """
        if value is None or value == []:
            return self.nothing if value == self.default else None
        if self.shape == "sun":
            if value in ("auto", "off"):
                return value
            return "given" if isinstance(value, str) and sun_of(value) else None
        if self.shape == "list":
            kind = int if self.items == "int" else str
            fits = isinstance(value, list) and all(type(part) is kind for part in value)
            return ",".join(str(part) for part in value) if fits else None
        if self.shape == "number":
            return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
        return value if isinstance(value, {"flag": bool, "whole": int}.get(self.shape, str)) else None

    def recorded(self, settings: Any, absolute: Callable[[str], str]) -> Any:
        """What workspace.json has of the property of a ``scene.unveil``."""
        value = getattr(settings, self.name)
        if self.shape == "sun":
            azimuth, elevation = (math.degrees(getattr(settings, name)) for name in SUN)
            return f"{azimuth:.6g},{elevation:.6g}" if value == "given" else str(value)
        if isinstance(value, str):
            value = value.strip()
            if value in ("", AUTO):
                return self.default
            if self.shape == "list":
                parts = [part.strip() for part in value.split(",") if part.strip()]
                return [int(part) for part in parts] if self.items == "int" else parts
            is_path = self.shape in ("file", "folder") or (self.shape == "network" and value.lower().endswith(".onnx"))
            return str(Path(absolute(value)).expanduser().absolute()) if is_path else value
        if self.default is None and value <= self.nothing:
            return None
        return float(f"{value:.7g}") if self.shape == "number" else value

    def argument(self, value: Any) -> str:
        """The option that says a value of workspace.json."""
        if self.shape == "flag":
            return self.option if value else f"--no-{self.option[2:]}"
        nothing = value is None or value == []
        text = ",".join(str(part) for part in value) if isinstance(value, list) else str(value)
        return f"{self.option}={AUTO if nothing else text}"


def sun_of(text: str) -> tuple[float, float] | None:
    """Azimuth and elevation, radians, of "135,40"; None where it is none."""
    try:
        azimuth, elevation = (math.radians(float(part)) for part in text.split(","))
    except ValueError:
        return None
    return (azimuth, elevation) if math.isfinite(azimuth) and math.isfinite(elevation) else None


def same(one: Any, other: Any) -> bool:
    """Whether a property has a value; Blender has numbers with 32 bits."""
    if isinstance(one, float) and isinstance(other, float):
        return _rounded(one) == _rounded(other)
    return type(one) is type(other) and bool(one == other)


def _rounded(value: float) -> float:
    try:
        return float(struct.unpack("f", struct.pack("f", value))[0])
    except OverflowError:
        return value


def _read() -> tuple[Mapping[str, str], tuple[RunSetting, ...], Mapping[str, str]]:
    data = json.loads((Path(__file__).parent / "settings.json").read_text(encoding="utf-8"))
    return data["groups"], tuple(RunSetting(**row) for row in data["settings"]), data["mechanisms"]


def of_stage(stage: str, wanted: Mapping[str, object]) -> Mapping[str, object]:
    """Settings as a stage records them: of what a run does without only its own mechanisms, in the order of the list."""
    if not isinstance(names := wanted.get("without"), list):
        return wanted
    return {**wanted, "without": [name for name, place in _MECHANISMS.items() if place == stage and name in names]}


GROUPS, _ALL, _MECHANISMS = _read()
SHOWN = tuple(setting for setting in _ALL if setting.name not in CHOSEN)
"""Those that are properties, in the order in which they are shown."""
BASIC = tuple(setting for setting in SHOWN if not setting.expert)
ADVANCED = tuple(setting for setting in SHOWN if setting.expert)

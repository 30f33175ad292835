"""Kinds of settings: how each is written as a word of the command, and as a value of Python or TOML."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from unveil_core.pipeline.settings import UPS

__all__ = [
    "FILE",
    "FLAG",
    "FOLDER",
    "FRAMES",
    "IDS",
    "NAMES",
    "NETWORK",
    "NUMBER",
    "OBJECTS",
    "SIZE",
    "SUN",
    "TEXT",
    "TEXTS",
    "UP",
    "WHOLE",
    "Kind",
    "choice",
]


@dataclass(frozen=True)
class Kind:
    """Attributes:
    shape: what a form of another program shows: "flag", "choice", "whole", "number", "text", "file", "folder", "network" (a
        name, or a file), "list" or "sun".
    parse: from a word of the command to the value that workspace.json records; raises ValueError.
    take: likewise from a value of Python or TOML that is no text; raises TypeError or ValueError.
    expects: what may be given, for errors.
    names: of a choice.
    """

    shape: str
    parse: Callable[[str], Any]
    take: Callable[[Any], Any]
    expects: str
    names: tuple[str, ...] = ()


def listed(text: str) -> tuple[str, ...]:
    """The parts between commas, without spaces around them."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def choice(*names: str) -> Kind:
    """One of some names."""
    return Kind("choice", str.strip, _nothing, f"one of {', '.join(names)}", names)


def _nothing(value: object) -> Any:
    raise TypeError


def _flag(text: str) -> bool:
    found = {"yes": True, "true": True, "on": True, "no": False, "false": False, "off": False}.get(text.strip().lower())
    if found is None:
        raise ValueError
    return found


def _of_type(*types: type) -> Callable[[Any], Any]:
    """The value itself where it is of one of these types; True and False are no numbers."""

    def take(value: Any) -> Any:
        if isinstance(value, bool) != (bool in types) or not isinstance(value, types):
            raise TypeError
        return float(value) if float in types else value  # type: ignore[arg-type]

    return take


def _items(value: Any) -> Sequence[Any]:
    if not isinstance(value, list | tuple | set | frozenset):
        raise TypeError
    return sorted(value, key=str) if isinstance(value, set | frozenset) else value


def _take_names(value: Any) -> tuple[str, ...]:
    if not all(isinstance(part, str) for part in _items(value)):
        raise TypeError
    return tuple(_items(value))


def _take_texts(value: Any) -> tuple[str, ...]:
    """Names, or numbers."""
    if not all(isinstance(part, str | int) and not isinstance(part, bool) for part in _items(value)):
        raise TypeError
    return tuple(str(part) for part in _items(value))


def _take_ids(value: Any) -> tuple[int, ...]:
    return tuple(_of_type(int)(part) for part in _items(value))


def _take_text(value: Any) -> str:
    """A number, or several of them: of a model, or of sweeps."""
    return str(_of_type(int)(value)) if not isinstance(value, list | tuple) else ",".join(_take_texts(value))


def _take_frames(value: Any) -> str:
    """A frame, a slice, a range, or several of these."""
    if isinstance(value, list | tuple):
        return ",".join(part if isinstance(part, str) else _take_frames(part) for part in value)
    if isinstance(value, range):
        if value.start < 0 or value.stop < 0 or value.step < 1:
            raise ValueError
        return f"{value.start}:{value.stop}:{value.step}"
    if isinstance(value, slice):
        ends = ["" if part is None else str(_of_type(int)(part)) for part in (value.start, value.stop)]
        return ":".join([*ends, *([] if value.step is None else [str(_of_type(int)(value.step))])])
    return str(_of_type(int)(value))


def _take_sun(value: Any) -> str:
    """Whether shadows are removed, or azimuth and elevation of the sun."""
    if isinstance(value, bool):
        return "auto" if value else "off"
    azimuth, elevation = (_of_type(int, float)(part) for part in _items(value))
    return f"{azimuth:.9g},{elevation:.9g}"


def _take_size(value: Any) -> str:
    size = _of_type(int)(value)
    return f"{size >> 20}M" if size % (1 << 20) == 0 else str(size)


def _take_objects(value: Any) -> tuple[str, ...]:
    """By id what differs, as ``{3: {"grow": 8, "shadow": "keep"}}``; TOML has ids as texts."""
    if not isinstance(value, Mapping):
        return _take_names(value)
    return tuple(f"{number}:{key}={told}" for number, entry in value.items() for key, told in dict(entry).items())


def _own(text: str) -> str:
    return text


def _ids(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in listed(text))


def _some(text: str) -> tuple[str, ...]:
    if not listed(text):
        raise ValueError
    return listed(text)


def _axis(text: str) -> str:
    return text.strip().removeprefix("+")


UP = Kind("choice", _axis, _nothing, f"one of {', '.join(UPS)}", UPS)
FLAG = Kind("flag", _flag, _of_type(bool), "yes or no")
WHOLE = Kind("whole", int, _of_type(int), "a whole number")
NUMBER = Kind("number", float, _of_type(int, float), "a number")
TEXT = Kind("text", str.strip, _take_text, "a name")
NAMES = Kind("list", listed, _take_names, "names with commas between")
TEXTS = Kind("list", _some, _take_texts, "names or numbers with commas between, as 3,7")
IDS = Kind("list", _ids, _take_ids, "numbers with commas between, as 3,7")
FILE = Kind("file", _own, _nothing, "the path of a file")
NETWORK = Kind("network", _own, _nothing, "a name, or the path of FILE.onnx")
FOLDER = Kind("folder", _own, _nothing, "the path of a folder")
FRAMES = Kind("text", str.strip, _take_frames, "A:B:STEP as in Python, or several with commas between")
SIZE = Kind("text", str.strip, _take_size, "a size such as 512M or 4G, or a number of bytes")
SUN = Kind("sun", str.strip, _take_sun, "auto, off, or azimuth and elevation of the sun in degrees")
OBJECTS = Kind("list", listed, _take_objects, "ID:grow=PIXELS or ID:shadow=keep")

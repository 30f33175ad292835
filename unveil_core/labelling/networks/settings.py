"""What a user may say about a segmentation network: ``FILE.toml`` beside ``FILE.onnx``. Every key is optional.

kind = "logits"              # what it gives: logits, labels, yolo or maskformer; else it is found by trying
output = "logits"            # which output, where it has several
classes = "ade20k"           # an order of classes, or a list of their names in order
white = 255.0                # value of white, else 1
mean = [0.485, 0.456, 0.406] # then subtracted from the colours, in the order of ``channels``
std = [0.229, 0.224, 0.225]  # then divided by; else ImageNet's mean and std, for yolo and with ``white`` none
channels = "BGR"             # order of colours, else RGB
window = [1024, 1024]        # height and width that a network of free size is shown at most
short_side = 1024            # images are made so small that their shorter side is no longer, else that of the window
score = 0.25                 # least score of an object (yolo)
overlap = 0.45               # objects of one kind that overlap by more are one (yolo, intersection over union)
[map]
"my name" = "car"            # Cityscapes class of a class, by name or number; "" = none
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unveil_core.base.checks.toml import read_toml
from unveil_core.base.errors import SettingsError
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.labelling.networks.class_tables import ORDERS, known_name

__all__ = ["KINDS", "NetworkSettings", "read_settings", "settings_path"]

KINDS = ("logits", "labels", "yolo", "maskformer")
LEAST_PX, MOST_PX = 16, 8192
"""Sides of a window that make sense."""


@dataclass(frozen=True)
class NetworkSettings:
    """The keys of the TOML file; None = not given.

    Attributes:
        path: of the file, which need not exist; for messages.
        kind, output, classes, mean, std, white, channels, window, short_side, score, overlap, class_map: see the module.
    """

    path: Path
    kind: str | None = None
    output: str | None = None
    classes: str | tuple[str, ...] | None = None
    mean: tuple[float, ...] | None = None
    std: tuple[float, ...] | None = None
    white: float | None = None
    channels: str = "RGB"
    window: tuple[int, int] | None = None
    short_side: int | None = None
    score: float = 0.25
    overlap: float = 0.45
    class_map: dict[str, str] = field(default_factory=dict)


def settings_path(network: Path) -> Path:
    """Where the settings of a network are looked for: ``FILE.toml`` for ``FILE.onnx``."""
    return network.with_suffix(".toml")


def read_settings(network: Path) -> NetworkSettings:
    """The settings beside a network; defaults where there is no such file.

    Raises:
        SettingsError: it is no TOML, or a key is not known or has no such value.
    """
    path = settings_path(network)
    try:
        content = read_toml(path)
    except FileNotFoundError:
        return NetworkSettings(path)
    except (OSError, ValueError) as error:
        raise SettingsError(f"Not readable TOML: {error}", path=path) from error
    given: dict[str, Any] = {}
    for key, value in content.items():
        if key not in CHECKS:
            raise SettingsError(f"has an unknown key {key!r}", path=path, mend=f"keys are {', '.join(CHECKS)}")
        check, wanted = CHECKS[key]
        try:
            given["class_map" if key == "map" else key] = check(value)
        except (TypeError, ValueError, AttributeError, OverflowError) as error:
            raise SettingsError(f"{key} = {value!r} is not understood", path=path, mend=f"give {wanted}") from error
    if max(given.get("mean", (0.0,))) > 1 and given.get("white") is None:
        raise SettingsError("mean is above 1, where white is", path=path, mend="add white = 255.0")
    return NetworkSettings(path, **given)


def _one_of(*words: str) -> Callable[[Any], str]:
    def check(value: Any) -> str:
        return words[[w.lower() for w in words].index(value.lower())]

    return check


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError
    return value


def _numbers(count: int, low: float, high: float) -> Callable[[Any], tuple[float, ...]]:
    def check(value: Any) -> tuple[float, ...]:
        numbers = tuple(_number(low, high)(v) for v in value)
        if len(numbers) != count:
            raise ValueError
        return numbers

    return check


def _number(low: float, high: float) -> Callable[[Any], float]:
    """A number in a range, ``low`` itself left out."""

    def check(value: Any) -> float:
        if isinstance(value, bool) or not low < float(value) <= high:
            raise ValueError
        return float(value)

    return check


def _sides(value: Any) -> tuple[int, int]:
    height, width = (_side(v) for v in value)
    return height, width


def _side(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not LEAST_PX <= value <= MOST_PX:
        raise ValueError
    return value


def _classes(value: Any) -> str | tuple[str, ...]:
    if isinstance(value, str):
        return _one_of(*ORDERS)(value)
    if not isinstance(value, list) or not value or not all(isinstance(v, str) for v in value):
        raise ValueError
    return tuple(value)


def _map(value: Any) -> dict[str, str]:
    """Names of Cityscapes classes by name or number of the network's own, "" for none."""
    found = {}
    for name, target in value.items():
        city = "" if target in ("", "void") else known_name(target)
        if city is None:
            raise ValueError
        found[str(name)] = city
    return found


CHECKS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "kind": (_one_of(*KINDS), "one of " + ", ".join(KINDS)),
    "output": (_text, "the name of an output"),
    "classes": (_classes, f"a list of names, or one of {', '.join(ORDERS)}"),
    "mean": (_numbers(3, -1e4, 1e4), "three numbers"),
    "std": (_numbers(3, 0, 1e4), "three numbers above 0"),
    "white": (_number(0, 65535), "a number above 0, as 1 or 255"),
    "channels": (_one_of("RGB", "BGR"), "RGB or BGR"),
    "window": (_sides, f"[height, width] in pixels, {LEAST_PX} to {MOST_PX}"),
    "short_side": (_side, f"pixels, {LEAST_PX} to {MOST_PX}"),
    "score": (_number(-1e-9, 1), "a number from 0 to 1"),
    "overlap": (_number(0, 1), "a number above 0, at most 1"),
    "map": (_map, f"names of Cityscapes classes: {', '.join(CITYSCAPES)}"),
}
"""For each key, what checks its value, and what is wanted, for messages."""

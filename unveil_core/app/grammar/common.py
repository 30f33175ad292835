"""Options that several verbs take, and what their arguments may be."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from unveil_core.app.grammar.parsers import CommandParser
from unveil_core.app.grammar.setting_options import add_settings as add_each_setting
from unveil_core.base.kernels.device import DEVICES

__all__ = [
    "MESSAGES",
    "add_common",
    "add_device",
    "add_footage",
    "add_replace",
    "add_settings",
    "add_yes",
    "metres",
    "names_of",
    "number",
    "size_of",
]

MESSAGES = {
    "json": (("--json",), "JSON lines on standard output, errors too"),
    "quiet": (("-q", "--quiet"), "warnings and errors alone"),
    "verbose": (("-v", "--verbose"), "each step, with its figures"),
    "debug": (("--debug",), "show tracebacks"),
}
"""Options of all verbs, before or after them, with their help."""
SETTINGS_FILE = 'settings from a file, as quality = "draft"'


def add_common(p: CommandParser) -> None:
    """What is told, and how; of all verbs."""
    group = p.add_argument_group("messages")
    told_apart = "--help-all" in p._option_string_actions
    for name, (words, text) in MESSAGES.items():  # a default here would write over what was given before the verb
        add = p.expert if told_apart and name == "debug" else argparse._ArgumentGroup.add_argument
        add(group, *words, dest=name, action="store_true", default=argparse.SUPPRESS, help=text)
    add = p.expert if told_apart else argparse._ArgumentGroup.add_argument
    text = "cancel when standard input closes: when the program that started this one ends"
    add(group, "--end-with-stdin", action="store_true", help=text)


def add_settings(p: CommandParser) -> None:
    """The settings of a run, from a file, or each by its option."""
    p.add_argument("--settings", type=Path, default=None, metavar="FILE.toml", help=SETTINGS_FILE)
    add_each_setting(p)


def add_replace(p: CommandParser, what: str) -> None:
    """Of a verb that otherwise refuses to write over what it did not make. One word for all of them."""
    p.add_argument("--replace", action="store_true", help=what)


def add_yes(p: CommandParser) -> None:
    """Of a verb that asks before it begins what is most probably a mistake; without a terminal it ends instead."""
    p.add_argument("--yes", action="store_true", help="go on where a check of the drive would ask")


def add_device(p: CommandParser) -> None:
    """Of a verb that is no run: its device is recorded nowhere."""
    p.add_argument(
        "--device",
        dest="works_on",
        default="auto",
        choices=DEVICES,
        help="device to render and train on: an NVIDIA GPU where one can be used, else the processor",
    )


def add_footage(p: CommandParser, *, hidden: bool = False) -> None:
    """Options of clips and photographs, which ``unveil run`` takes as well; hidden: only ``--help-all`` explains them."""
    group = p.add_argument_group("clips and photographs")

    def add(name: str, **options: Any) -> None:
        options["default"] = argparse.SUPPRESS
        if hidden:
            p.expert(group, name, **options)
        else:
            group.add_argument(name, **options)

    add("--every", type=int, metavar="N", help="each N-th frame alone")
    add("--lens", choices=("simple", "opencv", "fisheye"), help="model of the lens [simple]")
    add("--focal", metavar="PIXELS|26mm", help="focal length, in pixels or as of 35 mm film [found]")
    add("--speed", type=number, metavar="KM/H", help="mean speed: gives the scale")
    add("--known-length", type=number, metavar="METRES", help="length of the way: gives the scale")
    add("--gpx", type=Path, metavar="FILE.gpx", help="track of the drive: gives the scale")
    add("--thorough", action="store_true", help="three times the features, in three times the time")


def metres(text: str) -> float | None:
    """A length, or None for "auto". Raises argparse.ArgumentTypeError."""
    try:
        return None if text.strip() == "auto" else float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"Not a number of metres, and not auto: {text!r}") from error


def number(text: str) -> float:
    """A number. Raises argparse.ArgumentTypeError."""
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"Not a number: {text!r}") from error


def names_of(text: str) -> tuple[str, ...]:
    """Names between commas."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def size_of(text: str) -> tuple[int, int]:
    """Width and height of a picture, as 480x320, pixels. Raises argparse.ArgumentTypeError."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"Not a size such as 480x320: {text}")
    return int(width), int(height)

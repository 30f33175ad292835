"""The options that give the settings of a run: a row of the table each."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from unveil_core.app.grammar.parsers import CommandParser
from unveil_core.pipeline.options.table import AUTO, GROUPS, SETTINGS, TABLE, Setting

__all__ = ["add_setting", "add_settings"]


class _Names(tuple[str, ...]):
    """The names of a choice. What a setting falls back to is one of them, too, though it is none that is shown."""

    default: object = None

    def __contains__(self, value: object) -> bool:
        return value == self.default or super().__contains__(value)


class _Added(argparse.Action):
    """Adds to what was given before."""

    def __call__(self, parser: object, namespace: argparse.Namespace, values: Any, option: str | None = None) -> None:
        setattr(namespace, self.dest, (*getattr(namespace, self.dest, ()), *values))


def add_settings(p: CommandParser) -> None:
    """An option for each setting, under the setting's name.

    An option that is not given leaves no attribute behind: the setting keeps its default or, on a workspace, its recorded value.
    """
    p.description = f"Defaults stand in brackets; {AUTO} brings one back."
    groups = {name: p.add_argument_group(title) for name, title in GROUPS.items()}
    for setting in TABLE:
        _add(p, groups[setting.group], setting)
    p.add_help_all()


def add_setting(p: CommandParser, name: str) -> None:
    """The option of one setting, for a verb that takes no others."""
    _add(p, p, SETTINGS[name], hidden=False)


def _add(p: CommandParser, group: Any, setting: Setting, *, hidden: bool = True) -> None:
    names = f"{', '.join(setting.kind.names)}: " if setting.metavar and setting.kind.names else ""
    said = f"{names}{setting.help} [{setting.said_default}]".replace("%", "%%")
    options: dict[str, Any] = {"dest": setting.name, "default": argparse.SUPPRESS, "help": said}
    if setting.kind.shape == "flag":
        options["action"] = argparse.BooleanOptionalAction
    else:
        options["type"] = _parsed(setting)
        if setting.repeated:
            options["action"] = _Added
        options["metavar"] = setting.metavar or "|".join(setting.kind.names)
        if setting.kind.names:
            options["choices"] = _Names(setting.kind.names)
            options["choices"].default = setting.default
    if setting.expert and hidden:
        p.expert(group, setting.option, **options)
    else:
        group.add_argument(setting.option, **options)


def _parsed(setting: Setting) -> Callable[[str], Any]:
    def parse(text: str) -> Any:
        try:
            return setting.parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse

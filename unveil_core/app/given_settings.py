"""The settings of a run as the command line gives them."""

from __future__ import annotations

import argparse
from typing import Any

from unveil_core.pipeline.options.given import settings_over
from unveil_core.pipeline.options.table import TABLE
from unveil_core.pipeline.settings import RunSettings

__all__ = ["given_settings", "settings_of"]


def given_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """The settings that a command names, by name: in its file of settings, and over these by its options."""
    given: dict[str, Any] = {}
    if getattr(arguments, "settings", None) is not None:
        from unveil_core.pipeline.options.toml_file import read_settings_file

        given = read_settings_file(arguments.settings)
    return given | {s.name: getattr(arguments, s.name) for s in TABLE if hasattr(arguments, s.name)}


def settings_of(arguments: argparse.Namespace, before: RunSettings | None = None) -> RunSettings:
    """The settings that the command line gives, over those before or else the defaults."""
    return settings_over(before or RunSettings(), given_settings(arguments))

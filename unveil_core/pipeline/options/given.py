"""Settings from what is given: keywords of Python, a file, words of the command; over others."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.options.table import SETTINGS, TABLE
from unveil_core.pipeline.settings import RunSettings

__all__ = ["changed_from_default", "settings_of_values", "settings_over"]

EXCLUSIVE = (("scale", "camera_height"), ("labels", "segmenter"))
"""Settings of which one alone can be given."""


def settings_of_values(values: Mapping[str, object], before: RunSettings | None = None) -> RunSettings:
    """Settings of values as Python or TOML has them, over others.

    Args:
        values: by name; None and "auto" take a setting back to its default.
        before: the others; the defaults where it is None.
    Raises:
        SettingsError: an unknown name, or a value that the setting does not take.
    """
    taken: dict[str, Any] = {}
    for name, value in values.items():
        if name not in SETTINGS:
            near = difflib.get_close_matches(str(name), SETTINGS, 1)
            raise SettingsError(
                f"Not a setting: {name}",
                mend=f"did you mean {near[0]}?" if near else "`unveil run --help-all` lists all",
            )
        taken[name] = SETTINGS[name].take(value)
    return settings_over(before or RunSettings(), taken)


def settings_over(before: RunSettings, given: Mapping[str, Any]) -> RunSettings:
    """Settings with others over them. What is given takes the place of what it excludes.

    Args:
        given: by name, as ``RunSettings`` has them.
    """
    changed = dict(given)
    for one, other in (*EXCLUSIVE, *(pair[::-1] for pair in EXCLUSIVE)):
        if one in given and other not in given and given[one] != SETTINGS[one].default:
            changed[other] = SETTINGS[other].default
    return replace(before, **changed)


def changed_from_default(settings: RunSettings) -> dict[str, str]:
    """The settings that are not the default ones, by name, each as the command takes it."""
    found = {}
    for setting in TABLE:
        value = getattr(settings, setting.name)
        if value != setting.default:
            found[setting.name] = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
    return found

"""A file of settings: ``unveil run --settings FILE.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unveil_core.base.checks.toml import read_toml
from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.options.given import settings_of_values
from unveil_core.pipeline.options.table import SETTINGS

__all__ = ["read_settings_file"]

PATHS = ("file", "folder", "network")
"""Shapes of settings that name files."""


def read_settings_file(path: Path) -> dict[str, Any]:
    """The settings of a TOML file, ``quality = "draft"`` and so on, as ``RunSettings`` has them.

    Names are those of the API. Paths are relative to the folder of the file.

    Raises:
        SettingsError: it cannot be read, is no TOML, or names what is no setting.
    """
    try:
        values = read_toml(path)
    except OSError as error:
        problem = f"Not readable: {error.strerror or error}"
        raise SettingsError(problem, path=path, mend="name a TOML file of settings") from error
    except ValueError as error:
        raise SettingsError(
            f"Not a TOML file: {error}", path=path, mend='write lines such as quality = "draft"'
        ) from error
    try:
        made = settings_of_values(values)
    except SettingsError as error:
        raise SettingsError(error.problem, path=path, mend=error.mend) from error
    return {name: _placed(name, getattr(made, name), values[name], path) for name in values}


def _placed(name: str, value: Any, written: Any, path: Path) -> Any:
    """A path as seen from the file's folder."""
    if SETTINGS[name].kind.shape not in PATHS or value is None or value == written:
        return value  # none, a name, or absolute already
    return str((path.absolute().parent / Path(written).expanduser()).absolute())

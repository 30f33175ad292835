"""A run by keywords, over the settings that its workspace was made with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from unveil_core.pipeline.options.given import settings_of_values
from unveil_core.pipeline.options.kept import kept_settings
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import silent

__all__ = ["run_with"]


def run_with(
    drive: Path,
    workspace: Path,
    settings: RunSettings | None,
    keywords: Mapping[str, Any],
    *,
    until: str | None,
    reset: bool = False,
    replace: bool = False,
    yes: bool = False,
    reporter: Callable[[dict[str, object]], None] | None = None,
) -> Path:
    """Run the stages; returns the workspace's folder. Arguments and errors as :func:`unveil_core.run`."""
    told = ""
    if settings is None:
        kept = kept_settings(workspace, drive, keywords, reset=reset, replace=replace)
        settings, told = kept.settings, kept.message
    whole = settings_of_values(keywords, settings)
    given: dict[str, Any] = {"until": until, "replace": replace, "yes": yes, "told": told}
    return run(drive, workspace, whole, **given, reporter=reporter or silent).root

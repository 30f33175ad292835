"""The settings of a run as the command line gives them."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace

from unveil_core.pipeline.settings import RunSettings

__all__ = ["settings_of"]


def settings_of(arguments: argparse.Namespace, before: RunSettings | None = None) -> RunSettings:
    """The settings that the command line gives, over those before or else the defaults."""
    given = {f.name: getattr(arguments, f.name) for f in fields(RunSettings) if hasattr(arguments, f.name)}
    return replace(before or RunSettings(), **given)

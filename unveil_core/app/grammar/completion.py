"""Completion of the command in a shell, as shtab writes it."""

from __future__ import annotations

import argparse

from unveil_core.base.errors import SettingsError

__all__ = ["completion_of"]


def completion_of(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script that teaches a shell the command's verbs, options and choices.

    Raises:
        SettingsError: shtab is missing.
    """
    try:
        import shtab
    except ImportError as error:
        raise SettingsError("Not installed: shtab", mend="pip install shtab") from error
    return str(shtab.complete(parser, shell=shell))

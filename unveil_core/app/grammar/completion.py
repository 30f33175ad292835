"""Completion of the command in a shell, as shtab writes it."""

from __future__ import annotations

from unveil_core.app.grammar.parsers import MainParser
from unveil_core.base.errors import SettingsError

__all__ = ["completion_of"]


def completion_of(parser: MainParser, shell: str) -> str:
    """The script that teaches a shell the command's verbs, options and choices, those for experts too.

    Raises:
        SettingsError: shtab is missing.
    """
    try:
        import shtab
    except ImportError as error:
        raise SettingsError("Not installed: shtab", mend="pip install shtab") from error
    for verb in parser.verbs().values():
        for action, text in verb.experts:
            action.help = text
    return str(shtab.complete(parser, shell=shell))

"""Questions before work begins: at a terminal they are asked, elsewhere they end the command with a line that names ``--yes``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import TypeVar

from unveil_core.app.console import say
from unveil_core.base.errors import ConfirmError

__all__ = ["confirmed"]

T = TypeVar("T")


def confirmed(arguments: argparse.Namespace, begin: Callable[[bool], T]) -> T:
    """What ``begin`` returns, which is given whether to go on where it would have the user confirm something.

    Raises:
        ConfirmError: there is nobody to ask, or the answer is no.
    """
    yes = bool(getattr(arguments, "yes", False))
    try:
        return begin(yes)
    except ConfirmError as error:
        if not _somebody_listens(arguments):
            raise
        say(f"unveil: {error}", sys.stderr)
        print("Go on all the same? [y/N] ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise
    return begin(True)


def _somebody_listens(arguments: argparse.Namespace) -> bool:
    """Whether a person is at both ends: a batch is never to wait for an answer."""
    if arguments.json or arguments.end_with_stdin or sys.stdin is None:
        return False
    return sys.stdin.isatty() and sys.stderr.isatty()

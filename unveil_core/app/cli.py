"""The ``unveil`` command. Exit 0 done, 1 failed, 2 bad input or usage, 130 cancelled."""

from __future__ import annotations

import sys

from unveil_core.app.parser import command_parser
from unveil_core.app.stdin_watch import end_with_stdin
from unveil_core.app.verbs import VERBS
from unveil_core.base.errors import Cancelled, DiskFullError, UnveilError

__all__ = ["main"]


def main(argv: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    try:
        arguments = command_parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0) if isinstance(stop.code, int | None) else 2
    try:
        if arguments.end_with_stdin:
            end_with_stdin()
        return VERBS[arguments.verb](arguments)
    except UnveilError as error:
        print(f"unveil: error: {error}", file=sys.stderr)
        return 2
    except DiskFullError as error:
        print(f"unveil: failed: {error}", file=sys.stderr)
        return 1
    except (Cancelled, KeyboardInterrupt):
        print("unveil: cancelled; run the same command again to go on", file=sys.stderr)
        return 130
    except Exception as error:
        if arguments.debug:
            raise
        where = "the traceback is in the workspace's events.jsonl; --debug shows it"
        print(f"unveil: failed: {type(error).__name__}: {error} ({where})", file=sys.stderr)
        return 1


if __name__ == "__main__":
    raise SystemExit(main())

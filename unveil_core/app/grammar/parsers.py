"""Parsers whose help fits the screen: options in groups, those for experts under ``--help-all``, examples at the end."""

from __future__ import annotations

import argparse
import difflib
import json
import sys
import textwrap
import time
from typing import Any

from unveil_core.app.grammar.examples import EXAMPLES
from unveil_core.base.wording import shown
from unveil_core.pipeline.settings import UPS

__all__ = ["CommandParser", "MainParser"]

WIDEST = 100
"""Columns of a page of help: more are hard to read."""
COLUMN = 26
"""At which help of an option begins."""
USAGE_ERROR = 2

VERB_GROUPS = {
    "start here": ("demo", "solve", "check", "mask", "run", "import", "status"),
    "results": ("render", "export", "evaluate"),
    "many drives, this machine": ("batch", "run-block", "bench", "doctor", "completion"),
}
"""Verbs by what they are for; all others are stages."""


class _Lines(argparse.RawDescriptionHelpFormatter):
    """Help of options wrapped, descriptions and examples as they are."""

    def __init__(self, prog: str, **options: Any) -> None:
        super().__init__(prog, max_help_position=COLUMN, **options)
        self._width = min(self._width, WIDEST - 2)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        """``-o, --output FILE``: the value once."""
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        value = self._format_args(action, self._get_default_metavar_for_optional(action))
        return f"{', '.join(action.option_strings)} {value}"


class _HelpAll(argparse.Action):
    """Show all options."""

    def __init__(self, option_strings: Any, dest: str, **options: Any) -> None:
        super().__init__(
            option_strings, argparse.SUPPRESS, nargs=0, default=argparse.SUPPRESS, help=options.get("help")
        )

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        parser.print_help(whole=True)
        parser.exit()


class CommandParser(argparse.ArgumentParser):
    """Usage errors are one line and exit 2; ``--up -y`` is a value, not an option."""

    as_json = False
    """Whether the command that is being parsed asks for JSON, of which its parsers of verbs see but their own part."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"formatter_class": _Lines, **options})
        self.experts: list[tuple[argparse.Action, str]] = []

    def expert(self, group: Any, *names: str, help: str, **options: Any) -> None:
        """Add an option that only ``--help-all`` shows."""
        self.experts.append((group.add_argument(*names, help=argparse.SUPPRESS, **options), help))

    def add_help_all(self) -> None:
        """Add the option that shows those."""
        self.add_argument("--help-all", action=_HelpAll, help="all options, those for experts too")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        words: list[str] = []
        for word in sys.argv[1:] if args is None else args:
            if words and words[-1] == "--up" and word in UPS:
                words[-1] = f"--up={word}"
            else:
                words.append(word)
        CommandParser.as_json = CommandParser.as_json or "--json" in words
        return super().parse_known_args(words, namespace)

    def error(self, message: str) -> Any:
        line = f"{shown(message)} (see {self.prog} --help)"
        if CommandParser.as_json:
            event = {"t": round(time.time(), 3), "stage": "", "done": 0, "total": 0, "message": line, "level": "error"}
            print(json.dumps({**event, "mend": f"see {self.prog} --help", "exit_code": USAGE_ERROR}), flush=True)
        print(f"unveil: error: {line}", file=sys.stderr)
        raise SystemExit(USAGE_ERROR)

    def print_help(self, file: Any = None, *, whole: bool = False) -> None:
        for action, text in self.experts:
            action.help = text if whole else argparse.SUPPRESS
        super().print_help(file)

    def format_help(self) -> str:
        verb = self.prog.removeprefix("unveil ")
        examples = "\n".join(f"  {line}" for line in EXAMPLES.get(verb, ()))
        self.epilog = f"examples:\n{examples}" if examples else None
        self.usage = self._short_usage()
        return super().format_help()

    def _short_usage(self) -> str:
        """What must be given, and ``[options]`` for the rest."""
        words = [self.prog]
        for action in self._actions:
            if action.option_strings and action.required:
                words += [action.option_strings[0], str(action.metavar or action.dest.upper())]
            elif not action.option_strings:
                name = action.metavar or ("|".join(map(str, action.choices)) if action.choices else action.dest.upper())
                name = f"{name}..." if action.nargs == "+" else str(name)
                words.append(f"[{name}]" if action.nargs == "?" else name)
        return " ".join([*words, "[options]"]).replace("%", "%%")


class MainParser(CommandParser):
    """The parser of ``unveil`` itself: its verbs by what they are for."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        CommandParser.as_json = False
        return super().parse_known_args(args, namespace)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        given, unknown = self.parse_known_args(args, namespace)
        if unknown:
            verb: CommandParser = self.verbs().get(given.verb, self)
            near = difflib.get_close_matches(unknown[0].partition("=")[0], verb._option_string_actions, 1)
            verb.error(f"unrecognized arguments: {' '.join(unknown)}{f'; did you mean {near[0]}?' if near else ''}")
        return given

    def verbs(self) -> dict[str, Any]:
        """The parsers of all verbs by name."""
        return dict(next(a for a in self._actions if isinstance(a, argparse._SubParsersAction)).choices)

    def format_help(self) -> str:
        verbs = next(a for a in self._actions if isinstance(a, argparse._SubParsersAction))
        helps = {entry.dest: str(entry.help) for entry in verbs._choices_actions}
        named = [verb for group in VERB_GROUPS.values() for verb in group]
        groups = {**VERB_GROUPS, "one stage of a workspace": tuple(v for v in helps if v not in named)}
        lines = [f"usage: {self.prog} VERB ...", "", str(self.description)]
        for title, members in groups.items():
            lines += ["", f"{title}:"]
            for verb in (v for v in members if v in helps):
                lines += textwrap.wrap(
                    f"{verb:<15} {helps[verb]}", WIDEST - 4, initial_indent="    ", subsequent_indent=" " * 20
                )
        lines += ["", "options, before or after the verb:"]
        for action in self._actions:
            if action.option_strings:
                lines.append(f"    {', '.join(action.option_strings):<15} {action.help}")
        return "\n".join([*lines, "", f"{self.prog} VERB --help explains a verb.", ""])

"""What a run assumed of a drive: each assumption is tested on the data, and where it does not hold something else is done."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from unveil_core.base.checks.fields import checked

__all__ = ["Assumption", "assumed", "recorded_assumptions"]

KEY = "assumptions"
"""Entry of a stage in workspace.json."""


@dataclass(frozen=True)
class Assumption:
    """One assumption and what the data say of it.

    Attributes:
        name: what is assumed, in a few words.
        holds: whether it does.
        found: what was measured, in a few words.
        instead: what is done where it does not hold.
    """

    name: str
    holds: bool
    found: str
    instead: str

    def message(self) -> str:
        """One line for a log, of one that does not hold."""
        return f"not so: {self.name} ({self.found}); {self.instead}"


def assumed(assumptions: Iterable[Assumption]) -> dict[str, object]:
    """The entry that a stage records in workspace.json."""
    return {KEY: [asdict(a) for a in assumptions]}


def recorded_assumptions(stages: dict[str, Any]) -> list[tuple[str, Assumption]]:
    """Those of all stages of a workspace.json, with the stage's name; entries that are none are left out."""
    found = []
    for name, stage in stages.items():
        entries = stage.get(KEY) if isinstance(stage, dict) else None
        for entry in entries if isinstance(entries, list) else ():
            try:
                found.append((name, checked(Assumption, entry)))
            except (TypeError, ValueError):
                continue
    return found

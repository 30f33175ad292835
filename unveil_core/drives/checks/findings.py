"""What a look over a drive found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

__all__ = ["Finding", "worst_first"]


@dataclass(frozen=True)
class Finding:
    """Something that looks wrong.

    Attributes:
        problem: what, in one line.
        mend: what to do about it.
        asks: so surely a mistake that nothing is begun before the user says so.
    """

    problem: str
    mend: str
    asks: bool = False

    @property
    def line(self) -> str:
        """Problem and mend."""
        return f"{self.problem} ({self.mend})"


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings that ask before the others; among their like in the given order."""
    return tuple(sorted(findings, key=lambda f: not f.asks))

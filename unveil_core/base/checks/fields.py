"""Dataclasses made of what a JSON file holds: what a file of a stranger has is compared with the types of the fields first."""

from __future__ import annotations

import math
from dataclasses import MISSING, fields
from typing import Any, TypeVar

__all__ = ["checked", "is_of_kind"]

_T = TypeVar("_T")


def checked(kind: type[_T], entry: object) -> _T:
    """An instance of a dataclass of plain fields: numbers, texts, and tuples of them.

    Args:
        kind: the dataclass, whose module has ``from __future__ import annotations``.
        entry: its fields by name, lists for tuples.
    Raises:
        TypeError: it is no object, or lacks a field.
        ValueError: a field that the class does not have, or of another kind.
    """
    if not isinstance(entry, dict):
        raise TypeError(f"not an object: {str(entry)[:40]!r}")
    known = {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    given: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()}
    for name, value in given.items():
        if name not in known or not is_of_kind(value, str(known[name].type)):
            raise ValueError(f"{str(name)[:40]} = {str(value)[:40]!r}")
    lacking = [n for n, f in known.items() if n not in given and f.default is MISSING and f.default_factory is MISSING]
    if lacking:
        raise TypeError(f"it lacks {lacking[0]}")
    return kind(**given)


def is_of_kind(value: object, kind: str) -> bool:
    """Whether a value is what a field's type says, as ``int | None`` or ``tuple[str, ...]``; numbers are finite."""
    if value is None or isinstance(value, bool):
        return kind.endswith("| None") if value is None else kind == "bool"
    if isinstance(value, tuple):
        return kind.startswith("tuple[") and all(is_of_kind(v, kind[len("tuple[") :].partition(",")[0]) for v in value)
    if isinstance(value, float) and not math.isfinite(value):
        return False
    plain = kind.removesuffix(" | None")
    return type(value).__name__ == plain or (isinstance(value, int) and plain == "float")

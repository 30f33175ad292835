"""Numbers in names count as numbers: frame2 comes before frame10, whoever sorts. Names are texts of strangers, of any length."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = ["AS_TEXTS", "BY_NUMBERS", "Columns", "columns_of", "counting_numbers", "name_orders", "natural_key"]

DIGITS = re.compile(r"([0-9]+)")
DECIMAL = re.compile(r"([0-9]+\.[0-9]+|[0-9]+)")
MOST_DIGITS = 18
"""Of a number that counts frames: 64 bits hold no more."""
SIGNED = re.compile(r"(?<![0-9])-(?=[0-9])")

BY_NUMBERS, AS_TEXTS = "the numbers in their names", "their names as texts"
"""What names go by; where both are the same it is "their names"."""

NaturalKey = tuple[tuple[str | tuple[int, str], ...], str]
Columns = list[tuple[str, ...]]
"""For each name its parts, text and number in turns, text first and last; all names have as many."""


def natural_key(text: str) -> NaturalKey:
    """What texts are sorted by for their numbers to count as numbers; no two texts have one key."""
    parts = DIGITS.split(text)
    return tuple(_number(p) if i % 2 else p.casefold() for i, p in enumerate(parts)), text


def _number(digits: str) -> tuple[int, str]:
    """Sorts as the number does, without a limit on its digits."""
    bare = digits.lstrip("0")
    return len(bare), bare


def columns_of(names: Sequence[str]) -> Columns | None:
    """The parts of names that are built alike, None where they are not."""
    found: Columns = [tuple(DIGITS.split(name)) for name in names]
    return found if len({len(parts) for parts in found}) == 1 and len(found[0]) > 1 else None


def counting_numbers(names: Sequence[str]) -> list[int] | None:
    """The number by which names count: the only part in which they differ, or names that are numbers alone.

    Returns:
        one for each name, not in the order of size; None where there is no such number.
    """
    columns = columns_of(names) if names else None
    if columns is None:
        return None
    varying = [k for k, part in enumerate(zip(*columns, strict=True)) if len(set(part)) > 1]
    if len(columns) == 1 or not varying:
        varying = [len(columns[0]) - 2]
    if len(varying) != 1 or varying[0] % 2 == 0 or any(len(c[varying[0]]) > MOST_DIGITS for c in columns):
        return None
    return [int(c[varying[0]]) for c in columns]


def name_orders(names: Sequence[str]) -> list[tuple[str, list[int]]]:
    """The orders in which names can be meant, the likeliest first, each once: what they go by, and indices.

    Numbers as numbers; with points in them, or with signs; by one of several numbers alone; as texts.
    """
    some = range(len(names))
    keys: list[tuple[str, list[object]]] = [(BY_NUMBERS, [natural_key(n) for n in names])]
    if any("." in n for n in names):
        keys.append(("the decimal numbers in their names", [_decimal_key(n) for n in names]))
    if any(SIGNED.search(n) for n in names) and not all(SIGNED.search(n) for n in names):
        keys.append(("the signed numbers in their names", [_signed_key(n) for n in names]))
    columns = columns_of(names) if names else None
    if columns is not None:
        numbers = [k for k in range(1, len(columns[0]), 2) if len({c[k] for c in columns}) > 1]
        if len(numbers) > 1:
            which = ("first", "second", "third", "fourth")
            for place, k in list(enumerate(numbers))[:4]:
                told = f"the {which[place]} number in their names"
                keys.append((told, [(_number(c[k]), natural_key(n)) for c, n in zip(columns, names, strict=True)]))
    keys.append((AS_TEXTS, list(names)))
    found: dict[tuple[int, ...], str] = {}
    for told, values in keys:
        found.setdefault(tuple(sorted(some, key=lambda i: values[i])), told)  # type: ignore[arg-type, return-value]
    told_of = {"their names" if AS_TEXTS not in found.values() and t == BY_NUMBERS else t: o for o, t in found.items()}
    return [(told, list(order)) for told, order in told_of.items()]


def _decimal_key(text: str) -> object:
    parts = DECIMAL.split(text)
    return tuple(
        (*_number(whole), fraction) if i % 2 else p.casefold()
        for i, p in enumerate(parts)
        for whole, _, fraction in (p.partition("."),)
    ), text


def _signed_key(text: str) -> object:
    parts = re.split(r"((?<![0-9])-?[0-9]+)", text)
    return tuple(_signed(p) if i % 2 else p.casefold() for i, p in enumerate(parts)), text


def _signed(digits: str) -> tuple[int, tuple[int, ...]]:
    """Sorts as the number does: of negative ones the larger come first."""
    length, bare = _number(digits.removeprefix("-"))
    values = (length, *(int(d) for d in bare))
    return (-1, tuple(-v for v in values)) if digits.startswith("-") else (1, values)

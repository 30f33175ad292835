"""Values of a pickle made plain, however often its lists name one another."""

from __future__ import annotations

import pickle
from typing import Any

from unveil_core.drives.formats.pickled.stand_ins import Array, Kind, StandIn

__all__ = ["Plain"]

MOST_HELD = 1 << 21
"""Values in lists, tuples and dicts, those that stand in several places counted in each: sixty that name one another are more than
any loop comes to the end of."""


class Plain:
    """Makes values plain: with the arrays that their stand-ins stand for, however deep.

    Attributes:
        done: what was seen before, by identity, each with what was made of it and how many values it holds. It also keeps the
            values, so that no other gets their identity.
    """

    def __init__(self) -> None:
        self.done: dict[int, tuple[Any, Any, int]] = {}

    def of(self, value: Any) -> Any:
        """The plain value."""
        return self._of(value)[0]

    def _of(self, value: Any) -> tuple[Any, int]:
        if not isinstance(value, tuple | list | dict | StandIn):
            return value, 1
        if id(value) in self.done:
            _, made, held = self.done[id(value)]
            if not held:
                raise pickle.UnpicklingError("a list lies within itself")
            return made, held
        self.done[id(value)] = value, None, 0
        made, held = self._made(value)
        if held > MOST_HELD:
            raise pickle.UnpicklingError(f"its lists hold more than {MOST_HELD:,} values")
        self.done[id(value)] = value, made, held
        return made, held

    def _made(self, value: Any) -> tuple[Any, int]:
        if isinstance(value, Array):
            array = value.made()
            held = 1
            if array.dtype.hasobject:
                for i, inner in enumerate(array.flat):
                    array.flat[i], more = self._of(inner)
                    held += more
            return array, held
        if isinstance(value, StandIn):
            if isinstance(value, Kind):
                return value, 1
            value.arguments, first = self._of(value.arguments)
            value.state, second = self._of(value.state)
            return value, first + second
        parts = [self._of(v) for v in (value.values() if isinstance(value, dict) else value)]
        held = 1 + sum(more for _, more in parts)
        if isinstance(value, tuple):
            return tuple(part for part, _ in parts), held
        if isinstance(value, dict):
            value.update(zip(value, (part for part, _ in parts), strict=True))
        else:
            value[:] = [part for part, _ in parts]
        return value, held

"""Python's own unpickler, held to the names that it may get, to stand-ins, and to a number of steps.

Not the one in C, which makes room for whatever a pickle announces.
"""

from __future__ import annotations

import io
import pickle
import struct
from collections.abc import Callable, Mapping
from typing import Any

from unveil_core.drives.formats.pickled import stand_ins
from unveil_core.drives.formats.pickled.stand_ins import StandIn, check_keys

__all__ = ["MOST_STEPS", "Restricted"]

MOST_STEPS = 1 << 20
"""Of the program that a pickle is, each of which makes an object at most. A table has some hundred, and two for each text; a scene
of a thousand frames with dicts of small arrays has 300,000."""
NUMBER_BYTES, NUMBER_DIGITS = 9, 20
"""Of a whole number of 64 bits, with and without a sign."""


_IN_PYTHON: Any = pickle._Unpickler  # type: ignore[attr-defined]


class Restricted(_IN_PYTHON):  # type: ignore[misc]
    """The unpickler.

    Args:
        stream: of the pickle; admitted: what it may name, by module and name, and what it gets for that.
    Raises:
        pickle.UnpicklingError: from ``load``, where it does anything else; whatever damaged pickles make go wrong, likewise.
    """

    dispatch = dict(_IN_PYTHON.dispatch)

    def __init__(self, stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any]) -> None:
        super().__init__(stream)
        self.admitted, self.steps = admitted, 0

    def find_class(self, module: str, name: str) -> Any:
        try:
            return self.admitted[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which no such file needs") from None

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("it refers to objects outside of it")

    def load_build(self) -> None:
        """Only stand-ins get a state: a pickle could set attributes of functions as well."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], StandIn):
            raise pickle.UnpicklingError("it gives a state to what has none")
        self.stack[-1].__setstate__(state)

    def load_bytearray8(self) -> None:
        """Without making room before it is there."""
        (length,) = struct.unpack("<Q", self.read(8))
        content = self.read(length) if length <= stand_ins.MOST_BYTES else b""
        if len(content) != length:
            raise pickle.UnpicklingError("it ends too soon")
        self.append(bytearray(content))

    def load_long1(self) -> None:
        self._load_number(self.read(1)[0])

    def load_long4(self) -> None:
        (count,) = struct.unpack("<i", self.read(4))
        self._load_number(count)

    def _load_number(self, count: int) -> None:
        """Of a number of a megabyte, arithmetic takes minutes."""
        if not 0 <= count <= NUMBER_BYTES:
            raise pickle.UnpicklingError("a number has more than 64 bits")
        self.append(pickle.decode_long(self.read(count)))

    def load_digits(self) -> None:
        """A number in digits, as protocol 0 writes it; 00 and 01 are truth values."""
        line = self.readline()[:-1]
        digits = line.removesuffix(b"L")
        if len(digits) > NUMBER_DIGITS:
            raise pickle.UnpicklingError("a number has more than 64 bits")
        self.append(line == b"01" if line in (b"00", b"01") else int(digits))

    def load_setitem(self) -> None:
        check_keys(self.stack[-2:-1])
        _IN_PYTHON.load_setitem(self)

    def load_setitems(self) -> None:
        check_keys(self.stack[::2])
        _IN_PYTHON.load_setitems(self)

    def load_dict(self) -> None:
        check_keys(self.stack[::2])
        _IN_PYTHON.load_dict(self)

    dispatch[pickle.BUILD[0]] = load_build
    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8
    dispatch[pickle.LONG1[0]], dispatch[pickle.LONG4[0]] = load_long1, load_long4
    dispatch[pickle.INT[0]] = dispatch[pickle.LONG[0]] = load_digits
    dispatch[pickle.SETITEM[0]], dispatch[pickle.SETITEMS[0]] = load_setitem, load_setitems
    dispatch[pickle.DICT[0]] = load_dict
    for _step in (pickle.EMPTY_SET, pickle.ADDITEMS, pickle.FROZENSET, pickle.EXT1, pickle.EXT2, pickle.EXT4):
        del dispatch[_step[0]]  # of no table: sets may hold what keys may not be


def _counted(step: Callable[[Any], None]) -> Callable[[Any], None]:
    def counted(unpickler: Any) -> None:
        unpickler.steps += 1
        if unpickler.steps > MOST_STEPS:
            raise pickle.UnpicklingError(f"it has more than {MOST_STEPS:,} steps, which no such file needs")
        step(unpickler)

    return counted


Restricted.dispatch = {code: _counted(step) for code, step in Restricted.dispatch.items()}

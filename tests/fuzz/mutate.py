"""Which kind of change fits a file, by what it holds."""

from __future__ import annotations

import json
from random import Random
from typing import Protocol

from tests.fuzz.mutate_binary import BinaryMutator
from tests.fuzz.mutate_text import JsonMutator, TextMutator

__all__ = ["Mutator", "mutator_of"]


class Mutator(Protocol):
    """Changed copies of one file."""

    def mutate(self, rng: Random) -> bytes:
        """One of them; of equal generators the same."""


def mutator_of(content: bytes) -> Mutator:
    """The mutator of a file."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        return BinaryMutator(content)
    try:
        json.loads(text)
    except ValueError:
        return BinaryMutator(content) if "\0" in text else TextMutator(content)
    return JsonMutator(content)

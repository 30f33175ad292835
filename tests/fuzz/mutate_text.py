"""Changed copies of text: of its words, lines and bytes, and of JSON by its structure."""

from __future__ import annotations

import json
import re
from random import Random
from typing import Any

from tests.fuzz.hostile import JSON_VALUES, RAW_JSON, WORDS

__all__ = ["JsonMutator", "TextMutator"]

APART = re.compile(rb"([\s:,<>={}\[\]\"]+)")
"""What stands between words; it is kept, as every second part."""
MARK = "\u0001raw{}\u0001"
"""Stands for text that is put into the finished JSON."""


class TextMutator:
    """Changed copies of one text.

    Args:
        content: of the file.
    """

    def __init__(self, content: bytes) -> None:
        self.content = content

    def mutate(self, rng: Random) -> bytes:
        """One of them; of equal generators the same."""
        text = self.content
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            change = rng.choice((self._word, self._word, self._word, self._line, self._line, self._bytes, self._coding))
            text = change(text, rng)
        return text

    @staticmethod
    def _word(text: bytes, rng: Random) -> bytes:
        parts = APART.split(text)
        words = [i for i in range(0, len(parts), 2) if parts[i]]
        if not words:
            return text + rng.choice(WORDS)
        i = rng.choice(words)
        match rng.randrange(6):
            case 0:
                parts[i] = b""
            case 1:
                parts[i] = parts[rng.choice(words)]
            case 2:
                parts[i] += b" " + rng.choice(WORDS)
            case 3:
                parts[i] = parts[i][: rng.randrange(len(parts[i]))]
            case _:
                parts[i] = rng.choice(WORDS)
        return b"".join(parts)

    @staticmethod
    def _line(text: bytes, rng: Random) -> bytes:
        lines = text.split(b"\n")
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(7):
            case 0:
                del lines[i]
            case 1:
                lines.insert(i, lines[j])
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
            case 3:
                lines[i] = lines[i][: rng.randrange(len(lines[i]) + 1)]
            case 4:
                lines[i:i] = [lines[j]] * rng.choice((3, 60))
            case 5:
                lines[i] = b" ".join(rng.choice(WORDS) for _ in range(rng.randrange(12)))
            case _:
                lines[i : i + 2] = [b"".join(lines[i : i + 2])]
        return b"\n".join(lines)

    @staticmethod
    def _bytes(text: bytes, rng: Random) -> bytes:
        if not text:
            return rng.randbytes(8)
        found, i = bytearray(text), rng.randrange(len(text))
        match rng.randrange(5):
            case 0:
                found[i] ^= 1 << rng.randrange(8)
            case 1:
                found[i] = rng.randrange(256)
            case 2:
                del found[i:]
            case 3:
                del found[i : i + rng.choice((1, 5, 50))]
            case _:
                found[i:i] = rng.randbytes(rng.choice((1, 4)))
        return bytes(found)

    @staticmethod
    def _coding(text: bytes, rng: Random) -> bytes:
        match rng.randrange(6):
            case 0:
                return b"\xef\xbb\xbf" + text
            case 1:
                return text.decode("utf-8", "replace").encode("utf-16")
            case 2:
                return text.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b"\0", b"\x0c", "\u2028".encode())))
            case 3:
                return text.replace(b" ", rng.choice((b"\t", b"  ", b"\xa0", b"")))
            case 4:
                return text + text
            case _:
                return text[: rng.randrange(len(text) + 1)]


class JsonMutator:
    """Changed copies of one JSON text: mostly whole JSON with other values in it.

    Args:
        content: of the file; a list of JSON lines is changed as text.
    """

    def __init__(self, content: bytes) -> None:
        self.text = content.decode("utf-8")
        self.as_text = TextMutator(content)

    def mutate(self, rng: Random) -> bytes:
        """One of them; of equal generators the same."""
        if rng.random() < 0.15:
            return self.as_text.mutate(rng)
        holder, raw = [json.loads(self.text)], list[str]()
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            self._change(holder, raw, rng)
        text = json.dumps(holder[0])
        for i, piece in enumerate(raw):
            text = text.replace(json.dumps(MARK.format(i)), piece)
        return text.encode("utf-8", "surrogatepass")

    def _change(self, holder: list[Any], raw: list[str], rng: Random) -> None:
        place, key = _somewhere(holder, rng)
        match rng.randrange(12):
            case 0 if place is not holder:
                del place[key]
            case 1 if place is not holder and isinstance(place, list):
                place[key:key] = [place[key]] * rng.choice((1, 1, 40))
            case 2:
                other, name = _somewhere(holder, rng)
                place[key] = json.loads(json.dumps(other[name]))
            case 3 if isinstance(place, dict):
                place[rng.choice((key.upper(), f"{key} ", "", "x"))] = place.pop(key)
            case 4 if isinstance(place, dict):
                # A key that occurs twice.
                place[key] = self._raw(
                    f"{json.dumps(place[key])}, {json.dumps(key)}: {json.dumps(rng.choice(JSON_VALUES))}", raw
                )
            case 5 | 6:
                place[key] = self._raw(rng.choice(RAW_JSON), raw)
            case 7 if isinstance(place[key], int | float):
                factor = rng.choice((-1, 1e-9, 1e9, 1e200, 1.1))
                place[key] = place[key] * factor
            case 8 if isinstance(place[key], str):
                text = place[key]
                place[key] = rng.choice((text[:-1], text * 3, f"{text}\0", f"../{text}", f"{text}/..", f" {text}\n"))
            case _:
                place[key] = json.loads(json.dumps(rng.choice(JSON_VALUES)))  # lists are changed later on

    @staticmethod
    def _raw(piece: str, raw: list[str]) -> str:
        raw.append(piece)
        return MARK.format(len(raw) - 1)


def _somewhere(holder: list[Any], rng: Random) -> tuple[Any, Any]:
    """A list or dict of a document and one of its keys: a step deeper with each throw that does not stop."""
    place: Any = holder
    key: Any = 0
    while True:
        inner = place[key]
        if not isinstance(inner, list | dict) or not inner or (place is not holder and rng.random() < 0.15):
            return place, key
        place = inner
        key = rng.choice(list(inner)) if isinstance(inner, dict) else rng.randrange(len(inner))

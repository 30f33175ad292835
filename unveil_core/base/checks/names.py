"""Names from files of strangers, as names of files: one function for all of them."""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable
from pathlib import PurePosixPath

__all__ = ["distinct_file_names", "file_name", "is_file_name", "is_inside", "name_key"]

FORBIDDEN = re.compile(r'[<>:"/\\|?*]+')
"""What separates folders or is no part of a file's name on some system."""
UNSEEN = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
"""Categories of characters that are not seen: control characters, what turns the direction of writing, ends of lines, halves."""
RESERVED = re.compile(r"(con|prn|aux|nul|clock\$|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(?=[ .]|$)", re.IGNORECASE)
"""Devices of Windows, with any suffix, also after spaces."""
LONGEST_BYTES = 120
"""Of a name in UTF-8: file systems allow 255, and suffixes and temporary names come to it."""


def file_name(text: object, otherwise: str = "unnamed") -> str:
    """A text as the name of one visible file or folder on any system; itself where it is one already.

    Args:
        otherwise: what a text becomes of which nothing is left.
    """
    name = str(text)
    if not name.isprintable():
        name = "".join(">" if unicodedata.category(c) in UNSEEN else c for c in name)
    name = FORBIDDEN.sub("_", name).strip(" .")
    if not name.strip("_ ."):
        name = otherwise
    if RESERVED.match(name):
        name = f"_{name}"
    raw = name.encode()
    if len(raw) > LONGEST_BYTES:
        digest = hashlib.blake2b(raw, digest_size=4).hexdigest()
        name = f"{raw[: LONGEST_BYTES - 9].decode(errors='ignore').rstrip(' .')}_{digest}"
    return name


def name_key(name: str) -> str:
    """What names have in common that are one file's on some system: where case does not count, nor how accents are written."""
    decomposed = unicodedata.normalize("NFD", name)
    return unicodedata.normalize("NFC", decomposed.upper().casefold())


def is_file_name(text: object) -> bool:
    """Whether a text is the name of one file, as :func:`file_name` makes them."""
    return isinstance(text, str) and file_name(text) == text


def is_inside(name: object) -> bool:
    """Whether a text names a file within a folder, with "/" between file names, each of which may begin with a dot."""
    path = PurePosixPath(name) if isinstance(name, str) else PurePosixPath()
    return bool(path.parts) and not path.is_absolute() and all(_is_plain(part) for part in path.parts)


def _is_plain(part: str) -> bool:
    return part.strip(".") != "" and is_file_name(part.lstrip("."))


def distinct_file_names(texts: Iterable[str]) -> dict[str, str]:
    """A file name for each of some texts, by text; different ones have different names on any system, see :func:`name_key`."""
    found: dict[str, str] = {}
    taken: set[str] = set()
    # Those that keep their name come first: none is taken from them.
    for text in sorted(dict.fromkeys(texts), key=lambda t: not is_file_name(t)):
        name = base = file_name(text)
        count = 1
        while name_key(name) in taken:
            count += 1
            name = f"{base}_{count}"
        found[text] = name
        taken.add(name_key(name))
    return found

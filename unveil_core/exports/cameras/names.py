"""Names of pictures for programs that drop folders, split lines at spaces, cut names at their first dot, or read ASCII only."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

from unveil_core.drives.drive import Frame

__all__ = ["flat_names"]


def flat_names(frames: Sequence[Frame]) -> list[str]:
    """A stem for each frame, unlike all others on every system: its own, behind its camera's where there are several cameras.

    Letters lose their accents, and what is no letter, digit, ``-`` or ``_`` of ASCII becomes ``_``. Where two are the same then, or
    differ in case alone, the later one gets a number.
    """
    several = len({f.camera_name for f in frames}) > 1
    taken: set[str] = set()
    names = []
    for frame in frames:
        plain = _plain(f"{frame.camera_name}_{frame.name}" if several else frame.name)
        name, number = plain, 1
        while name.casefold() in taken:
            number += 1
            name = f"{plain}_{number}"
        taken.add(name.casefold())
        names.append(name)
    return names


def _plain(name: str) -> str:
    bare = "".join(c for c in unicodedata.normalize("NFKD", name) if not unicodedata.combining(c))
    return re.sub(r"[^A-Za-z0-9_-]", "_", bare)

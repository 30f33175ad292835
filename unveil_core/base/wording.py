"""Numbers as people say them, settings as the command takes them, and texts of strangers as a terminal can show them."""

from __future__ import annotations

__all__ = ["LONGEST_PART", "about_as_long", "about_as_much", "setting_as_option", "shown"]

LONGEST_PART = 600
"""Characters of a path, a problem and a mend: what files of strangers hold is quoted in part."""


def shown(text: object, *, longest: int | None = LONGEST_PART, tail: bool = False) -> str:
    """A text as a terminal can show it: one line, not too long, and no orders to the terminal in it.

    Escapes, other control characters, and those that turn the direction of writing or are not seen, are written as ``\\x1b``.

    Args:
        longest: characters that are kept; None = all.
        tail: the end tells more than the beginning.
    """
    whole = " ".join(str(text).split())
    if not whole.isprintable():
        whole = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in whole)
    if longest is not None and len(whole) > longest:
        return f"…{whole[-longest:]}" if tail else f"{whole[:longest]}…"
    return whole


def about_as_long(seconds: float) -> str:
    """``40 s``, ``7 min``, ``2 h 10 min``: no more exact than a forecast is."""
    if seconds < 57.5:
        return f"{max(5, 5 * round(seconds / 5))} s"
    minutes = max(1, round(seconds / 60))
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def about_as_much(mb: float) -> str:
    """``840 MB``, ``2.1 GB``."""
    return f"{mb / 1024:.1f} GB" if mb >= 995 else f"{10 * round(mb / 10)} MB"


def setting_as_option(name: str, value: object) -> str:
    """A setting of a run that is not the usual one, as an option of the command: ``--work-side=640``, ``--no-adaptation``.

    One word, because a value may begin with a dash.
    """
    if name == "adapt":
        return "--no-adaptation"
    if value is True:
        return f"--{name.replace('_', '-')}"
    text = ",".join(str(v) for v in value) if isinstance(value, list | tuple) else str(value)
    return f"--{name.replace('_', '-')}={text}"

"""Numbers as people say them, and settings as the command takes them."""

from __future__ import annotations

__all__ = ["about_as_long", "about_as_much", "setting_as_option"]


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

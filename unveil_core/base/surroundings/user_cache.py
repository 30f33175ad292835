"""The folder in which this user's programs keep what they can make again."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["user_cache_folder"]


def user_cache_folder() -> Path:
    """Unveil's own, perhaps not there yet; the environment variable ``UNVEIL_CACHE`` names another."""
    given = os.environ.get("UNVEIL_CACHE")
    if given:
        return Path(given)
    from platformdirs import user_cache_path

    return user_cache_path("unveil", appauthor=False)

"""Which camera took which frame of a transforms.json: as its keys say, else as its pictures move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from unveil_core.base.checks.names import file_name
from unveil_core.drives.travel.cameras import ALONE, Guess, Shot, guessed_cameras

__all__ = ["cameras_of"]

DECIDES = "the key camera"
OWN_IDS = 3
"""Frames that have a ``camera_id`` of their own each are those of one camera, if there are so many: structure from motion numbers
lenses so."""


def cameras_of(entries: Sequence[dict[str, Any]], shots: Sequence[Shot]) -> Guess:
    """The camera's name of each frame: ``camera``, else ``camera_id``, else as :func:`guessed_cameras` finds."""
    if any(e.get("camera") is not None for e in entries):
        return Guess([str(e.get("camera", ALONE)) for e in entries])
    if any(e.get("camera_id") is not None for e in entries):
        ids = [str(e.get("camera_id", "")) for e in entries]
        if len(set(ids)) < len(ids) or len(ids) < OWN_IDS:
            return Guess([f"{ALONE}_{i}" if not i or i.isdigit() else file_name(i) for i in ids])
        guess = guessed_cameras(shots, DECIDES)
        told = f"each frame has a camera_id of its own: these do not tell cameras apart; {DECIDES} does"
        return Guess(guess.names, told if guess.notice is None else f"{told}; {guess.notice}")
    return guessed_cameras(shots, DECIDES)

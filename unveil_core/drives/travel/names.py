"""What the frames of a drive are called: by their files, by their folders too where files have the same name."""

from __future__ import annotations

from collections.abc import Sequence

from unveil_core.base.checks.names import file_name
from unveil_core.drives.travel.cameras import Shot

__all__ = ["frame_names"]


def frame_names(shots: Sequence[Shot], cameras: Sequence[str]) -> list[str]:
    """Stems of the files; with their folders where a camera has a stem twice and that makes them differ.

    Args:
        cameras: name of the camera of each picture.
    """
    long = [file_name(f"{s.folder}/{s.stem}".strip("/")) for s in shots]
    found = [s.stem for s in shots]
    for camera in dict.fromkeys(cameras):
        own = [k for k, name in enumerate(cameras) if name == camera]
        if len({found[k] for k in own}) < len(own) == len({long[k] for k in own}):
            for k in own:
                found[k] = long[k]
    return found

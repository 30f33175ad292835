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
    found = [s.stem for s in shots]
    own: dict[str, list[int]] = {}
    for k, camera in enumerate(cameras):
        own.setdefault(camera, []).append(k)
    for indices in own.values():
        if len({found[k] for k in indices}) < len(indices):
            long = {k: file_name(f"{shots[k].folder}/{shots[k].stem}".strip("/")) for k in indices}
            if len(set(long.values())) == len(indices):
                for k, name in long.items():
                    found[k] = name
    return found

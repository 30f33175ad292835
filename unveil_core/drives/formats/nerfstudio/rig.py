"""Which camera took which frame of a transforms.json, and what the frames are called."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any

from unveil_core.base.checks.names import file_name

__all__ = ["camera_names", "frame_names"]

ALONE = "camera"
"""Name of the camera of a drive that has one and does not name it."""
LENS_KEYS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "camera_model")
LEAST_FRAMES, MOST_LENSES = 3, 16
"""Frames of different lenses in one folder are a rig's if each lens took so many and there are no more lenses: structure from
motion may give each frame a lens of its own."""


def camera_names(entries: Sequence[dict[str, Any]]) -> list[str]:
    """The camera's name of each frame: ``camera``, else ``camera_id``, else the folder of its file where there are several, else
    by its lens where frames in one folder have several; "camera" otherwise."""
    if any(e.get("camera") is not None for e in entries):
        return [str(e.get("camera", ALONE)) for e in entries]
    if any(e.get("camera_id") is not None for e in entries):
        ids = [str(e.get("camera_id", "")) for e in entries]
        return [f"camera_{i}" if not i or i.isdigit() else file_name(i) for i in ids]
    folders = [_folder(e) for e in entries]
    count = len(set(folders))
    if 1 < count < len(entries):
        # Absolute ones beside relative ones share nothing.
        shared = os.path.commonpath(folders) if all(folders) and len({f[:1] == "/" for f in folders}) == 1 else ""
        return [file_name(folder.removeprefix(shared).strip("/"), ALONE) for folder in folders]
    lenses = [tuple(str(e.get(k)) for k in LENS_KEYS) for e in entries]
    frames = Counter(lenses)
    if count == 1 and 1 < len(frames) <= MOST_LENSES and min(frames.values()) >= LEAST_FRAMES:
        numbers = {lens: k + 1 for k, lens in enumerate(dict.fromkeys(lenses))}
        return [f"{ALONE}_{numbers[lens]}" for lens in lenses]
    return [ALONE] * len(entries)


def frame_names(entries: Sequence[dict[str, Any]], cameras: Sequence[str], stems: Sequence[str]) -> list[str]:
    """Stems of the files; with their folders where a camera has a stem twice and that makes them differ."""
    long = [file_name(f"{_folder(e)}/{stem}".strip("/")) for e, stem in zip(entries, stems, strict=True)]
    found = list(stems)
    for camera in dict.fromkeys(cameras):
        own = [k for k, name in enumerate(cameras) if name == camera]
        if len({stems[k] for k in own}) < len(own) == len({long[k] for k in own}):
            for k in own:
                found[k] = long[k]
    return found


def _folder(entry: dict[str, Any]) -> str:
    parts = PurePosixPath(str(entry["file_path"]).replace("\\", "/")).parent.parts
    return "/".join(p for p in parts if p not in (".", ".."))

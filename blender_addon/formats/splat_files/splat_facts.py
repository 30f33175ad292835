# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of each Gaussian beside its looks: class, object, and where it comes from. No bpy here.

The empty scene is what stays of the full one, then what was added.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np

from ..open_safely import LARGEST_SCENE, read_bytes
from ..ply_file import Ply

__all__ = ["FACTS", "facts_of"]

FACTS = ("label", "instance", "provenance")
RELIT, SEEN = 1, 2
"""Numbers of the provenance, as the workspace's pictures have them; what was added has numbers of its own."""


def facts_of(workspace: Path, state: str, ply: Ply, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """Whole numbers (N,) int32 by name; what the workspace does not tell, or tells of another scene, is left out.

    Args:
        workspace: its folder; state: "full" or "empty".
        ply: the Gaussians of that state.
        chosen: indices (N,) of those that are wanted.
    Returns:
        label: as the file has it, the place of the class in ``labels.json``. instance: of the object, 0 none. provenance: 1 relit,
        2 seen, 3 continued, 4 invented.
    """
    found: dict[str, np.ndarray] = {}
    if "label" in (ply.vertices.dtype.names or ()):
        found["label"] = ply.vertices["label"]
    instances = _numbers(workspace, "instances")
    if state == "full":
        found["instance"] = instances
        found["provenance"] = np.full(len(ply.vertices), SEEN)
    else:
        gone, displaced, relit, added = _edit(workspace)
        if len(gone) == len(displaced):
            stays = (gone == 0) & (displaced == 0)
            if len(instances) == len(stays):
                found["instance"] = np.concatenate([instances[stays], np.zeros(len(added), np.int64)])
            if len(relit) == len(stays):
                found["provenance"] = np.concatenate([np.where(relit[stays] != 0, RELIT, SEEN), added])
    return {
        name: np.clip(np.nan_to_num(values[chosen]), -1, (1 << 31) - 1).astype(np.int32)
        for name, values in found.items()
        if len(values) == len(ply.vertices)
    }


EDIT = ("removed", "displaced", "relit", "origin")
"""Arrays of ``surfels/edit.npz``: what of the full scene goes, makes room or lost a shadow, and where what was added is from."""


def _edit(workspace: Path) -> list[np.ndarray]:
    """The arrays of :data:`EDIT`, empty where there are none or they hold something else."""
    try:
        with np.load(io.BytesIO(read_bytes(workspace / "surfels/edit.npz", LARGEST_SCENE)), allow_pickle=False) as data:
            return [_whole(data[name]) for name in EDIT]
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile):
        return [np.zeros(0, np.int64) for _ in EDIT]


def _numbers(workspace: Path, name: str) -> np.ndarray:
    """Whole numbers of a file, empty where there is none or it holds something else."""
    try:
        content = io.BytesIO(read_bytes(workspace / "surfels" / f"{name}.npy", LARGEST_SCENE))
        return _whole(np.load(content, allow_pickle=False))
    except (OSError, ValueError, EOFError):
        return np.zeros(0, np.int64)


def _whole(found: object) -> np.ndarray:
    """Whole numbers (N,), empty for anything else."""
    is_whole = isinstance(found, np.ndarray) and found.ndim == 1 and found.dtype.kind in "iub"
    return found.astype(np.int64) if is_whole else np.zeros(0, np.int64)

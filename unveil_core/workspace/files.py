"""The small files of a workspace: masks, arrays, labels, and the paths of a frame's pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import read_json, read_label_image, write_atomic, write_image_atomic
from unveil_core.drives.drive import Frame
from unveil_core.semantics.labels import SceneLabels
from unveil_core.workspace.workspace import Workspace

__all__ = [
    "frame_file",
    "known_objects",
    "load_array",
    "load_labels",
    "load_mask",
    "load_selection",
    "save_array",
    "save_mask",
]


def load_labels(workspace: Workspace) -> SceneLabels:
    """The labels that occur, with nothing chosen."""
    return SceneLabels.from_json({"removed": [], "instances": [], **json.loads(workspace.labels_json.read_text())})


def load_selection(workspace: Workspace) -> SceneLabels:
    """The labels that occur, and what of them is removed."""
    chosen = json.loads(workspace.selection_json.read_text())
    return SceneLabels.from_json({**json.loads(workspace.labels_json.read_text()), **chosen})


def load_mask(path: Path) -> NDArray[np.bool_]:
    """A mask image of the workspace."""
    return read_label_image(path) > 127


def save_mask(mask: NDArray[np.bool_], path: Path) -> None:
    """Write a mask as an 8-bit PNG, 255 where True."""
    write_image_atomic(path, np.where(mask, 255, 0).astype(np.uint8))


def save_array(array: NDArray[np.generic], path: Path) -> None:
    """Write one array as npy."""
    write_atomic(path, lambda stream: np.save(stream, array, allow_pickle=False))


def load_array(path: Path) -> NDArray[np.int64]:
    """Read one array of :func:`save_array`."""
    array: NDArray[np.int64] = np.load(path, allow_pickle=False)
    return array


def frame_file(folder: Path, frame: Frame) -> Path:
    """Where a frame's picture lies in one of the per-frame folders."""
    return folder / frame.camera_name / f"{frame.name}.png"


def known_objects(workspace: Workspace) -> tuple[int, ...] | None:
    """Ids of the objects that a workspace lists, None where it does not list any yet."""
    if not workspace.objects_json.is_file():
        return None
    listed: Any = read_json(workspace.objects_json)
    return tuple(int(o["id"]) for o in listed["objects"])

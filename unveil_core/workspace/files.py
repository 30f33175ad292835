"""The small files of a workspace: masks, arrays, labels, and the paths of a frame's pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import load_npy
from unveil_core.base.checks.names import is_file_name
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import NO_ARCHIVE, read_own_json, write_atomic, write_image_atomic
from unveil_core.base.pictures.decoding import read_instance_image, read_label_image
from unveil_core.base.types import Float32
from unveil_core.drives.drive import Frame
from unveil_core.semantics.labels import SceneLabels
from unveil_core.workspace.workspace import Workspace

__all__ = [
    "frame_file",
    "known_objects",
    "listed_objects",
    "load_array",
    "load_depth",
    "load_labels",
    "load_mask",
    "load_selection",
    "save_array",
    "save_depth",
    "save_mask",
]


MEND = "restore it, or run `unveil import` again"
STEPS_PER_M = 256
"""Of a depth image, as KITTI keeps depth."""
FARTHEST_STEP = 2**16 - 1


def load_labels(workspace: Workspace) -> SceneLabels:
    """The labels that occur, with nothing chosen.

    Raises:
        WorkspaceError: labels.json is missing or damaged.
    """
    path = workspace.labels_json
    return _labels(path, {"removed": [], "instances": [], **_object(path)})


def load_selection(workspace: Workspace) -> SceneLabels:
    """The labels that occur, and what of them is removed.

    Raises:
        WorkspaceError: labels.json or selection.json is missing or damaged.
    """
    path = workspace.selection_json
    return _labels(path, {**_object(workspace.labels_json), **_object(path)})


def _object(path: Path) -> dict[str, Any]:
    """What a JSON file of the workspace holds."""
    try:
        content = read_own_json(path)
    except (OSError, ValueError) as error:
        raise WorkspaceError(f"cannot be read: {error}", path=path, mend=MEND) from error
    if not isinstance(content, dict):
        raise WorkspaceError("Not a JSON object", path=path, mend=MEND)
    return content


def _labels(path: Path, content: dict[str, Any]) -> SceneLabels:
    try:
        return SceneLabels.from_json(content)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise WorkspaceError(f"Not a choice of labels: {error}", path=path, mend=MEND) from error


def load_mask(path: Path) -> NDArray[np.bool_]:
    """A mask image of the workspace."""
    return read_label_image(path) > 127


def save_mask(mask: NDArray[np.bool_], path: Path) -> None:
    """Write a mask as an 8-bit PNG, 255 where True."""
    write_image_atomic(path, np.where(mask, 255, 0).astype(np.uint8))


def load_depth(path: Path) -> Float32:
    """(H, W) metres of a depth image of :func:`save_depth`.

    Raises:
        DriveError: missing or damaged.
    """
    return read_instance_image(path).astype(np.float32) / np.float32(STEPS_PER_M)


def save_depth(depth: Float32, path: Path) -> None:
    """Write depth (H, W), metres, 0 for none, as a 16-bit PNG with 256 steps a metre; what is farther than 255.99 m is that far."""
    steps = np.clip(np.ceil(depth * STEPS_PER_M - 0.5), depth > 0, FARTHEST_STEP)
    write_image_atomic(path, steps.astype(np.uint16))


def save_array(array: NDArray[np.generic], path: Path) -> None:
    """Write one array as npy."""
    write_atomic(path, lambda stream: np.save(stream, array, allow_pickle=False))


def load_array(path: Path) -> NDArray[np.int64]:
    """Read one array of numbers of :func:`save_array`.

    Raises:
        WorkspaceError: missing, damaged, or of something else.
    """
    try:
        return load_npy(path)
    except NO_ARCHIVE as error:
        raise WorkspaceError(f"Not an array: {error}", path=path, mend="run the stage that writes it again") from error


def frame_file(folder: Path, frame: Frame) -> Path:
    """Where a frame's picture lies in one of the per-frame folders."""
    return folder / frame.camera_name / f"{frame.name}.png"


def known_objects(workspace: Workspace) -> tuple[int, ...] | None:
    """Ids of the objects that a workspace lists, None where it does not list any yet."""
    if not workspace.objects_json.is_file():
        return None
    return tuple(int(entry["id"]) for entry in listed_objects(workspace))


def listed_objects(workspace: Workspace) -> list[dict[str, Any]]:
    """The entries of objects.json, each with an id and a thumbnail of the workspace or none.

    Raises:
        WorkspaceError: it is missing or damaged.
    """
    path = workspace.objects_json
    entries = _object(path).get("objects")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise WorkspaceError("holds no list of objects", path=path, mend=MEND)
    for i, entry in enumerate(entries):
        number, picture = entry.get("id"), entry.get("thumbnail")
        if type(number) is not int or not 0 < number < 65536:
            raise WorkspaceError(f"Not an id from 1 to 65535: {str(number)[:40]!r} of object {i}", path=path, mend=MEND)
        if picture is not None and not all(map(is_file_name, str(picture).split("/"))):
            raise WorkspaceError(
                f"Not a file of the workspace: {str(picture)[:40]!r} of object {i}", path=path, mend=MEND
            )
    return entries

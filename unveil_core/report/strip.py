"""Some frames before and after, in one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives.drive import Frame
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.report.pictures import fitted
from unveil_core.workspace.files import frame_file

__all__ = ["write_strip"]

GAP_PX = 6


def write_strip(
    workspace_root: Path,
    path: Path,
    frames: Sequence[str] | None = None,
    *,
    count: int = 4,
    tile_width: int = 384,
    folders: Sequence[str] = ("frames",),
) -> None:
    """Write a picture with the photographs in the first row and the empty street below.

    Args:
        workspace_root: a workspace with ``frames/``.
        path: PNG or JPEG.
        frames: names of the frames, ``0007`` or ``front/0007``; by default ``count`` of them, spread over the drive, each the
            one of its stretch from which most was removed.
        count: see ``frames``.
        tile_width: of one picture, in pixels.
        folders: a row for each of these folders of the workspace (``frames``, ``renders``, ``inpainted``).
    Raises:
        WorkspaceError: a frame does not exist or was not delivered yet.
    """
    root = Path(workspace_root)
    drive = read_imported(root / "drive", points=False)
    if frames is None:
        chosen = _telling(root, drive.frames, count)
    else:
        by_name = {f.name: f for f in reversed(drive.frames)} | {f"{f.camera_name}/{f.name}": f for f in drive.frames}
        missing = [name for name in frames if name not in by_name]
        if missing:
            raise WorkspaceError(f"has no frame {missing[0]!r}", path=root / "drive", mend="name frames of the drive")
        chosen = [by_name[name] for name in frames]
    if not chosen:
        raise WorkspaceError("No frame to show", path=root / "drive", mend="name at least one")
    # The cameras of a rig may have pictures of different shapes: none is stretched.
    height = max(max(1, round(tile_width * f.camera.height / f.camera.width)) for f in chosen)
    rows = [[_tile(read_image(f.image_path), tile_width, height) for f in chosen]]
    for folder in folders:
        rows.append([_tile(_picture(root, folder, f), tile_width, height) for f in chosen])
    write_image_atomic(path, _tiled(rows))


def _picture(root: Path, folder: str, frame: Frame) -> NDArray[np.uint8]:
    """A frame of a folder as its imported photograph has it, without the footage's lens."""
    path = frame_file(root / folder, frame)
    if not path.is_file():
        made_by = {"frames": "deliver", "inpainted": "inpaint"}.get(folder, "reoptimize")
        raise WorkspaceError("Not made yet", path=path, mend=f"run `unveil {made_by}`")
    return read_delivered(root, frame) if folder == "frames" else read_image(path)


def _tile(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """A picture of a width, in the middle of a white tile (height, width, 3)."""
    tile = np.full((height, width, 3), 255, dtype=np.uint8)
    small = fitted(image, (width, max(1, round(width * image.shape[0] / image.shape[1]))))[:height]
    above = (height - len(small)) // 2
    tile[above : above + len(small)] = small
    return tile


def _telling(root: Path, frames: Sequence[Frame], count: int) -> list[Frame]:
    def removed(frame: Frame) -> int:
        path = root / "masks/removed" / frame.camera_name / f"{frame.name}.png"
        return int(np.count_nonzero(read_label_image(path))) if path.is_file() else 0

    stretches = np.array_split(np.arange(len(frames)), min(count, len(frames)))
    return [frames[max(stretch, key=lambda i: removed(frames[i]))] for stretch in stretches if len(stretch)]


def _tiled(rows: list[list[NDArray[np.uint8]]]) -> NDArray[np.uint8]:
    """Tiles on white, with narrow gaps and none around."""
    height, width = rows[0][0].shape[:2]
    columns = len(rows[0])
    shape = (len(rows) * (height + GAP_PX) - GAP_PX, columns * (width + GAP_PX) - GAP_PX, 3)
    sheet = np.full(shape, 255, dtype=np.uint8)
    for r, row in enumerate(rows):
        for c, tile in enumerate(row):
            y, x = r * (height + GAP_PX), c * (width + GAP_PX)
            sheet[y : y + height, x : x + width] = tile
    return sheet

"""Movers between the stages: the ``movers/`` folder of a workspace, and what the later stages leave out because of it.

movers/movers.json                         the list, empty where nothing moves
movers/pixels/<camera>/<frame>.png         16-bit numbers of movers, 0 = none; only frames that show one
movers/shadows/<camera>/<frame>.png        255 where ground lies in a mover's shadow; likewise
movers/points.npy                          (P,) uint8, 1 for points of the drive that lie on movers
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import read_instance_image, read_json, write_image_atomic, write_json_atomic
from unveil_core.base.progress import Progress
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.images import border_px, grow
from unveil_core.movers.find import find_movers
from unveil_core.semantics.labels import SceneLabels
from unveil_core.workspace.files import frame_file, load_array, load_mask, save_array, save_mask

__all__ = ["Moving", "read_moving", "write_moving"]


@dataclass(frozen=True)
class Moving:
    """What moves in a drive, read from its workspace.

    Attributes:
        folder: ``movers/`` of the workspace.
        count: of the movers; with 0 nothing is left out anywhere.
    """

    folder: Path
    count: int

    def pixels(self, frame: Frame) -> Mask:
        """(H, W) pixels that show a mover."""
        path = frame_file(self.folder / "pixels", frame)
        if not self.count or not path.is_file():
            return np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
        shown: Mask = read_instance_image(path) > 0
        return shown

    def shadow(self, frame: Frame) -> Mask:
        """(H, W) ground in the shadow of a mover."""
        path = frame_file(self.folder / "shadows", frame)
        if not self.count or not path.is_file():
            return np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
        return load_mask(path)

    def shadows(self, drive: Drive, removed: Sequence[Mask], mode: str) -> list[Mask]:
        """(H, W) per frame, what goes as a mover's shadow beside the ``removed`` pixels (H, W); nothing where ``mode``, the
        setting of a run, leaves shadows alone."""
        shadows = [self.shadow(f) & ~r for f, r in zip(drive.frames, removed, strict=True)]
        return [np.zeros_like(s) for s in shadows] if mode == "off" else shadows

    def hidden(self, drive: Drive) -> list[Mask] | None:
        """(H, W) per frame, pixels that say nothing of what stands: movers with their borders, and their shadows."""
        if not self.count:
            return None
        return [grow(self.pixels(f), border_px(f.camera.width)) | self.shadow(f) for f in drive.frames]

    def standing(self, drive: Drive) -> Drive:
        """The drive without the points that lie on movers."""
        if not self.count:
            return drive
        keep = load_array(self.folder / "points.npy") == 0
        # A drive of which all points lay on movers would have none to start from.
        if not keep.any():
            return drive
        colors = drive.points.colors
        return replace(drive, points=PointCloud(drive.points.positions[keep], None if colors is None else colors[keep]))

    def ids_of_standing(self, frame: Frame, instances: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
        """Instance ids (H, W) of a frame without those of movers; None where the frame has none."""
        if instances is None or not self.count:
            return instances
        return np.where(self.pixels(frame), 0, instances)


def write_moving(drive: Drive, scene: SceneLabels, folder: Path, mode: str, progress: Progress) -> int:
    """Look for movers and write ``folder``; returns how many there are.

    Args:
        mode: "auto", or "keep" to take everything for standing.
    Raises:
        DriveError: a tracked box of an unknown class.
    """
    folder.mkdir(parents=True, exist_ok=True)
    found = find_movers(drive, scene, progress) if mode == "auto" else None
    entries: list[dict[str, object]] = []
    if found is not None:
        for frame, numbers, shadow in zip(drive.frames, found.numbers, found.shadows, strict=True):
            if numbers.any():
                write_image_atomic(frame_file(folder / "pixels", frame), numbers)
            if shadow.any():
                save_mask(shadow, frame_file(folder / "shadows", frame))
        save_array(found.on_mover.astype(np.uint8), folder / "points.npy")
        entries = [
            {
                "number": m.number, "class": m.class_name, "evidence": m.evidence, "id": m.source or None,
                "frames": [{"camera": camera, "frame": name} for camera, name in m.frames],
            }
            for m in found.movers
        ]  # fmt: skip
    write_json_atomic(folder / "movers.json", entries)
    return len(entries)


def read_moving(root: Path) -> Moving:
    """What the segment stage found in a workspace; nothing where it did not look."""
    path = root / "movers" / "movers.json"
    entries = read_json(path) if path.is_file() else []
    return Moving(root / "movers", len(entries) if isinstance(entries, list) else 0)

"""Dynamic objects between the stages: the ``movers/`` folder of a workspace, and what the later stages leave out because of it.

movers/movers.json                         the list, empty where nothing moves
movers/pixels/<camera>/<frame>.png         16-bit numbers of dynamic objects, 0 = none; only frames that show one
movers/shadows/<camera>/<frame>.png        255 where ground lies in the shadow of one; likewise
movers/points.npy                          (P,) uint8, 1 for points of the drive that lie on one
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import read_json, write_image_atomic, write_json_atomic
from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_instance_image
from unveil_core.base.progress import Progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive, Frame
from unveil_core.geometry.images import border_px, grow
from unveil_core.movers.find import find_movers
from unveil_core.movers.told import points_told
from unveil_core.semantics.labels import SceneLabels
from unveil_core.workspace.files import frame_file, load_array, load_mask, save_array, save_mask

__all__ = ["Moving", "ego_pixels", "no_street", "read_moving", "write_moving"]


def ego_pixels(frame: Frame) -> Mask:
    """(H, W) pixels of an imported frame that show the ego vehicle."""
    if frame.ego_path is None:
        return np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
    return load_mask(frame.ego_path)


@dataclass(frozen=True)
class Moving:
    """The dynamic objects of a drive, read from its workspace.

    Attributes:
        folder: ``movers/`` of the workspace.
        count: of dynamic objects; with 0 nothing is left out anywhere.
    """

    folder: Path
    count: int

    def pixels(self, frame: Frame) -> Mask:
        """(H, W) pixels that show a dynamic object."""
        path = frame_file(self.folder / "pixels", frame)
        if not self.count or not path.is_file():
            return np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
        shown: Mask = read_instance_image(path) > 0
        return shown

    def shadow(self, frame: Frame) -> Mask:
        """(H, W) ground in the shadow of one."""
        path = frame_file(self.folder / "shadows", frame)
        if not self.count or not path.is_file():
            return np.zeros((frame.camera.height, frame.camera.width), dtype=bool)
        return load_mask(path)

    def shadows(self, drive: Drive, removed: Sequence[Mask], mode: str) -> Sequence[Mask]:
        """(H, W) per frame, shadows of dynamic objects outside the ``removed`` pixels (H, W); none where ``mode``, the
        setting ``shadows`` of the run, is "off"."""
        frames = drive.frames
        if mode == "off":
            return Frames(len(frames), lambda i: np.zeros_like(removed[i]))
        return Frames(len(frames), lambda i: self.shadow(frames[i]) & ~removed[i])

    def hidden(self, drive: Drive, cache: FrameCache) -> Sequence[Mask] | None:
        """(H, W) per frame, pixels that do not show the static scene: dynamic objects with their borders, their shadows, and the
        ego vehicle. None where there are no such; ``cache``: room for them."""
        if not self.count and all(f.ego_path is None for f in drive.frames):
            return None
        frames = drive.frames
        return cache.frames(
            len(frames),
            lambda i: (
                grow(self.pixels(frames[i]), border_px(frames[i].camera.width))
                | self.shadow(frames[i])
                | ego_pixels(frames[i])
            ),
        )

    def static_part(self, drive: Drive) -> Drive:
        """The drive without the points that lie on dynamic objects."""
        if not self.count:
            return drive
        keep = load_array(self.folder / "points.npy") == 0
        # If all points lay on dynamic objects, there would be none to start from.
        if not keep.any():
            return drive
        return replace(drive, points=drive.points.select(keep))

    def ids_of_static(self, frame: Frame, instances: NDArray[np.int64] | None) -> NDArray[np.int64] | None:
        """Instance ids (H, W) of a frame without those of dynamic objects; None where the frame has none."""
        if instances is None or not self.count:
            return instances
        return np.where(self.pixels(frame), 0, instances)


def no_street(root: Path, frame: Frame, moving: Moving) -> Mask:
    """(H, W) pixels in which a photograph is no witness of the empty street: removed objects and their shadows, dynamic objects and
    theirs, the ego vehicle, all with their borders.

    Args:
        root: a workspace with masks of what is removed; moving: its dynamic objects.
    """
    shown = moving.pixels(frame) | moving.shadow(frame) | ego_pixels(frame)
    for name in ("removed", "shadows"):
        shown |= load_mask(frame_file(root / "masks" / name, frame))
    return grow(shown, border_px(frame.camera.width))


def write_moving(
    drive: Drive,
    scene: SceneLabels,
    folder: Path,
    mode: str,
    progress: Progress,
    cache: FrameCache,
    kept: Kept | None = None,
    told: Sequence[Mask] | None = None,
) -> int:
    """Find the dynamic objects and write ``folder``; returns how many there are.

    Args:
        mode: "auto", or "keep" to treat everything as static.
        cache: room for the frames.
        kept: where an interrupted call leaves what the next one goes on from.
        told: (H, W) per frame, pixels of what a person says moves; None = nothing.
    Raises:
        DriveError: a tracked box of an unknown class.
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = kept or Kept()
    found = find_movers(drive, scene, progress, cache, kept) if mode == "auto" else None
    entries: list[dict[str, object]] = []
    if found is not None:
        checkpoint = kept.checkpoint("written")
        state = checkpoint.load()

        def write(i: int) -> int:
            frame, numbers, shadow = drive.frames[i], found.numbers[i], found.shadows[i]
            if numbers.any():
                write_image_atomic(frame_file(folder / "pixels", frame), numbers)
            if shadow.any():
                save_mask(shadow, frame_file(folder / "shadows", frame))
            return i

        for i in each(write, range(0 if state is None else state[1]["frames"], len(drive.frames))):
            if checkpoint.due():
                checkpoint.save({}, {"frames": i + 1})
            progress(i + 1, len(drive.frames), "finding shadows of dynamic objects")
        save_array(found.on_mover.astype(np.uint8), folder / "points.npy")
        entries = [
            {
                "number": m.number,
                "class": m.class_name,
                "evidence": m.evidence,
                "id": m.source or None,
                "frames": [{"camera": camera, "frame": name} for camera, name in m.frames],
            }
            for m in found.movers
        ]
    if told is not None:
        entries += _write_told(drive, told, folder, len(entries) + 1)
    write_json_atomic(folder / "movers.json", entries)
    return len(entries)


def _write_told(drive: Drive, told: Sequence[Mask], folder: Path, number: int) -> list[dict[str, object]]:
    """Add what a person says moves, where nothing else was found; returns its entry, none where that is nowhere."""
    shown = []
    for i, frame in enumerate(drive.frames):
        path = frame_file(folder / "pixels", frame)
        pixels = read_instance_image(path) if path.is_file() else np.zeros(told[i].shape, np.uint16)
        more = told[i] & (pixels == 0)
        if more.any():
            write_image_atomic(path, np.where(more, number, pixels).astype(np.uint16))
            shown.append({"camera": frame.camera_name, "frame": frame.name})
    if not shown:
        return []
    path = folder / "points.npy"
    before = load_array(path) if path.is_file() else np.zeros(len(drive.points.positions), np.uint8)
    save_array(((before > 0) | points_told(drive, told)).astype(np.uint8), path)
    return [{"number": number, "class": "object", "evidence": "told", "id": None, "frames": shown}]


def read_moving(root: Path) -> Moving:
    """What the segment stage found in a workspace; nothing where it did not look."""
    path = root / "movers" / "movers.json"
    entries = read_json(path) if path.is_file() else []
    return Moving(root / "movers", len(entries) if isinstance(entries, list) else 0)

"""Where the clean frames differ from the photographs, and on account of which object: 8-bit grey PNG sequences of full size.

============================================ =====================================================================
``<camera>/<object>/<object>.1001.png``      255 where the object was taken out, its border and shadow with it
``<camera>/other/other.1001.png``            the same of whatever has no number; only where there is such
``<camera>/removed/removed.1001.png``        all of them
``<camera>/provenance/provenance.1001.png``  0 original, 1 relit, 2 seen elsewhere, 3 continued, 4 invented
``<camera>/certainty/certainty.1001.png``    0 surely wrong to 254 surely right, 255 the footage's own
============================================ =====================================================================

A clean frame over its photograph by these mattes is the clean frame, bit for bit; by some of them, the other objects stand there
again. So they are wider than the objects: the silhouettes are in ``exr``. Beyond what was changed a matte ends softly, where both
pictures are the same; between two objects it is softened likewise.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.base.types import Labels, Mask
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.drive import Frame
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.objects import object_name
from unveil_core.exports.plates.png import numbered, told_frames
from unveil_core.exports.plates.silhouettes import Silhouettes
from unveil_core.exports.whole import camera_file, tell
from unveil_core.geometry.images import grow, resampled
from unveil_core.workspace.files import frame_file, load_mask
from unveil_core.workspace.movers import Moving, read_moving

__all__ = ["CERTAINTY", "OTHER", "PROVENANCE", "REMOVED", "write_mattes"]

OTHER, REMOVED, PROVENANCE, CERTAINTY = "other", "removed", "provenance", "certainty"
"""Names that no object has: those end with a number."""
NO_OBJECT = -1
"""Stands for :data:`OTHER` among the numbers of objects; 0 is nothing."""
BESIDE = 0.15
"""How far from an object, as a share of the width, a part of the mask may lie that shows none and still be its shadow: between a
car's wheels and under its mirrors the sun shines on the ground, and cuts pieces off."""
SOFT_PX = 1
"""Half the width of a soft edge, pixels of working size: an object's antialiased border."""


def write_mattes(job: Job, folder: Path) -> None:
    """The sequences, and ``export.json`` that tells which object each is."""
    frames = job.drive.frames
    removed = [entry for entry in job.objects if entry.get("removed")]
    names = {entry["id"]: object_name(entry) for entry in removed} | {NO_OBJECT: OTHER}
    silhouettes, moving = Silhouettes(job, removed), read_moving(job.workspace.root)
    others = set()
    for done, (frame, plate) in enumerate(zip(frames, numbered(job, "png"), strict=True)):
        place, number = camera_file(frame.camera_name), plate.rsplit(".", 2)[1]
        at = None if frame.footage is None else work_positions(frame.footage, frame.camera)
        goes = load_mask(frame_file(job.workspace.root / "masks/removed", frame))
        goes |= load_mask(frame_file(job.workspace.root / "masks/shadows", frame))
        changed = goes if at is None else resampled(goes, at, cv2.INTER_LINEAR) > 0
        owners = _owners(goes, silhouettes.numbers(frame), moving, frame)
        owners = owners if at is None else resampled(owners, at, cv2.INTER_NEAREST).astype(np.int64)
        owners[~changed] = 0
        soft = max(1, round(SOFT_PX * changed.shape[1] / frame.camera.width))
        for who, name in names.items():
            own = owners == who
            if who == NO_OBJECT and own.any():
                others.add(frame.camera_name)
            _write(folder, place, name, number, _softened(own, soft) if own.any() else _empty(own.shape))
        _write(folder, place, REMOVED, number, _encoded(np.where(changed, 255, 0)))
        for name in (PROVENANCE, CERTAINTY):
            told = frame_file(job.workspace.root / name, frame)
            if told.is_file():
                values = read_label_image(told)
                shown = _encoded(values if at is None else resampled(values, at, cv2.INTER_NEAREST))
                _write(folder, place, name, number, shown)
        job.progress(done + 1, len(frames), "writing mattes")
    _leave_out(folder, {camera_file(name) for name in {f.camera_name for f in frames} - others})
    mattes = [{"name": names[e["id"]], "id": e["id"], "class": e["class"]} for e in removed]
    tell(folder, "mattes", {"mattes": mattes, "other": sorted(others), "cameras": told_frames(job)})


def _write(folder: Path, camera: str, name: str, number: str, content: bytes) -> None:
    path = folder / camera / name / f"{name}.{number}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def _encoded(plane: NDArray[np.generic]) -> bytes:
    done, content = cv2.imencode(".png", plane.astype(np.uint8))
    assert done
    return content.tobytes()


@lru_cache(maxsize=4)
def _empty(shape: tuple[int, int]) -> bytes:
    """Of an object that the frame does not show, as most frames do with most objects."""
    return _encoded(np.zeros(shape, np.uint8))


def _leave_out(folder: Path, cameras: set[str]) -> None:
    """Take the empty sequences of :data:`OTHER` away."""
    for camera in cameras:
        place = folder / camera / OTHER
        for file in place.iterdir():
            file.unlink()
        place.rmdir()


def _owners(goes: Mask, numbers: Labels, moving: Moving, frame: Frame) -> Labels:
    """(H, W) on account of which object a pixel goes: the nearest one, if its part of the mask shows or touches the surroundings of
    one, else none in particular.

    Args:
        goes: (H, W) what was changed; numbers: (H, W) id of the object that a pixel shows, 0 none.
    """
    seeds = np.where((numbers == 0) & moving.pixels(frame), NO_OBJECT, numbers)
    found = np.full(goes.shape, NO_OBJECT, dtype=np.int64)
    if not seeds.any():
        return found
    gap, (rows, columns) = distance_transform_edt(seeds == 0, return_indices=True)
    _, parts = cv2.connectedComponents(grow(goes, 2).astype(np.uint8), connectivity=8)
    owned = np.isin(parts, np.unique(parts[(gap < BESIDE * goes.shape[1]) & (parts > 0)]))
    found[owned] = seeds[rows[owned], columns[owned]]
    return found


def _softened(own: Mask, soft: int) -> bytes:
    """255 where a matte's own pixels are, falling to 0 beside them."""
    whole = np.where(own, 255, 0).astype(np.uint8)
    side = 2 * soft + 1
    return _encoded(np.maximum(whole, cv2.blur(whole, (side, side))))

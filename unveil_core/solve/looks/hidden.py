"""What of the frames is not to be trusted: what moves or will go, the sky, and the vehicle itself. Labels and masks by frame."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import SettingsError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.labelling.segmenter import load_segmenter
from unveil_core.solve.footage.frames import FootageFrame
from unveil_core.solve.looks.motion import Motion

__all__ = ["bonnet_of", "by_frame", "labelled", "not_street", "write_feature_masks"]

SKY = CITYSCAPES.index("sky")
UNTRUSTED = (SKY, *range(CITYSCAPES.index("person"), len(CITYSCAPES)))
"""trainIds of what moves or may, and of the sky, whose clouds are no part of the street."""
GROWN_PX = 5
"""By which what is hidden is grown, pixels: labels are loose at edges, and a feature sees its surroundings."""
STILL_SHARE = 0.75
"""Share of the steps in which a pixel of the vehicle itself stays."""
LEAST_BONNET, MOST_BONNET = 0.01, 0.5
"""Of the picture, that the vehicle itself may take."""


def bonnet_of(motion: Motion) -> Mask | None:
    """(h, w) of a small picture: what never moves and reaches the lower edge while all around moves; None where nothing does."""
    still = (motion.still > STILL_SHARE).astype(np.uint8)
    still[: still.shape[0] // 2] = 0
    still = cv2.morphologyEx(still, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    still = cv2.morphologyEx(still, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, parts = cv2.connectedComponents(still)
    lowest = parts[-1]
    found = np.zeros(still.shape, bool)
    for part in range(1, count):
        if (lowest == part).sum() > 0.2 * still.shape[1]:  # a bonnet is wide
            found |= parts == part
    if not LEAST_BONNET < found.mean() < MOST_BONNET:
        return None
    # All below what is seen of it belongs to it, reflections, too.
    found = np.maximum.accumulate(found, axis=0)
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)


def by_frame(folder: Path, frames: Sequence[FootageFrame], what: str) -> dict[FootageFrame, Path]:
    """The picture of each frame in a folder of labels or masks: by its name, else by the number in it; some frames are enough.

    Raises:
        SettingsError: there is no such folder, or no picture in it belongs to a frame.
    """
    if not folder.is_dir():
        raise SettingsError(f"Not a folder of {what}: {folder}", mend="give a folder with one picture a frame")
    files = sorted((p for p in folder.rglob("*.png") if p.is_file()), key=lambda p: natural_key(str(p)))
    by_name = {(p.parent.name, p.stem): p for p in files} | {("", p.stem): p for p in files if p.parent == folder}
    by_number: dict[tuple[str, int], Path] = {}
    for p in files:
        if numbers := re.findall(r"\d+", p.stem):
            by_number.setdefault((p.parent.name if p.parent != folder else "", int(numbers[-1])), p)
    several = len({f.camera for f in frames}) > 1
    found: dict[FootageFrame, Path] = {}
    for frame in frames:
        own = by_name.get((frame.camera, frame.name)) or (None if several else by_name.get(("", frame.name)))
        if own is None and not several and len({p.parent for p in files}) == 1:
            place = files[0].parent
            key = "" if place == folder else place.name
            own = by_name.get((key, frame.name)) or by_number.get((key, frame.number))
        if own is not None:
            found[frame] = own
    if not found:
        shown = frames[0].name if not several else f"{frames[0].camera}/{frames[0].name}"
        raise SettingsError(
            f"{folder} has no {what} of any frame", mend=f"name them as the frames are, {shown}.png the first"
        )
    return found


def labelled(
    segmenter: Path, images: Path, frames: Sequence[FootageFrame], folder: Path, progress: Progress = no_progress
) -> dict[FootageFrame, Path]:
    """Label pictures of frames by a network, written into ``folder``; those that are there stay."""
    network, found = None, {}
    for done, frame in enumerate(frames):
        place = (folder / frame.file).with_suffix(".png")
        if not place.is_file():
            network = network or load_segmenter(segmenter)
            place.parent.mkdir(parents=True, exist_ok=True)
            write_image_atomic(place, network.segment(read_image(images / frame.file)).semantic)
        found[frame] = place
        progress(done + 1, len(frames), "labelling frames")
    return found


def not_street(frame: FootageFrame, size: tuple[int, int], label: Path | None, bonnet: Mask | None) -> Mask | None:
    """(H, W) pixels of a frame that are no part of the scene, the sky and the vehicle itself; None where there are none.

    Args:
        size: width, height of the frame; label: its label picture; bonnet: (h, w) of any size.
    """
    hidden = np.zeros(size[::-1], bool)
    if label is not None:
        hidden |= _fitted(read_label_image(label), size) == SKY
    if bonnet is not None:
        hidden |= cv2.resize(bonnet.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    return hidden if hidden.any() else None


def write_feature_masks(
    frames: Mapping[FootageFrame, str],
    size: tuple[int, int],
    folder: Path,
    labels: dict[FootageFrame, Path],
    masks: dict[FootageFrame, Path],
    bonnet: Mask | None,
) -> None:
    """Write where features are looked for, as COLMAP takes it: ``NAME.png``, 0 = not here.

    Args:
        frames: with the name that COLMAP knows each by;
        size: width, height of the frames; bonnet: (h, w) of any size.
    """
    width, height = size
    own = None
    if bonnet is not None:
        own = cv2.resize(bonnet.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0

    def allowed(frame: FootageFrame) -> Mask | None:
        hidden = np.zeros((height, width), np.uint8)
        if frame in labels:
            hidden |= np.isin(_fitted(read_label_image(labels[frame]), size), UNTRUSTED).astype(np.uint8)
        if frame in masks:
            hidden |= (_fitted(read_label_image(masks[frame]), size) == 0).astype(np.uint8)
        if hidden.any():
            hidden = np.asarray(cv2.dilate(hidden, np.ones((2 * GROWN_PX + 1,) * 2, np.uint8)))
        if own is not None:
            hidden |= own.astype(np.uint8)
        return None if not hidden.any() else hidden == 0

    for frame, name in frames.items():
        free = allowed(frame)
        if free is not None:
            place = folder / f"{name}.png"
            place.parent.mkdir(parents=True, exist_ok=True)
            write_image_atomic(place, np.where(free, np.uint8(255), np.uint8(0)))


def _fitted(picture: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """A label picture at the size of its frame."""
    if picture.shape[1::-1] == size:
        return picture
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST), np.uint8)

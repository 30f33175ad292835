"""The per-frame pictures that an evaluation compares: their files, resized to one size, and the regions that are measured."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Frame
from unveil_core.drives.importing.truth_files import truth_file
from unveil_core.workspace.files import frame_file

__all__ = ["REGIONS", "fitted", "fitted_mask", "regions_of", "truth_file", "truth_mask", "workspace_mask"]


REGIONS = ("removed", "unseen", "seen_elsewhere", "cast_shadow", "whole")
"""Names of the regions, in the order of tables."""


def workspace_mask(folder: Path, frame: Frame, shape: tuple[int, ...]) -> Mask | None:
    """(H, W) a frame's mask in a folder of the workspace, None where it is not there."""
    path = frame_file(folder, frame)
    return fitted_mask(read_label_image(path), shape) if path.is_file() else None


def truth_mask(folder: Path, frame: Frame, shape: tuple[int, ...]) -> Mask | None:
    """(H, W) a frame's mask of the truth, None where it is not there."""
    path = truth_file(folder, frame)
    return None if path is None else fitted_mask(read_label_image(path), shape)


def fitted(image: Picture, shape: tuple[int, ...]) -> Picture:
    """A picture (h, w, 3) brought to a size (H, W) by area."""
    if image.shape[:2] == tuple(shape[:2]):
        return image
    return cv2.resize(image, (shape[1], shape[0]), interpolation=cv2.INTER_AREA).astype(np.uint8)


def fitted_mask(labels: NDArray[np.integer], shape: tuple[int, ...]) -> Mask:
    """A mask image (h, w) of 0 and 255 as bool (H, W): True where half of a pixel's area is."""
    mask: Mask = labels > 127
    if mask.shape != tuple(shape[:2]):
        covered = cv2.resize(mask.astype(np.float32), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
        mask = np.asarray(covered >= 0.5)
    return mask


def regions_of(
    truth: Path, frame: Frame, shape: tuple[int, ...], *, removed: Mask | None, unobserved: Mask | None
) -> dict[str, Mask]:
    """The regions (H, W) of a frame, by their names in :data:`REGIONS`; those that nothing defines are left out.

    Args:
        truth: the truth's folder, with ``removed/``, ``unseen/`` and ``shadow/``, each optional.
        removed, unobserved: (H, W) masks that stand in where the truth has none.
    """
    true_removed = truth_mask(truth / "removed", frame, shape)
    true_unseen = truth_mask(truth / "unseen", frame, shape)
    shadow = truth_mask(truth / "shadow", frame, shape)
    region = true_removed if true_removed is not None else removed
    split = true_unseen if true_unseen is not None else unobserved
    regions: dict[str, Mask] = {"whole": np.ones(shape[:2], dtype=bool)}
    if region is not None:
        regions["removed"] = region
        if split is not None:
            regions["unseen"], regions["seen_elsewhere"] = region & split, region & ~split
        if shadow is not None:
            regions["cast_shadow"] = shadow & ~region
    return regions

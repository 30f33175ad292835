"""What was changed by what is removed: the true picture beside the crowded one, and the mask of cast shadows."""

from __future__ import annotations

import cv2
import numpy as np

SAME, OTHER = 2.0, 4.0
"""Levels of 255, after a blur: two renderings that differ by less show one street, by more two. The same noise is in both, but the
denoiser sees the whole picture, and leaves traces of a level or two anywhere."""
SHADOW_LEVELS = 10
"""A shadow is darker than the street without it by more than this, as the parked street's are."""


def true_picture(full: np.ndarray, empty: np.ndarray, removed: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: the empty street, and the crowded picture's own pixels wherever nothing removed has any effect."""
    apart = np.abs(full.astype(np.float32) - empty.astype(np.float32)).max(axis=2)
    apart = cv2.GaussianBlur(apart, (0, 0), 1.5)
    weight = np.clip((apart - SAME) / (OTHER - SAME), 0, 1)
    border = cv2.dilate(removed.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    weight = np.where(border, 1.0, weight)[..., None]
    found: np.ndarray = np.round(weight * empty + (1 - weight) * full).astype(np.uint8)
    return found


def shadow_mask(full: np.ndarray, empty: np.ndarray, removed: np.ndarray) -> np.ndarray:
    """(H, W) background in a removed thing's shadow."""
    luma = [cv2.GaussianBlur(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), 0.8) for p in (full, empty)]
    border = cv2.dilate(removed.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    shadow = (luma[1] - luma[0] > SHADOW_LEVELS) & ~border
    return cv2.morphologyEx(shadow.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0

"""Makes exact labels as wrong as those of a network: borders that are off, specks, now and then a missed object."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from sample_scenes.generators.streets.plan import BUILDING, CAR, PERSON, POLE, ROAD, SIDEWALK, VEGETATION, LabelNoise

WAVE_PX = 9.0
"""Borders are off in stretches of about this many pixels, as a network's are."""
SPECK_PX = (2, 5)
WRONG = (ROAD, SIDEWALK, BUILDING, POLE, VEGETATION, CAR, PERSON)
"""What specks are taken for."""


def shifts(shape: tuple[int, int], pixels: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A smooth field of shifts (2 of (H, W)), ``pixels`` long in the root mean square."""
    fields = [cv2.GaussianBlur(rng.normal(0, 1, shape).astype(np.float32), (0, 0), WAVE_PX / 2) for _ in range(2)]
    size = np.sqrt(np.mean(fields[0] ** 2 + fields[1] ** 2))
    return fields[0] * pixels / size, fields[1] * pixels / size


def noisy(labels: np.ndarray, ids: np.ndarray, noise: LabelNoise, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Labels (H, W) and instances (H, W) with errors; both err alike."""
    dx, dy = shifts(labels.shape, noise.border, rng)
    rows, columns = np.mgrid[: labels.shape[0], : labels.shape[1]]
    row = np.clip(np.round(rows + dy).astype(int), 0, labels.shape[0] - 1)
    column = np.clip(np.round(columns + dx).astype(int), 0, labels.shape[1] - 1)
    labels, ids = labels[row, column], ids[row, column]
    for number in np.unique(ids[ids > 0]):
        if rng.uniform() < noise.missed:
            gone = ids == number
            around = distance_transform_edt(ids > 0, return_distances=False, return_indices=True)
            labels = np.where(gone, labels[around[0], around[1]], labels)
            ids = np.where(gone, 0, ids)
    for _ in range(int(rng.poisson(noise.specks))):
        centre = int(rng.integers(0, labels.shape[1])), int(rng.integers(0, labels.shape[0]))
        speck = np.zeros(labels.shape, np.uint8)
        cv2.circle(speck, centre, int(rng.integers(*SPECK_PX)), 1, -1)
        wrong = (speck > 0) & (ids == 0)
        labels = np.where(wrong, int(rng.choice(WRONG)), labels)
    return labels, ids

"""A transforms.json by the rules of nerfstudio's parser (``nerfstudio_dataparser.py``): what it reads where, how precisely.

* ``camera_model`` stands at the top of the file or nowhere; it is one of a few, and one for all frames.
* A number stands at the top for all frames, or at each frame; of coefficients, one at the top means all at the top.
* A frame's file is found by its path; where pictures were reduced, by the last part of it in ``images_2/``.
* Frames are sorted by their paths. Poses are single precision.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

__all__ = ["NerfView", "read_as_nerfstudio"]

MODELS = {"SIMPLE_PINHOLE": "perspective", "PINHOLE": "perspective", "SIMPLE_RADIAL": "perspective", "RADIAL": "perspective",
          "OPENCV": "perspective", "OPENCV_FISHEYE": "fisheye"}  # fmt: skip


@dataclass
class NerfView:
    """A frame as it is known there: OpenGL axes, single precision."""

    picture: Path
    kind: str
    size: tuple[int, int]
    numbers: np.ndarray
    """fx, fy, cx, cy"""
    coefficients: np.ndarray
    """k1, k2, k3, k4, p1, p2"""
    pose: np.ndarray

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) where points (N, 3) lie, counted from the outer edge of the first pixel."""
        pose = self.pose.astype(np.float32)
        local = (points.astype(np.float32) - pose[:3, 3]) @ pose[:3, :3] * np.array([1, -1, -1], np.float32)
        flat = (local[:, :2] / local[:, 2:3]).astype(np.float64)
        k1, k2, k3, k4, p1, p2 = self.coefficients.astype(np.float64)
        if self.kind == "fisheye":
            bent = cv2.fisheye.distortPoints(flat[:, None], np.eye(3), np.array([k1, k2, k3, k4]))[:, 0]
        else:
            x, y = flat.T
            r = x * x + y * y
            d = 1 + r * (k1 + r * (k2 + r * (k3 + r * k4)))
            bent = np.stack(
                [d * x + 2 * p1 * x * y + p2 * (r + 2 * x * x), d * y + 2 * p2 * x * y + p1 * (r + 2 * y * y)], axis=1
            )
        return bent * self.numbers[:2] + self.numbers[2:]


def read_as_nerfstudio(folder: Path) -> list[NerfView]:
    """The frames in the order of their files; a ValueError where the parser stops, or mistakes files for one another."""
    meta = json.loads((folder / "transforms.json").read_text())
    kind = MODELS.get(meta["camera_model"]) if "camera_model" in meta else "perspective"
    if kind is None:
        raise ValueError(f"KeyError: {meta['camera_model']}")
    bent_at_top = any(k in meta for k in ("k1", "k2", "k3", "p1", "p2", "distortion_params"))
    views = []
    for frame in sorted(meta["frames"], key=lambda f: Path(f["file_path"])):
        picture = folder / frame["file_path"]
        if not picture.is_file():
            raise ValueError(f"No such file: {picture}")
        numbers = [_number(meta, frame, key) for key in ("fl_x", "fl_y", "cx", "cy", "w", "h")]
        where: dict[str, Any] = meta if bent_at_top else frame
        coefficients = [float(where.get(k, 0.0)) for k in ("k1", "k2", "k3", "k4", "p1", "p2")]
        views.append(
            NerfView(
                picture,
                kind,
                (int(numbers[4]), int(numbers[5])),
                np.array(numbers[:4], np.float32),
                np.array(coefficients, np.float32),
                np.array(frame["transform_matrix"]).astype(np.float32),
            )
        )
    if len({v.picture.name for v in views}) < len(views):
        raise ValueError("reduced pictures would take each other's place")
    return views


def _number(meta: dict[str, Any], frame: dict[str, Any], key: str) -> float:
    if key not in meta and key not in frame:
        raise ValueError(f"{key} not specified in frame")
    return float(meta[key] if key in meta else frame[key])

"""Plates and cameras of a small shot, and the files that programs write of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from unveil_core.base.types import Float64

SIZE = 96, 54
COUNT = 5


def plates(folder: Path, first: int = 1001, count: int = COUNT, name: str = "plate.{}.png") -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / name.format(first + k) for k in range(count)]
    for k, file in enumerate(files):
        picture = np.full((SIZE[1], SIZE[0], 3), 30 + 20 * k, np.uint8)
        picture[:, : 10 * (k + 1)] = 200
        assert cv2.imwrite(str(file), picture)
    return files


def rotation(axis: str, degrees: float) -> Float64:
    found, k = np.eye(3), "xyz".index(axis)
    a, b = (k + 1) % 3, (k + 2) % 3
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    found[a, a], found[a, b], found[b, a], found[b, b] = c, -s, s, c
    return found


def angles(k: int) -> tuple[float, float, float]:
    return -3.0 - k, 20.0 + 5 * k, 2.0 * k


def position(k: int) -> tuple[float, float, float]:
    return 0.3 * k, 1.5, -2.0 * k


def pose_y_up(k: int) -> Float64:
    """(4, 4) of Nuke's camera: turned about z, x and y."""
    rx, ry, rz = angles(k)
    found = np.eye(4)
    found[:3, :3] = rotation("y", ry) @ rotation("x", rx) @ rotation("z", rz)
    found[:3, 3] = position(k)
    return found


def chan(path: Path, first: int = 1001, count: int = COUNT, last: str = "40.0") -> Path:
    rows = [
        f"{first + k}\t" + "\t".join(f"{v:.9f}" for v in (*position(k), *angles(k))) + f"\t{last}".rstrip()
        for k in range(count)
    ]
    path.write_text("# a matchmove\n" + "\n".join(rows) + "\n")
    return path

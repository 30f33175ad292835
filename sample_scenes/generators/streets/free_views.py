"""True pictures of the empty street from beside the path and above it, as the parked street has them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from sample_scenes.generators.streets import exposure
from sample_scenes.generators.streets.render import Studio
from sample_scenes.generators.streets.visibility import Shown, View, never_seen

if TYPE_CHECKING:
    from sample_scenes.generators.streets.capture import Stage

BESIDE_M, ABOVE_M = 1.5, 1.0
VIEWS = 6
"""So many in all: each costs a rendering."""
MARGIN_M = 0.4
"""A view before which something stands nearer, crowded or empty, is left out."""


def free_views(views: list[View]) -> dict[str, View]:
    """By name: at frames spread over the drive beside the path, in turn right and left, and above it."""
    found = {}
    places = np.unique(np.linspace(0, len(views) - 1, VIEWS // 2 + 2).round().astype(int)[1:-1])
    for turn, frame in enumerate(places):
        view = views[frame]
        for kind, shift in (("beside", view.pose[:3, 0] * BESIDE_M * (1 if turn % 2 == 0 else -1)), ("above", np.array([0, 0, ABOVE_M]))):
            pose = view.pose.copy()
            pose[:3, 3] += shift
            found[f"{frame:04d}_{kind}"] = View(pose, view.width, view.height, view.fov)
    return found


def write_free_views(studio: Studio, stage: Stage, views: list[View], crowd: list[Shown], folder: Path, gain: float, offset: np.ndarray) -> int:
    """Write images/ of the empty street, removed/, unseen/ and transforms.json; returns how many views there are.

    ``views`` are those of the front camera. What moves stands where it does at the start.
    """
    rows = []
    for name in ("images", "removed", "unseen"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    stage.at(0.0)
    for number, (name, view) in enumerate(free_views(views).items()):
        stage.show(True)
        full = studio.take(view, 1, color=False)
        if full.depth.min() < MARGIN_M:
            continue
        stage.show(False)
        bare = studio.take(view, 1000 + number)
        removed = studio.instances[full.index] > 0
        unseen = never_seen(view, removed, bare.depth, bare.normal, crowd)
        picture = exposure.encode(bare.light, gain)[..., ::-1]
        cv2.imwrite(str(folder / f"images/{name}.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
        for kind, mask in (("removed", removed), ("unseen", unseen)):
            cv2.imwrite(str(folder / f"{kind}/{name}.png"), mask.astype(np.uint8) * 255)
        matrix = view.pose.copy()
        matrix[:3, 3] += offset
        rows.append({"file_path": f"images/{name}.jpg", "camera": name.split("_")[1], "transform_matrix": matrix.tolist()})
    stage.show(True)
    if rows:
        (folder / "transforms.json").write_text(json.dumps({"camera_model": "PINHOLE", **views[0].intrinsics(), "frames": rows}, indent=1))
    return len(rows)

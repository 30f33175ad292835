"""A drive as another program might have left it: the same street in other units, with another axis up, far from the origin."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.points import read_points, write_points
from unveil_core.geometry.axes import upright
from unveil_core.geometry.similarity import Similarity

Y_UP_UTM = Similarity(0.1, upright(np.array([0.0, 1.0, 0.0])), np.array([389_512.4, 71.3, -6_175_034.5]))
"""Metres with z up to a tenth of a unit with y up, surveyed."""


def put_into_other_frame(path: Path, frame: Similarity = Y_UP_UTM, **keys: object) -> Path:
    """Rewrite the transforms.json at ``path``, its points, and the views of its truth, to be in another frame; ``metric`` goes.

    Args:
        path: transforms.json, whose coordinates are metres with z up.
        frame: from these to the new ones.
        keys: of the file, beside the poses.
    """
    document = json.loads(path.read_text())
    document.pop("metric", None)
    points = read_points(path.parent / document["ply_file_path"])
    write_points(type(points)(frame.to_world(points.positions), points.colors), path.parent / document["ply_file_path"])
    for entry in document["frames"]:
        _turn(entry, frame)
        for box in entry.get("boxes", ()):
            size = [frame.scale * v for v in box["size"]]
            box.update(centre=frame.to_world(box["centre"]).tolist(), size=size)
    path.write_text(json.dumps({**document, **keys}))
    free = path.parent / "truth/free/transforms.json"
    if free.is_file():
        views = json.loads(free.read_text())
        for entry in views["frames"]:
            _turn(entry, frame)
        free.write_text(json.dumps(views))
    return path


def _turn(entry: dict, frame: Similarity) -> None:  # type: ignore[type-arg]
    pose = np.array(entry["transform_matrix"], dtype=np.float64)
    pose[:3, 3] = frame.to_world(pose[:3, 3])
    pose[:3, :3] = frame.rotation @ pose[:3, :3]
    entry["transform_matrix"] = pose.tolist()


def box_in_other_frame(box: TrackedBox, frame: Similarity = Y_UP_UTM) -> TrackedBox:
    """A box of metres with z up in another frame."""
    x, y, z = (float(v) for v in frame.to_world(box.centre))
    length, width, height = (frame.scale * v for v in box.size)
    return TrackedBox(box.id, box.class_name, (x, y, z), (length, width, height), box.yaw)

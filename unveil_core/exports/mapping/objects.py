"""The removed objects as a list, and the splats of each in a PLY of its own: one can be put back, or put elsewhere.

``objects.json`` has for each object its id, class, box, first and last frame, and the name and number of its splats, which are as
:mod:`unveil_core.exports.splats.ply` writes them. A box is {centre, size, yaw} in the drive's own coordinates and units, as a
drive's boxes and ``--marked`` have it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import torch

from unveil_core.base.files import write_json_atomic
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.splats.ply import write_splats
from unveil_core.exports.whole import tell

__all__ = ["object_name", "write_objects"]

KEPT = ("id", "class", "source", "points", "frames", "first_frame", "last_frame", "distance_m")
"""Entries of instances.json that are passed on as they are."""


def write_objects(job: Job, folder: Path) -> None:
    """``objects.json`` and ``<class>_<id>.ply`` for each removed object."""
    place = job.drive.to_world
    full, instances = job.full, job.full_instances
    removed = [entry for entry in job.objects if entry.get("removed")]
    entries = []
    for done, entry in enumerate(removed):
        own = np.flatnonzero(instances == entry["id"])
        name = f"{object_name(entry)}.ply"
        write_splats(job, job.for_viewers(full.select(torch.from_numpy(own))), instances[own], folder / name)
        told: dict[str, Any] = {key: entry[key] for key in KEPT if key in entry}
        box = entry["box"]
        if box is not None:
            size = [place.scale * float(v) for v in box["size"]]
            # A workspace counts from the first axis of ``up_frame``, a drive's boxes from x: a quarter turn on.
            yaw = float(box["yaw"]) % np.pi - np.pi / 2
            told["box"] = {"centre": place.to_world(box["centre"]).tolist(), "size": size, "yaw": yaw}
        entries.append({**told, "splats": name, "splat_count": len(own)})
        job.progress(done + 1, len(removed), "writing objects")
    write_json_atomic(folder / "objects.json", {"objects": entries})
    tell(folder, "objects-json", {"coordinates": drive_coordinates(job.drive).to_json(), "removed": len(entries)})


def object_name(entry: dict[str, Any]) -> str:
    """Name of an object for files and layers, as ``car_0005``."""
    return f"{re.sub('[^a-z0-9]+', '_', str(entry['class']).lower())}_{entry['id']:04d}"

"""3D Gaussian Splatting PLY, the file that splat viewers, editors and Blender 5.3 read.

Attributes as the reference implementation of *3D Gaussian Splatting* (SIGGRAPH 2023) writes them, and two more: ``label``, the
Cityscapes trainId (255 none; 0 keep and 1 remove in scenes of masks only), and ``instance``, the object's id (0 none). All are
floats, and a scene with colours by direction has all 45 coefficients of degree 3: importers know few types and count coefficients
by their place.
Coordinates are the drive's own less a shift, see :mod:`unveil_core.exports.coordinates`; comments of the header and a JSON
file beside it tell it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch

from unveil_core.base.files import write_json_atomic
from unveil_core.base.types import Labels
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.splats.placed import placed
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.surfels import Surfels, with_sh_degree

__all__ = ["sidecar", "write_splat_ply", "write_splats"]

WHOLE_DEGREE = 3
"""Of the colours by direction in a file that has any: the reference implementation and Unity's importer take the first 15
coefficients for red, whatever degree they are of."""


def write_splat_ply(job: Job, path: Path) -> None:
    """The scene as one PLY."""
    write_splats(job, job.scene, job.scene_instances(), path)


def write_splats(job: Job, surfels: Surfels, instances: Labels, path: Path) -> None:
    """Write splats (N) of local coordinates, and the file beside it that tells where they lie.

    Args:
        job: whose scene they are of.
        surfels: with compact labels; instances: (N,) object ids, 0 none.
        path: where.
    """
    frame = drive_coordinates(job.drive)
    there = replace(placed(surfels, frame.shifted), labels=torch.from_numpy(job.train_ids(surfels)))
    if there.sh_degree:
        there = with_sh_degree(there, WHOLE_DEGREE)
    labels = job.labels.labels
    names = [f"label {number} {name}" for number, name in zip(labels.disk_ids, labels.names, strict=True)]
    comments = ("shift " + " ".join(repr(float(v)) for v in frame.shift), *names)
    write_json_atomic(sidecar(path), {**frame.to_json(), "colorspace": job.colorspace})
    write_surfels(there, path, comments=comments, more={"instance": instances}, thin=frame.from_local.scale)


def sidecar(path: Path) -> Path:
    """The JSON file beside an exported file that tells its coordinates."""
    return path.with_name(f"{path.name}.json")

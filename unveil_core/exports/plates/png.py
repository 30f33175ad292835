"""The clean frames as a PNG sequence: ``<camera>/<camera>.1001.png``, the numbers after a dot and of one width.

Files are copied, so depth, channels and untouched pixels are those of the footage, bit for bit; colours are the footage's own, and
the files have its profile and what its camera noted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unveil_core.drives.drive import tracks
from unveil_core.exports.cameras.footage import copy_frames
from unveil_core.exports.job import Job
from unveil_core.exports.whole import camera_file, tell

__all__ = ["numbered", "told_frames", "write_png"]


def write_png(job: Job, folder: Path) -> None:
    """One file a frame, and ``export.json`` that tells which frame each is."""
    copy_frames(job, folder, numbered(job, "png"))
    tell(folder, "png", {"colorspace": job.colorspace, "cameras": told_frames(job)})


def numbered(job: Job, suffix: str) -> list[str]:
    """Names of the drive's frames, in its order, relative to the folder."""
    names = {}
    for track in tracks(job.drive):
        width = max(4, len(str(job.start_frame + len(track) - 1)))
        for place, i in enumerate(track):
            camera = camera_file(job.drive.frames[i].camera_name)
            names[i] = f"{camera}/{camera}.{job.start_frame + place:0{width}d}.{suffix}"
    return [names[i] for i in range(len(job.drive.frames))]


def told_frames(job: Job) -> dict[str, Any]:
    """Source and time stamp of each number, by camera."""
    told: dict[str, Any] = {}
    for track in tracks(job.drive):
        frames = [job.drive.frames[i] for i in track]
        told[frames[0].camera_name] = {
            str(job.start_frame + place): {"source": f.name, "timestamp": f.timestamp} for place, f in enumerate(frames)
        }
    return told

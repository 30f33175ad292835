"""The cameras as delivered: those of the footage, with its size and lens, in the coordinates of a file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from unveil_core.base.files import copy_picture
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion, Frame
from unveil_core.exports.coordinates import Coordinates
from unveil_core.exports.job import Job
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity

__all__ = ["DeliveredCamera", "copy_frames", "delivered_cameras"]


@dataclass(frozen=True, eq=False)
class DeliveredCamera:
    """A frame as it is delivered.

    Attributes:
        frame: of the imported drive.
        camera: of the delivered size, posed in a file's coordinates, in which depth has the file's units.
        distortion: of its lens, None for a pinhole.
        image: name of its picture, ``<camera>/<frame>.png``.
    """

    frame: Frame
    camera: Camera
    distortion: Distortion | None
    image: str

    @property
    def opengl_pose(self) -> Float64:
        """(4, 4) camera-to-world: x right, y up, z back, as nerfstudio, Nuke and Blender have it."""
        pose = self.camera.camera_to_world
        pose[:3, 1:3] *= -1
        return pose


def delivered_cameras(job: Job, frame: Coordinates, *, shifted: bool) -> list[DeliveredCamera]:
    """All frames in the drive's order, in the coordinates of a frame, or in those of its files of single precision."""
    place: Similarity = frame.shifted if shifted else frame.from_local
    found = []
    for own in job.drive.frames:
        camera = own.camera if own.footage is None else own.footage.camera
        lens = None if own.footage is None else own.footage.distortion
        image = f"{own.camera_name}/{own.name}.png"
        posed = replace(camera, world_to_camera=place.camera_to_world(camera).world_to_camera)
        found.append(DeliveredCamera(own, posed, None if lens is None or lens.is_zero else lens, image))
    return found


def copy_frames(job: Job, folder: Path, names: Iterator[str] | list[str]) -> None:
    """Copy the clean frames of the drive, in its order, under these names: bit for bit, and no links, so that who paints on a
    copy leaves the workspace as it is."""
    frames = job.drive.frames
    for done, (frame, name) in enumerate(zip(frames, names, strict=True)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        copy_picture(job.delivered(frame), folder / name)
        job.progress(done + 1, len(frames), "copying frames")

"""The cameras as delivered: those of the footage, with its size and lens or without, in the coordinates of a file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from unveil_core.base.files import copy_picture, write_image_atomic
from unveil_core.base.pictures.decoding import read_image_as_it_is, read_metadata
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion, Frame
from unveil_core.exports.cameras.names import flat_names
from unveil_core.exports.cameras.pinhole import Pinhole, pinhole_of
from unveil_core.exports.coordinates import Coordinates
from unveil_core.exports.job import Job
from unveil_core.geometry.camera import Camera

__all__ = ["DeliveredCamera", "copy_frames", "delivered_cameras", "put_frames", "without_lens"]


@dataclass(frozen=True, eq=False)
class DeliveredCamera:
    """A frame as it is delivered.

    Attributes:
        frame: of the imported drive.
        camera: of the delivered size, posed in a file's coordinates, in which depth has the file's units.
        distortion: of its lens, None for a pinhole.
        image: name of its picture in a folder of all of them, see :func:`flat_names`.
        pinhole: how its picture is made of the clean frame; None where it is the clean frame.
    """

    frame: Frame
    camera: Camera
    distortion: Distortion | None
    image: str
    pinhole: Pinhole | None = None

    @property
    def opengl_pose(self) -> Float64:
        """(4, 4) camera-to-world: x right, y up, z back, as nerfstudio, Nuke and Blender have it."""
        pose = self.camera.camera_to_world
        pose[:3, 1:3] *= -1
        return pose


def delivered_cameras(job: Job, frame: Coordinates) -> list[DeliveredCamera]:
    """All frames in the drive's order, in the coordinates of a frame's files of single precision."""
    found = []
    for own, name in zip(job.drive.frames, flat_names(job.drive.frames), strict=True):
        camera = own.camera if own.footage is None else own.footage.camera
        lens = None if own.footage is None else own.footage.distortion
        posed = replace(camera, world_to_camera=frame.shifted.camera_to_world(camera).world_to_camera)
        found.append(DeliveredCamera(own, posed, None if lens is None or lens.is_zero else lens, f"{name}.png"))
    return found


def without_lens(cameras: Sequence[DeliveredCamera]) -> list[DeliveredCamera]:
    """The same as pinholes whose principal point is in the middle."""
    made = [pinhole_of(c.camera, c.distortion) for c in cameras]
    return [replace(c, camera=p.camera, distortion=None, pinhole=p) for c, p in zip(cameras, made, strict=True)]


def put_frames(job: Job, folder: Path, cameras: Sequence[DeliveredCamera]) -> None:
    """Write the pictures of cameras into a folder: clean frames bit for bit, or what a pinhole shows of them."""
    for done, camera in enumerate(cameras):
        source, target = job.delivered(camera.frame), folder / camera.image
        if camera.pinhole is None:
            copy_picture(source, target)
        else:
            flat = camera.pinhole.of(read_image_as_it_is(source))
            write_image_atomic(target, flat, like=source, metadata=read_metadata(source))
        job.progress(done + 1, len(cameras), "copying frames")


def copy_frames(job: Job, folder: Path, names: Iterable[str]) -> None:
    """Copy the clean frames of the drive, in its order, under these names: bit for bit, and no links, so that who paints on a
    copy leaves the workspace as it is."""
    frames = job.drive.frames
    for done, (frame, name) in enumerate(zip(frames, names, strict=True)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        copy_picture(job.delivered(frame), folder / name)
        job.progress(done + 1, len(frames), "copying frames")

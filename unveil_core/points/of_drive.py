"""Points of a drive that has poses and no points, or next to none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Drive, PointCloud, tracks
from unveil_core.drives.labels.reading import semantics_of
from unveil_core.drives.photographs import photograph
from unveil_core.drives.scale_and_up import camera_height, measured_up
from unveil_core.geometry.camera import Camera
from unveil_core.points.cloud import dense_points
from unveil_core.points.straight import Straightened, straightened

__all__ = ["found_points", "lacks_points"]

FIRST_EACH = 3
"""At first each so many-th frame is looked at: enough to see where the ground is."""
FEWEST = 500
"""Points, with fewer of which a scene cannot begin."""
FEW_A_FRAME = 30
"""Points for each frame, with fewer of which a scene does not begin where photographs show more: a matchmove has some tracks a
frame, a sparse model of structure from motion hundreds."""
SKY = CITYSCAPES.index("sky")


def lacks_points(drive: Drive) -> bool:
    """Whether a drive's points have to be found in its photographs: it has none, or as few as a matchmove has tracks.

    Points that tell more than where they are stay: measured ones, and those with classes.
    """
    points, count = drive.points, len(drive.points.positions)
    telling = points.measured or points.classes is not None
    return not drive.sweeps and (not count or (count < FEW_A_FRAME * len(drive.frames) and not telling))


def found_points(drive: Drive, progress: Progress = no_progress) -> PointCloud:
    """Points of a drive by its photographs and poses, in the drive's own coordinates: the ground and facades.

    Raises:
        DriveError: a photograph cannot be read, or next to nothing is seen twice.
    """
    views = _Views(drive)
    own = tracks(drive)
    up = drive.up if drive.up is not None else measured_up(drive)[0]
    rough = dense_points(views.cameras, [t[::FIRST_EACH] for t in own], views.picture, up, None, progress)
    if len(rough.positions) < FEWEST:
        rough = dense_points(views.cameras, own, views.picture, up, None, progress)
    seen = replace(drive, points=rough)
    if drive.up is None:
        up = measured_up(seen)[0]
    height = camera_height(seen, up)
    found = dense_points(views.cameras, own, views.picture, up, height, progress)
    if len(found.positions) < FEWEST:
        raise DriveError(
            f"has {len(drive.points.positions) or 'no'} points, and its photographs show only {len(found.positions)} places twice",
            path=drive.root,
            mend="give LiDAR or SfM points; photographs of a moving camera, a metre or so apart, show enough",
        )
    return found


class _Views:
    """Photographs of a drive without the distortion of their lens."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        lenses: dict[object, Straightened] = {}
        self.lens: list[Straightened] = []
        for frame in drive.frames:
            key = (frame.camera.intrinsics, frame.distortion)
            if key not in lenses:
                lenses[key] = straightened(frame.camera, frame.distortion)
            self.lens.append(lenses[key])
        self.cameras: list[Camera] = [
            replace(lens.camera, world_to_camera=f.camera.world_to_camera)
            for lens, f in zip(self.lens, drive.frames, strict=True)
        ]

    def picture(self, i: int) -> tuple[Picture, Mask | None]:
        """A frame, and its pixels that are the sky or the vehicle itself."""
        frame, lens = self.drive.frames[i], self.lens[i]
        hidden: Mask | None = None
        if frame.semantic_path is not None:
            hidden = semantics_of(frame) == SKY
        if frame.ego_rows:
            hidden = np.zeros((frame.camera.height, frame.camera.width), bool) if hidden is None else hidden
            hidden[-frame.ego_rows :] = True
        return lens.picture(photograph(frame)), lens.hidden(hidden)

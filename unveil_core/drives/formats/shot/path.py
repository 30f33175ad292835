"""What readers of camera paths give: a pose a frame, and a lens that may need the size of the plates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion

__all__ = ["CameraPath", "Lens", "LensOf", "PathFrame"]

Size = tuple[int, int]


@dataclass(frozen=True)
class Lens:
    """Attributes:
    size: of the pictures that the numbers are of, pixels.
    focal, centre: pixels, x and y; the centre from the corner of the picture.
    distortion: None for a pinhole.
    """

    size: Size
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: Distortion | None = None


LensOf = Callable[[Size, float], Lens]
"""The lens of plates of a size, whose pixels are so many times as wide as high."""


@dataclass(frozen=True, eq=False)
class PathFrame:
    """Attributes:
    pose: (4, 4) from the camera, in the axes of the path's convention, to its world.
    lens: of this frame.
    number: of the frame; None where the path names pictures.
    name: of its picture; None where the path counts frames.
    camera: name of the camera.
    """

    pose: Float64
    lens: LensOf
    number: int | None = None
    name: str | None = None
    camera: str = "camera"


@dataclass(frozen=True, eq=False)
class CameraPath:
    """Attributes:
    frames: as the file has them.
    convention: of the poses, one of ``base.drive_options.POSE_CONVENTIONS``.
    units_per_metre: None where the file does not tell.
    up: (3,) unit; None likewise.
    notices: what a user should know, one line each.
    """

    frames: tuple[PathFrame, ...]
    convention: str
    units_per_metre: float | None = None
    up: Float64 | None = None
    notices: tuple[str, ...] = field(default=())

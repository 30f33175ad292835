"""Where things lie in an exported file: the drive's own coordinates, or these turned to the up axis that a format wants.

Inside, a drive is metres, z up, with a local origin. Three frames go out:

========= ===========================================================================================================
drive     the coordinates of the drive's files, exactly (PLY, OBJ, LAS, COLMAP, nerfstudio)
z up      these, turned so that up is z (USD)
y up      these, turned so that up is y (glTF, SPZ, Nuke)
========= ===========================================================================================================

All have the drive's units. Formats that hold single precision lose millimetres beyond a kilometre and decimetres in UTM. Where
the drive lies so far off, a whole number of units is taken from each coordinate, the same in all files of a frame, and told:
adding the *shift* gives the coordinates of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.similarity import Similarity
from unveil_core.mesh.export import SINGLE_PRECISION_REACH, Z_TO_Y

__all__ = ["Coordinates", "drive_coordinates", "y_up", "z_up"]


@dataclass(frozen=True, eq=False)
class Coordinates:
    """A frame of exported files.

    Attributes:
        name: "drive", "z up" or "y up".
        from_local: from local coordinates to the frame's, before the shift.
        to_drive: (3, 3) rotation from the frame's axes to the drive's.
    """

    name: str
    from_local: Similarity
    to_drive: Float64

    @property
    def shift(self) -> Float64:
        """(3,) what files of single precision leave out: adding it gives the frame's coordinates. Whole units, 0 where the local
        origin lies within :data:`SINGLE_PRECISION_REACH`."""
        origin = self.from_local.translation
        return np.round(origin) if np.abs(origin).max() > SINGLE_PRECISION_REACH else np.zeros(3)

    @property
    def shifted(self) -> Similarity:
        """From local coordinates to those of a file of single precision."""
        return Similarity(self.from_local.scale, self.from_local.rotation, self.from_local.translation - self.shift)

    def to_json(self, *, shifted: bool = True) -> dict[str, Any]:
        """What a file beside the export tells of its coordinates.

        Args:
            shifted: False for a format that holds them whole, in doubles, as text or under a transform.
        """
        return {
            "frame": self.name,
            "shift": self.shift.tolist() if shifted else [0, 0, 0],
            "rotation_to_drive": self.to_drive.tolist(),
            "metres_per_unit": 1 / self.from_local.scale,
            "note": "coordinates of the drive = rotation_to_drive * (coordinates in the file + shift)",
        }


def drive_coordinates(drive: Drive) -> Coordinates:
    """The coordinates of the drive's files."""
    return Coordinates("drive", drive.to_world, np.eye(3))


def z_up(drive: Drive) -> Coordinates:
    """The drive's coordinates, turned as the local ones are: up is z."""
    return _turned(drive, "z up", np.eye(3))


def y_up(drive: Drive) -> Coordinates:
    """The same with up as y, by the usual (x, z, -y)."""
    return _turned(drive, "y up", Z_TO_Y)


def _turned(drive: Drive, name: str, turn: Float64) -> Coordinates:
    world = drive.to_world
    origin = turn @ world.directions_to_local(world.translation)
    return Coordinates(name, Similarity(world.scale, turn, origin), world.rotation @ turn.T)

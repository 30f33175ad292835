"""How much there is to do: what time, memory and disk of a run are told from."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.frames import working_camera
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.blocks import cut_into_blocks
from unveil_core.ground.path import way_of
from unveil_core.ground.track import longest_track

__all__ = ["Workload"]


@dataclass(frozen=True)
class Workload:
    """The size of a run.

    Attributes:
        quality: of the run.
        frames: how many; cameras: of the rig; blocks: that the way is cut into.
        way_m: length of the way, metres.
        size: (width, height) of most frames as they came; side: longer side that they are reduced to.
        given_mpx, working_mpx: millions of pixels of all frames, as they came and reduced.
        memory_mb: room for frames that the user gave.
    """

    quality: str
    frames: int
    cameras: int
    blocks: int
    way_m: float
    size: tuple[int, int]
    side: int
    given_mpx: float
    working_mpx: float
    memory_mb: float

    @staticmethod
    def of_drive(drive: Drive, quality: str, side: int, memory_bytes: int) -> Workload:
        """The work on a drive in metres.

        Args:
            side: longer image side that larger images are reduced to, pixels; memory_bytes: room for frames.
        """
        cameras = [f.camera for f in drive.frames]
        size = Counter((c.width, c.height) for c in cameras).most_common(1)[0][0]
        track = longest_track(drive)
        return Workload(
            quality,
            len(cameras),
            len({f.camera_name for f in drive.frames}),
            len(cut_into_blocks(drive).blocks),
            way_of(centres_of([cameras[i] for i in track])),
            size,
            side,
            sum(c.width * c.height for c in cameras) / 1e6,
            sum(c.width * c.height for c in (working_camera(c, side) for c in cameras)) / 1e6,
            memory_bytes / 2**20,
        )

    @property
    def pixels_mpx(self) -> tuple[float, float]:
        """Millions of pixels of one frame: as it came, and of working size."""
        return self.given_mpx / self.frames, self.working_mpx / self.frames

    def with_side(self, side: int) -> Workload:
        """The same with images of another working size."""
        width, height = self.size
        shrunk = min(1.0, side / max(width, height)) / min(1.0, self.side / max(width, height))
        return replace(self, side=side, working_mpx=self.working_mpx * shrunk**2)

    def with_frames(self, frames: int) -> Workload:
        """The same drive, of which only so many frames are taken."""
        share = frames / self.frames
        return replace(
            self,
            frames=frames,
            blocks=max(1, round(self.blocks * share)),
            way_m=self.way_m * share,
            given_mpx=self.given_mpx * share,
            working_mpx=self.working_mpx * share,
        )

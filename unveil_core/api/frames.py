"""One frame of a workspace: its pictures and masks as arrays, each read when it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.base.pictures.decoding import read_image_as_it_is, read_instance_image, read_label_image
from unveil_core.delivery.lens import work_positions
from unveil_core.drives.drive import Distortion, Frame
from unveil_core.geometry.camera import Camera
from unveil_core.workspace.files import frame_file, load_mask

if TYPE_CHECKING:  # loads torch
    from unveil_core.api.scenes import DeviceName, Scene

__all__ = ["MASKS", "FrameView"]

MASKS = {
    "removed": ("removed",),
    "shadows": ("shadows",),
    "changed": ("removed", "shadows"),
    "unobserved": ("unobserved",),
}
"""Masks by name, with the files that they are of: what removed objects covered, their shadows, both, and what no frame shows."""
NONE = 255
"""TrainId of what has no class."""

Picture = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class FrameView:
    """A frame. All arrays of one frame have the same height and width, see ``size`` of ``Workspace.frames``.

    Attributes:
        workspace: folder that it lies in.
        imported: the frame as the import left it, of working size.
        size: "footage" or "work".
    """

    workspace: Path
    imported: Frame
    size: Literal["footage", "work"]
    scene: Callable[[Literal["full", "empty"]], Scene]

    def __repr__(self) -> str:
        return f"FrameView({self.camera_name}/{self.name}, {self.camera.width}x{self.camera.height})"

    @property
    def name(self) -> str:
        """The stem of its file."""
        return self.imported.name

    @property
    def camera_name(self) -> str:
        """Of the camera that took it."""
        return self.imported.camera_name

    @property
    def timestamp(self) -> float | None:
        """Seconds, or None."""
        return self.imported.timestamp

    @property
    def camera(self) -> Camera:
        """Pinhole camera and pose, in the drive's local metres; at footage size beside it :attr:`distortion`."""
        footage = self.imported.footage
        return self.imported.camera if self.size == "work" or footage is None else footage.camera

    @property
    def distortion(self) -> Distortion | None:
        """The lens of the pictures, None where they have none."""
        footage = self.imported.footage
        return None if self.size == "work" or footage is None else footage.distortion

    def photo(self) -> Picture:
        """(H, W, C), the photograph, with the channels and the 8 or 16 bits of the footage: grey, RGB or RGBA.

        Raises:
            DriveError: it cannot be read.
        """
        return _with_channels(self.imported.image_path if self.size == "work" else self.imported.footage_path)

    def clean(self) -> Picture:
        """The same of the empty street.

        Raises:
            WorkspaceError: it was not made yet.
        """
        folder, stage = ("clean", "reoptimize") if self.size == "work" else ("frames", "deliver")
        return _with_channels(self._file(folder, stage))

    def mask(self, kind: Literal["removed", "shadows", "changed", "unobserved"] = "removed") -> NDArray[np.bool_]:
        """(H, W) bool, see :data:`MASKS`.

        Raises:
            SettingsError: an unknown kind. WorkspaceError: it was not made yet.
        """
        if kind not in MASKS:
            raise SettingsError(f"Not a mask: {kind!r}", mend=f"use one of {', '.join(MASKS)}")
        stages = {"shadows": "inpaint"}
        parts = [load_mask(self._file(f"masks/{name}", stages.get(name, "remove"))) for name in MASKS[kind]]
        whole: NDArray[np.bool_] = np.logical_or.reduce(parts)
        return self._sized(whole.astype(np.uint8), 0).astype(bool)

    def labels(self) -> NDArray[np.uint8]:
        """(H, W) uint8 trainIds of Cityscapes, 255 none.

        Raises:
            WorkspaceError: the drive has no label pictures.
        """
        return self._sized(read_label_image(self._given(self.imported.semantic_path, "label pictures")), NONE)

    def instances(self) -> NDArray[np.uint16]:
        """(H, W) uint16 ids of objects, 0 none.

        Raises:
            WorkspaceError: the drive has no instance maps.
        """
        found = read_instance_image(self._given(self.imported.instance_path, "instance maps"))
        return self._sized(found.astype(np.uint16), 0)

    def depth(self, state: Literal["full", "empty"] = "empty", *, device: DeviceName = "auto") -> NDArray[np.float32]:
        """(H, W) float32 metres along the optical axis, of the scene's surfaces; 0 where there is none.

        Args:
            state: of the scene; device: that renders, as for ``Scene.render``.
        Raises:
            WorkspaceError: the scene was not made yet. SettingsError: "cuda" where no GPU can be used.
        """
        found: NDArray[np.float32] = self._sized(
            self.scene(state).render(self.imported.camera, "depth", device=device), 0
        )
        return found

    def provenance(self) -> NDArray[np.uint8]:
        """(H, W) uint8 where the clean frame's pixels come from: 0 original, 1 relit, 2 seen elsewhere, 3 continued, 4 invented.

        Raises:
            WorkspaceError: it was not made yet.
        """
        return self._sized(read_label_image(self._file("provenance", "reoptimize")), 0)

    def certainty(self) -> NDArray[np.uint8]:
        """(H, W) uint8 how sure the clean frame's pixels are, 0 to 254; 255 the footage's own.

        Raises:
            WorkspaceError: it was not made yet.
        """
        return self._sized(read_label_image(self._file("certainty", "reoptimize")), 255)

    def _file(self, folder: str, stage: str) -> Path:
        path = frame_file(self.workspace / folder, self.imported)
        if not path.is_file():
            raise WorkspaceError("Not made yet", path=path, mend=f"run `unveil {stage}`")
        return path

    def _given(self, path: Path | None, what: str) -> Path:
        if path is None:
            raise WorkspaceError(f"Not given: {what} of {self.camera_name}/{self.name}", path=self.workspace)
        return path

    def _sized(self, plane: NDArray[Any], beyond: int) -> NDArray[Any]:
        """A plane of working size in the size that is asked for, by the nearest pixels; ``beyond`` where it shows none."""
        footage = self.imported.footage
        if self.size == "work" or footage is None:
            return plane
        at = work_positions(footage, self.imported.camera) - np.float32(0.5)
        return cv2.remap(plane, at, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond)


def _with_channels(path: Path) -> Picture:
    """(H, W, C) of a file: a grey picture has one channel, so that what holds for pixels is asked along the last axis of all."""
    picture = read_image_as_it_is(path)
    return picture[..., None] if picture.ndim == 2 else picture

"""What a workspace delivers, at the size at which it is compared."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Picture
from unveil_core.drives.drive import Frame
from unveil_core.drives.importing.frames import at_work_size
from unveil_core.workspace.files import frame_file

__all__ = ["read_delivered"]


def read_delivered(root: Path, frame: Frame) -> Picture:
    """(H, W, 3) the delivered frame, of the size of the imported photograph, and made as that is made of its footage: where
    nothing was removed both are equal.

    Raises:
        WorkspaceError: the frame was not delivered, or in another size than its footage.
    """
    path = frame_file(root / "frames", frame)
    if not path.is_file():
        raise WorkspaceError("this frame was not delivered yet", path=path, mend="run `unveil deliver`")
    picture = read_image(path)
    camera = frame.camera if frame.footage is None else frame.footage.camera
    if picture.shape[:2] != (camera.height, camera.width):
        raise WorkspaceError(
            f"the delivered frame is {picture.shape[1]}x{picture.shape[0]}, the image {camera.width}x{camera.height}",
            path=path,
            mend="run `unveil deliver` again",
        )
    return picture if frame.footage is None else at_work_size(picture, frame.footage, frame.camera)

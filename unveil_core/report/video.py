"""Before and after, side by side, as a small movie."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from unveil_core.base.disk.new_files import new_file
from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import LEAST_ROOM, move
from unveil_core.base.parallel import each
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Picture
from unveil_core.drives.drive import Frame
from unveil_core.drives.drive import frames_per_second as rate_of
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.report.pictures import fitted, pick
from unveil_core.workspace.files import frame_file

__all__ = ["recorded_rate", "write_video"]


GAP_PX = 4
FORMATS = (".mp4", ".webp")
MOST_OF_WEBP = 240
"""Frames of an animated WebP at most: Pillow holds them all until it writes them, a megabyte each."""
USUAL_FPS, FPS_LIMITS = 8.0, (1.0, 60.0)
"""Frames a second of a movie whose frames have no time stamps: about two metres of a street a second, of the usual drives. And the
limits of what time stamps tell: of a key frame a minute nobody waits for the next one."""


def write_video(
    workspace_root: Path,
    path: Path,
    *,
    camera_name: str | None = None,
    frames_per_second: float | None = None,
    height: int | None = None,
    progress: Progress = no_progress,
) -> Path:
    """Write photograph and empty street side by side.

    Args:
        workspace_root: a workspace with ``frames/``.
        path: ``.mp4`` (MPEG-4, which every player opens), or ``.webp``, animated, which every browser shows. Where
            the encoder for mp4 is missing, the file becomes a ``.webp`` beside it.
        camera_name: the track to show; the longest by default.
        frames_per_second: of the movie; by default as the camera took them.
        height: of the movie in pixels; by default that of the images, at most 480.
        progress: called once per frame.
    Returns:
        the file that was written.
    Raises:
        WorkspaceError: nothing was delivered yet, or the format is unknown.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise WorkspaceError("Not a format of movies", path=path, mend=f"use {' or '.join(FORMATS)}")
    root = Path(workspace_root)
    frames = _delivered(root, camera_name)
    rate = recorded_rate(frames) if frames_per_second is None else frames_per_second
    tall = min(480, frames[0].camera.height) if height is None else height
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix.lower() == ".mp4":
        if _write_mp4(path, _pairs(root, frames, tall, progress), rate):
            return path
        path = path.with_suffix(".webp")
    fewer = [frames[i] for i in pick(len(frames), MOST_OF_WEBP)]
    _write_webp(path, _pairs(root, fewer, tall, progress), rate * len(fewer) / len(frames))
    return path


def recorded_rate(frames: Sequence[Frame]) -> float:
    """Frames a second at which a movie of one camera's frames goes as fast as the drive went."""
    return float(np.clip(rate_of(frames) or USUAL_FPS, *FPS_LIMITS))


def _delivered(root: Path, camera_name: str | None) -> list[Frame]:
    tracks: dict[str, list[Frame]] = {}
    for frame in read_imported(root / "drive", points=False).frames:
        if frame_file(root / "frames", frame).is_file() and camera_name in (None, frame.camera_name):
            tracks.setdefault(frame.camera_name, []).append(frame)
    if not tracks:
        where = root / "frames" / (camera_name or "")
        raise WorkspaceError("Not made yet: delivered frames", path=where, mend="run `unveil deliver`")
    return max(tracks.values(), key=len)


def _pairs(root: Path, frames: list[Frame], height: int, progress: Progress) -> Iterator[Picture]:
    """Both pictures with a gap between them; all of the size of the first, sides even as encoders ask."""
    camera = frames[0].camera
    tall = max(2, height // 2 * 2)
    wide = max(2, round(camera.width * tall / camera.height) // 2 * 2)
    gap = np.full((tall, GAP_PX, 3), 255, dtype=np.uint8)

    def pair(frame: Frame) -> Picture:
        before, after = (fitted(p, (wide, tall)) for p in (read_image(frame.image_path), read_delivered(root, frame)))
        return np.concatenate([before, gap, after], axis=1)

    for done, picture in enumerate(each(pair, frames)):
        yield picture
        progress(done + 1, len(frames), "writing the movie")


def _temporary(path: Path) -> Path:
    handle, temporary = new_file(path.parent, f".{path.stem}.", f".partial{path.suffix}")
    os.close(handle)
    return temporary


def _finish(temporary: Path, path: Path) -> None:
    with temporary.open("rb") as stream:
        os.fsync(stream.fileno())
    move(temporary, path)


def _write_mp4(path: Path, pairs: Iterator[Picture], rate: float) -> bool:
    """False where OpenCV has no encoder; then nothing is left behind."""
    temporary = _temporary(path)
    writer: cv2.VideoWriter | None = None
    try:
        for picture in pairs:
            if writer is None:
                code = cv2.VideoWriter.fourcc(*"mp4v")
                writer = cv2.VideoWriter(str(temporary), code, rate, (picture.shape[1], picture.shape[0]))
                if not writer.isOpened():
                    return False
            writer.write(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
        if writer is None:
            return False
        writer.release()
        if not _is_whole(temporary):
            # OpenCV does not tell that a file could not be written to its end.
            if shutil.disk_usage(path.parent).free < LEAST_ROOM:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
            return False
        _finish(temporary, path)
        return True
    finally:
        if writer is not None:
            writer.release()
        temporary.unlink(missing_ok=True)


def _is_whole(path: Path) -> bool:
    """Whether an MPEG-4 file is as long as its parts say, and has the one that tells where the pictures lie, written last."""
    names, end, size = set(), 0, path.stat().st_size
    with path.open("rb") as stream:
        while end < size:
            stream.seek(end)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:  # the next number has it
                length = int.from_bytes(head[8:16], "big")
            if length < 8 or end + length > size:
                return False
            names.add(head[4:8])
            end += length
    return b"moov" in names


def _write_webp(path: Path, pairs: Iterator[Picture], rate: float) -> None:
    pictures = [Image.fromarray(p) for p in pairs]
    temporary = _temporary(path)
    try:
        pictures[0].save(
            temporary,
            format="WEBP",
            save_all=True,
            append_images=pictures[1:],
            duration=round(1000 / rate),
            loop=0,
            quality=70,
            method=2,
        )
        _finish(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)

"""Clips, decoded by PyAV (FFmpeg) to PNGs of their own depth, upright, with the time of each frame."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.drive_options import frame_range
from unveil_core.base.errors import DriveError
from unveil_core.base.files import write_image_atomic
from unveil_core.base.progress import Progress, no_progress
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.footage.opening import not_readable, opened_clip
from unveil_core.solve.settings import focal_of_film

__all__ = ["decode_clip", "noted_size"]

SD_HEIGHT = 720
"""Pictures of fewer rows are coded by BT.601 where they do not say, others by BT.709: players do the same."""
BT601, BT709, BT2020 = 5, 1, 9
"""H.273's numbers of matrices; 2 means that none is told."""
HDR = {16: "PQ", 18: "HLG"}
"""Transfers of high dynamic range, by H.273's number."""
FOCAL_KEYS = re.compile(r"focal.?length.*35|35mm.*focal", re.IGNORECASE)
WHOLE = 0.97
"""Share of the frames that a clip notes, and two less, with which it is whole: an edit list leaves some out."""
INTERLACED = (
    "the clip is interlaced: every frame is two moments. It is deinterlaced here; progressive footage, or a better deinterlacer "
    "before, gives sharper frames"
)


def decode_clip(
    path: Path, images: Path, camera: str, frames: str | None, every: int, folder: str, progress: Progress = no_progress
) -> Reel:
    """Decode a clip: each frame that is asked for becomes ``images/FOLDER/NUMBER.png``; frames that are there stay.

    Args:
        frames: "A:B:STEP" or None; every: of these each so many-th.
        folder: within ``images``, "" for none.
    Raises:
        DriveError: it is no clip that can be decoded, or the part that is asked for is empty.
    """
    import av

    notices: list[str] = []
    try:
        with opened_clip(path) as (container, stream):
            stream.thread_type = "AUTO"
            about = _About(container, stream)
            wanted = _wanted(frames, every, stream.frames or 0, path)
            found = _Found(path, images, camera, folder, about)
            number = -1
            for number, frame in _decoded(container, stream, notices):
                if wanted(number):
                    found.keep(number, frame)
                progress(number + 1, max(stream.frames or 0, number + 1), "decoding")
                if wanted.after(number):
                    break
            else:
                if INTERLACED not in notices:  # some files count fields
                    notices += _cut_short(number + 1, stream.frames or 0)
    except av.error.FFmpegError as error:
        if "found" not in locals() or not found.frames:
            raise not_readable(path, error) from error
        notices.append(f"the clip is damaged after frame {found.frames[-1].number}: what comes before is used")
    if not found.frames:
        raise DriveError("has no frames in that part", path=path, mend="give --frames within the clip")
    return found.reel(tuple([*notices, *found.notices]))


def _cut_short(count: int, noted: int) -> list[str]:
    """What to say of a file that ends before the frames that it notes."""
    if count >= WHOLE * noted - 2:
        return []
    return [
        f"the file ends early: {count} of its {noted} frames can be read, and are used; copy it again from its source"
    ]


def noted_size(path: Path) -> tuple[int, tuple[int, int]]:
    """How many frames a clip notes that it has, and the width and height of the first one, upright, pixels.

    Raises:
        DriveError: it is no clip that can be decoded.
    """
    import av

    try:
        with opened_clip(path) as (container, stream):
            count = stream.frames
            if not count and container.duration and stream.average_rate:
                count = round(container.duration / 1e6 * float(stream.average_rate))
            frame = next(container.decode(stream))
            if not count:
                count = 1 + sum(1 for packet in container.demux(stream) if packet.size)
            turned = int(round(frame.rotation / 90)) % 2
            return int(count), (frame.height, frame.width) if turned else (frame.width, frame.height)
    except StopIteration as error:
        raise not_readable(path, "it has no frames") from error
    except av.error.FFmpegError as error:
        raise not_readable(path, error) from error


def _decoded(container: Any, stream: Any, notices: list[str]) -> Iterator[tuple[int, Any]]:
    """Frames in the order in which they are shown; of interlaced ones the moments are put together by FFmpeg's bwdif."""
    graph, count = None, 0
    for frame in container.decode(stream):
        if frame.interlaced_frame and graph is None:
            graph = _deinterlacer(stream)
            notices.append(INTERLACED)
        if graph is None:
            yield count, frame
            count += 1
            continue
        graph.push(frame)
        for calm in _pulled(graph):
            yield count, calm
            count += 1
    if graph is not None:
        with suppress(EOFError):
            graph.push(None)
        for calm in _pulled(graph):
            yield count, calm
            count += 1


def _deinterlacer(stream: Any) -> Any:
    import av.filter

    graph = av.filter.Graph()
    first = graph.add_buffer(template=stream)
    calm = graph.add("bwdif", "mode=send_frame")
    last = graph.add("buffersink")
    first.link_to(calm)
    calm.link_to(last)
    graph.configure()
    return graph


def _pulled(graph: Any) -> Iterator[Any]:
    import av

    while True:
        try:
            yield graph.pull()
        except (av.error.BlockingIOError, av.error.EOFError, EOFError):
            return


class _wanted:
    """Which frames are asked for, by number; counts from the end need the number of frames, which most clips tell."""

    def __init__(self, frames: str | None, every: int, count: int, path: Path) -> None:
        parts = [frame_range(p) for p in frames.split(",")] if frames is not None else [slice(None)]
        backwards = any(v is not None and v < 0 for p in parts for v in (p.start, p.stop))
        if backwards and not count:
            raise DriveError("does not tell how many frames it has", path=path, mend="give --frames A:B counted from 0")
        ends = [p.indices(count if backwards else 1 << 40) for p in parts]
        self.ranges, self.every = [range(*e) for e in ends], every
        self.last = max((r[-1] for r in self.ranges if len(r)), default=-1)

    def __call__(self, number: int) -> bool:
        inside = next((r for r in self.ranges if number in r), None)
        return inside is not None and (number - inside.start) // inside.step % self.every == 0

    def after(self, number: int) -> bool:
        """Whether no frame behind this one is asked for."""
        return number >= self.last


class _About:
    """What a clip's file notes."""

    def __init__(self, container: Any, stream: Any) -> None:
        notes = {**container.metadata, **stream.metadata}
        self.begun: float | None = None
        for key in ("com.apple.quicktime.creationdate", "creation_time"):
            with suppress(KeyError, ValueError):
                self.begun = datetime.fromisoformat(notes[key]).timestamp()
                break
        equivalent = [v for k, v in notes.items() if FOCAL_KEYS.search(k)]
        self.focal_mm: float | None = None
        with suppress(IndexError, ValueError):
            self.focal_mm = float(equivalent[0].split()[0])
        rate = stream.average_rate
        self.rate = float(rate) if rate else None


class _Found:
    """Frames as they are kept."""

    def __init__(self, path: Path, images: Path, camera: str, folder: str, about: _About) -> None:
        self.path, self.images, self.camera, self.folder, self.about = path, images, camera, folder, about
        self.frames: list[FootageFrame] = []
        self.notices: list[str] = []
        self.size, self.bits = (0, 0), 8
        (images / folder).mkdir(parents=True, exist_ok=True)

    def keep(self, number: int, frame: Any) -> None:
        name = f"{number:06d}"
        file = f"{self.folder}/{name}.png" if self.folder else f"{name}.png"
        turned = int(round(frame.rotation / 90)) % 4
        size = (frame.width, frame.height) if turned % 2 == 0 else (frame.height, frame.width)
        if not self.frames:
            self.size, self.bits = size, max(c.bits for c in frame.format.components)
            if (transfer := HDR.get(int(frame.color_trc or 0))) is not None:
                self.notices.append(
                    f"the clip is HDR ({transfer}): its values are kept as they are, and look grey where sRGB is expected; a clip "
                    "in SDR, or one that a grading program converted, looks right"
                )
        elif size != self.size:
            raise DriveError(
                f"changes its size at frame {number}, from {self.size[0]}x{self.size[1]} to {size[0]}x{size[1]}",
                path=self.path,
                mend=f"give one part: --frames 0:{number}",
            )
        place = self.images / file
        if not place.is_file():
            write_image_atomic(place, np.ascontiguousarray(np.rot90(_picture(frame, self.bits), turned)))
        time = frame.time
        if time is None and self.about.rate is not None:
            time = number / self.about.rate
        self.frames.append(FootageFrame(self.camera, name, number, file, None if time is None else float(time)))

    def reel(self, notices: tuple[str, ...]) -> Reel:
        focal = self.about.focal_mm
        px = None if focal is None else focal_of_film(focal, self.size)
        source = "" if focal is None else f"the clip's notes, {focal:g} mm as of 35 mm film"
        return Reel(
            self.camera,
            str(self.path),
            self.size,
            self.bits,
            tuple(self.frames),
            px,
            source,
            self.about.begun,
            notices,
        )


def _picture(frame: Any, bits: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """(H, W, 3) RGB as the clip codes it, 8 bits or 16."""
    space = int(frame.colorspace or 2)
    if space not in (BT601, 6, BT709, BT2020):
        space = BT709 if frame.height >= SD_HEIGHT else BT601
    kind = "rgb24" if bits <= 8 else "rgb48le"
    found: NDArray[Any] = frame.reformat(format=kind, src_colorspace=space, dst_color_range="JPEG").to_ndarray()
    return found

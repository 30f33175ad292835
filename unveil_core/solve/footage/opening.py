"""The one way to open a clip: as the kind of file that its name says, with decoders of what cameras and editors write.

FFmpeg by itself looks at the content alone, and knows hundreds of kinds: lists that name other files, pictures, games' movies.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError

__all__ = ["not_readable", "opened_clip"]

BROKEN = "copy the clip again from its source, or mend it with: ffmpeg -i CLIP -c copy MENDED.mp4"
DEMUXERS = {
    ".avi": "avi",
    ".mkv": "matroska",
    ".webm": "matroska",
    ".mts": "mpegts",
    ".m2ts": "mpegts",
    ".ts": "mpegts",
    ".mxf": "mxf",
    ".wmv": "asf",
}
"""FFmpeg's names, by suffix; the others are QuickTime's family, or MPEG's, see :data:`MPEG`."""
QUICKTIME = "mov"
MPEG = {b"\x47": "mpegts", b"\0\0\1\xb3": "mpegvideo"}
"""By the first bytes what is called .mpg; a program stream else."""
MPEG_SUFFIXES = (".mpg", ".mpeg")
DECODERS = (
    "h264,hevc,vvc,av1,libdav1d,vp8,vp9,mpeg1video,mpeg2video,mpeg4,msmpeg4v1,msmpeg4v2,msmpeg4,h263,wmv1,wmv2,wmv3,vc1,mjpeg,"
    "dvvideo,prores,prores_raw,dnxhd,cfhd,ffv1,ffvhuff,huffyuv,utvideo,rawvideo,v210,v410,r210"
)
"""FFmpeg's names of those that pictures of a clip are decoded with."""
READ_BYTES = 1 << 20
"""At a time."""


def not_readable(path: Path, why: object) -> DriveError:
    """The error for a clip that cannot be decoded, of a reason or of FFmpeg's error."""
    told = getattr(why, "strerror", None) or (why if isinstance(why, str) else type(why).__name__)
    return DriveError(f"Not a readable video: {told}", path=path, mend=BROKEN)


@contextmanager
def opened_clip(path: Path) -> Iterator[tuple[Any, Any]]:
    """PyAV's container of a clip and its stream of pictures, open; errors of FFmpeg while it is open are the caller's.

    Raises:
        DriveError: it is no regular file, not of the kind that its name says, or has no pictures that cameras or editors write.
    """
    import av

    try:
        file = open_file(path)
    except OSError as error:
        raise not_readable(path, error) from error
    options = {"protocol_whitelist": "none", "codec_whitelist": DECODERS}
    with file:
        first = file.read(4)
        file.seek(0)
        try:
            container = av.open(
                file, format=_demuxer(path, first), options=options, metadata_errors="replace", buffer_size=READ_BYTES
            )
        except av.error.FFmpegError as error:
            raise not_readable(path, error) from error
        with container:
            if not container.streams.video:
                raise DriveError(
                    "Not a video: it has no pictures", path=path, mend="give a clip or a folder of pictures"
                )
            stream = container.streams.video[0]
            decoder = None if stream.codec_context is None else stream.codec_context.codec.name
            if decoder not in DECODERS.split(","):
                raise DriveError(
                    f"Not a readable video: its pictures are {decoder or 'of an unknown kind'}, which are not decoded here",
                    path=path,
                    mend="convert it: ffmpeg -i CLIP -c:v libx264 -crf 12 CONVERTED.mp4",
                )
            yield container, stream


def _demuxer(path: Path, first: bytes) -> str:
    suffix = path.suffix.lower()
    if suffix in MPEG_SUFFIXES:
        return next((name for begin, name in MPEG.items() if first.startswith(begin)), "mpeg")
    return DEMUXERS.get(suffix, QUICKTIME)

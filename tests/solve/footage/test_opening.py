"""Clips of cameras and editors are opened, by what their names say; nothing else that FFmpeg could read is."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from tests.solve.films import smooth_pictures, write_clip
from unveil_core.base.errors import DriveError
from unveil_core.solve.footage.kinds import VIDEOS
from unveil_core.solve.footage.video import decode_clip, noted_size

pytest.importorskip("av")
MPEG2: dict[str, Any] = {"codec": "mpeg2video", "options": {}, "rate": 25}
WRITTEN: dict[str, dict[str, Any]] = {
    ".avi": {"codec": "mpeg4", "options": {}},
    ".webm": {"codec": "libvpx-vp9"},
    ".mpg": MPEG2,
    ".mpeg": MPEG2,
    ".mxf": MPEG2,
    ".wmv": {"codec": "wmv2", "options": {}},
    ".3gp": {"size": (128, 96)},
}
"""By suffix what cameras write there; H.264 in the others."""
EDITED = {
    "prores_ks": "yuv422p10le",
    "mjpeg": "yuvj420p",
    "ffv1": "yuv420p",
    "dnxhd": "yuv422p",
    "cfhd": "yuv422p10le",
    "rawvideo": "uyvy422",
}
"""By codec its layout of pixels; in QuickTime, but for FFV1."""


def taken(clip: Path, folder: Path) -> int:
    """How many frames a clip gives."""
    assert noted_size(clip)[0] > 0
    return len(decode_clip(clip, folder / "images", "camera", None, 1, "").frames)


def refused(clip: Path, folder: Path, why: str = "Not a readable video: ") -> None:
    for read in (lambda: decode_clip(clip, folder / "images", "camera", None, 1, ""), lambda: noted_size(clip)):
        with pytest.raises(DriveError, match=why) as told:
            read()
        assert "\n" not in str(told.value) and clip.name in str(told.value)
    assert not list(folder.rglob("*.png"))


@pytest.mark.parametrize("suffix", VIDEOS)
def test_clips_of_every_name_are_opened(suffix: str, tmp_path: Path) -> None:
    how = dict(WRITTEN.get(suffix, {}))
    pictures = smooth_pictures(4, how.pop("size", (96, 64)))
    assert taken(write_clip(tmp_path / f"a{suffix}", pictures, **how), tmp_path) == 4


@pytest.mark.parametrize("suffix", ["mpegts", "mpeg2video"])
def test_mpg_may_also_be_a_transport_stream_or_pictures_alone(suffix: str, tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mpg", smooth_pictures(4), **MPEG2, format=suffix)
    assert taken(clip, tmp_path) == 4


@pytest.mark.parametrize("codec", EDITED)
def test_what_editors_write_is_decoded(codec: str, tmp_path: Path) -> None:
    size = (1920, 1080) if codec == "dnxhd" else (96, 64)
    suffix = "mkv" if codec == "ffv1" else "mov"
    options = {"b": "36M"} if codec == "dnxhd" else {}
    how: dict[str, Any] = {"codec": codec, "pixels": EDITED[codec], "options": options, "rate": 25}
    assert taken(write_clip(tmp_path / f"a.{suffix}", smooth_pictures(2, size), **how), tmp_path) == 2


@pytest.mark.parametrize(
    ("format_", "codec", "pixels"),
    [
        ("apng", "apng", "rgb24"),
        ("gif", "gif", "rgb8"),
        ("flv", "flv", "yuv420p"),
        ("mov", "jpeg2000", "rgb24"),
        ("mov", "dpx", "rgb24"),
        ("mov", "png", "rgb24"),
    ],
)
def test_other_kinds_under_the_name_of_a_clip_are_refused(
    format_: str, codec: str, pixels: str, tmp_path: Path
) -> None:
    clip = write_clip(tmp_path / "a.mp4", smooth_pictures(3), format=format_, codec=codec, pixels=pixels, options={})
    refused(clip, tmp_path)


def test_a_playlist_opens_no_other_file(tmp_path: Path) -> None:
    write_clip(tmp_path / "private.mp4", smooth_pictures(3))
    os.mkfifo(tmp_path / "pipe.mp4")
    for k, listed in enumerate(("private.mp4", "pipe.mp4")):
        clip = tmp_path / f"clip{k}.mp4"
        clip.write_text(f"ffconcat version 1.0\nfile {listed}\n")
        refused(clip, tmp_path)
    clip.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile://{tmp_path}/private.mp4\n#EXT-X-ENDLIST\n")
    refused(clip, tmp_path)


def test_a_pipe_is_no_clip_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mp4")
    refused(tmp_path / "a.mp4", tmp_path, "not a file but a pipe or a device")


def test_notes_that_are_no_text_do_no_harm(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mkv", smooth_pictures(3), title="a street")
    content = clip.read_bytes()
    assert content.count(b"a street") == 1
    clip.write_bytes(content.replace(b"a street", b"\xff\xfe\x80\xff\xff\xff\xff\xff"))
    assert taken(clip, tmp_path) == 3

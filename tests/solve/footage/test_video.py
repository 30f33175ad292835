"""Clips of all kinds become upright PNGs of their own depth, with their times."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.solve.films import SAMPLE, smooth_pictures, write_clip
from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.solve.footage.frames import read_reel, write_reel
from unveil_core.solve.footage.video import decode_clip

pytest.importorskip("av")


def test_frames_come_with_their_times_also_at_a_variable_rate(tmp_path: Path) -> None:
    pictures, times = smooth_pictures(6), [0.0, 0.1, 0.25, 0.3, 0.7, 0.75]
    clip = write_clip(tmp_path / "a.mp4", pictures, times)
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 1, "")
    assert [round(f.time_s or 0.0, 3) for f in reel.frames] == times
    assert [f.file for f in reel.frames] == [f"{k:06d}.png" for k in range(6)]
    for frame, wanted in zip(reel.frames, pictures, strict=True):
        found = read_image_as_it_is(tmp_path / "images" / frame.file)
        assert np.abs(found.astype(int) - wanted).mean() < 4
    write_reel(reel, tmp_path / "reel.json")
    assert read_reel(tmp_path / "reel.json") == reel


def test_ten_bits_stay(tmp_path: Path) -> None:
    ramp = np.broadcast_to(np.linspace(20000, 24000, 96).astype(np.uint16)[None, :, None], (64, 96, 3))
    clip = write_clip(
        tmp_path / "a.mov",
        [ramp] * 3,
        codec="libx265",
        pixels="yuv420p10le",
        options={"x265-params": "log-level=none:lossless=1"},
    )
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 1, "")
    found = read_image_as_it_is(tmp_path / "images" / reel.frames[0].file)
    assert reel.bits == 10 and found.dtype == np.uint16
    assert len(np.unique(found[32, :, 1])) > 40  # 8 bits would leave 16 steps
    assert np.abs(found[32].astype(int) - ramp[32]).max() < 300


def test_a_part_is_taken_and_what_is_there_is_not_decoded_again(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4", smooth_pictures(9))
    reel = decode_clip(clip, tmp_path / "images", "camera", "2:8", 2, "left")
    assert [f.number for f in reel.frames] == [2, 4, 6]
    assert reel.frames[0].file == "left/000002.png"
    kept = tmp_path / "images" / reel.frames[0].file
    cv2.imwrite(str(kept), np.zeros((64, 96, 3), np.uint8))
    decode_clip(clip, tmp_path / "images", "camera", "2:8", 2, "left")
    assert not cv2.imread(str(kept)).any()


@pytest.mark.parametrize(
    ("angle", "turn"), [(90, cv2.ROTATE_90_CLOCKWISE), (270, cv2.ROTATE_90_COUNTERCLOCKWISE), (180, cv2.ROTATE_180)]
)
def test_a_clip_that_is_held_upright_comes_out_upright(tmp_path: Path, angle: int, turn: int) -> None:
    """The matrix of ISO 14496-12, 8.3.2, as phones write it: how a player turns the picture, clockwise."""
    pictures = smooth_pictures(3)
    clip = write_clip(tmp_path / "a.mp4", pictures)
    content = bytearray(clip.read_bytes())
    one = 1 << 16
    matrix = {90: (0, one, 0, -one, 0, 0), 180: (-one, 0, 0, 0, -one, 0), 270: (0, -one, 0, one, 0, 0)}[angle]
    at = content.index(b"tkhd") + 4 + 40
    content[at : at + 36] = b"".join(v.to_bytes(4, "big", signed=True) for v in (*matrix, 0, 0, 1 << 30))
    clip.write_bytes(content)
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 1, "")
    found = read_image_as_it_is(tmp_path / "images" / reel.frames[0].file)
    wanted = cv2.rotate(pictures[0], turn)
    assert reel.size == wanted.shape[1::-1] == found.shape[1::-1]
    assert np.abs(found.astype(int) - wanted).mean() < 4


def test_what_is_broken_is_told_in_a_line(tmp_path: Path) -> None:
    bad = tmp_path / "a.mp4"
    bad.write_bytes(b"\0" * 2000)
    with pytest.raises(DriveError, match=r"a\.mp4: Not a readable video: .*copy the clip again") as told:
        decode_clip(bad, tmp_path / "images", "camera", None, 1, "")
    assert "\n" not in str(told.value)


def test_a_clip_that_is_cut_short_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mkv", smooth_pictures(30, (320, 240)), options={"crf": "1", "g": "1"})
    content = clip.read_bytes()
    clip.write_bytes(content[: len(content) // 2])
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 1, "")
    assert 4 < len(reel.frames) < 30


def test_a_file_that_ends_before_its_frames_says_so(tmp_path: Path) -> None:
    """As of a copy that broke off: the frames that it notes come first, so FFmpeg meets nothing but an early end."""
    clip = tmp_path / "a.mp4"
    whole = SAMPLE / "clip.mp4"
    clip.write_bytes(whole.read_bytes()[: whole.stat().st_size // 8])
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 4, "")
    (line,) = reel.notices
    assert line.startswith("the file ends early: ") and " of its 96 frames" in line and "copy it again" in line
    part = decode_clip(clip, tmp_path / "images", "camera", "0:4", 1, "")
    assert len(part.frames) == 4 and not part.notices


def test_an_interlaced_clip_is_told_and_combed_no_more(tmp_path: Path) -> None:
    rows = np.arange(64)[:, None] % 2
    combed = []
    for k in range(6):
        shown = np.full((64, 96, 3), 90, np.uint8)
        for field in (0, 1):  # a bar that moves between the two fields
            left = 10 + 8 * (2 * k + field) % 70
            shown[(rows[:, 0] == field), left : left + 10] = 230
        combed.append(shown)
    clip = write_clip(tmp_path / "a.mp4", combed, options={"crf": "5", "x264-params": "interlaced=1:tff=1"})
    reel = decode_clip(clip, tmp_path / "images", "camera", None, 1, "")
    assert any("interlaced" in line and "progressive" in line for line in reel.notices)
    found = read_image_as_it_is(tmp_path / "images" / reel.frames[3].file).astype(int)[..., 1]
    comb = np.abs(found[1:-1] * 2 - found[:-2] - found[2:]).mean()
    before = combed[3].astype(int)[..., 1]
    assert comb < 0.4 * np.abs(before[1:-1] * 2 - before[:-2] - before[2:]).mean()

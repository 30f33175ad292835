"""The movies as PyAV decodes them: frames, rate, tags, and colours that do not drift."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.exports.conftest import Street
from unveil_core.base.files import write_image_atomic
from unveil_core.exports.job import Job
from unveil_core.exports.plates.movie import write_mp4, write_prores
from unveil_core.workspace.workspace import Workspace

av = pytest.importorskip("av")


@pytest.mark.parametrize(
    ("name", "codec", "pixels", "suffix"),
    [("mp4", "h264", "yuv420p", "mp4"), ("prores", "prores", "yuv422p10le", "mov")],
)
def test_movies_have_all_frames_at_the_drives_rate(
    name: str, codec: str, pixels: str, suffix: str, street: Street
) -> None:
    with av.open(str(street.exported(name) / f"front.{suffix}")) as movie:
        stream = movie.streams.video[0]
        frames = list(movie.decode(stream))
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == (codec, pixels)
        assert float(stream.average_rate) == 10 and len(frames) == 3
        assert (frames[0].width, frames[0].height) == (128, 96)
        tags = stream.codec_context
        assert (int(tags.color_primaries), int(tags.color_trc), int(tags.colorspace)) == (1, 1, 1)
    video = cv2.VideoCapture(str(street.exported(name) / f"front.{suffix}"))  # by a build of FFmpeg of its own
    assert video.get(cv2.CAP_PROP_FPS) == 10
    assert [video.read()[0] for _ in range(4)] == [True, True, True, False]


@pytest.mark.parametrize(("write", "suffix"), [(write_mp4, "mp4"), (write_prores, "mov")])
def test_colours_come_back_by_rec_709(write, suffix: str, street: Street, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Plain patches of an odd size: saturated red by Rec. 601 would be off by 20 levels."""
    colors = np.array([[200, 30, 30], [30, 180, 60], [40, 60, 200], [128, 128, 128]], np.uint8)
    picture = np.repeat(np.repeat(colors.reshape(2, 2, 3), 21, axis=0)[:41], 33, axis=1)[:, :65]
    job = Job(Workspace.open(street.root))
    for frame in job.drive.frames:
        write_image_atomic(tmp_path / f"frames/front/{frame.name}.png", picture)
    moved = Moved(job, tmp_path)
    (tmp_path / "movie").mkdir()
    write(moved, tmp_path / "movie")
    with av.open(str(tmp_path / f"movie/front.{suffix}")) as movie:
        first = next(movie.decode(video=0))
        assert (first.width, first.height) == (66, 42)
        rgb = first.reformat(format="rgb24", src_colorspace="ITU709", src_color_range="MPEG").to_ndarray()
    for row, column in ((10, 16), (10, 48), (30, 16), (30, 48)):
        difference = np.abs(rgb[row, column].astype(int) - picture[row, column].astype(int))
        assert difference.max() <= 4, (row, column)


class Moved(Job):
    """The same job with the clean frames of another folder."""

    def __init__(self, job: Job, root: Path) -> None:
        super().__init__(job.workspace)
        object.__setattr__(self, "root", root)

    def delivered(self, frame) -> Path:  # type: ignore[no-untyped-def]
        return self.root / f"frames/{frame.camera_name}/{frame.name}.png"  # type: ignore[attr-defined]

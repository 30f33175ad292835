"""Movies, strips and the closing lines."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tests.evaluate.street_workspace import build_workspace
from unveil_core.base.errors import Cancelled, WorkspaceError
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import no_progress
from unveil_core.drives.imported import read_imported
from unveil_core.evaluate import run_evaluation, write_metrics
from unveil_core.report import video
from unveil_core.report.collect import gather
from unveil_core.report.page import build_page
from unveil_core.report.summary import print_summary
from unveil_core.report.video import write_video
from unveil_core.report.wording import decibels, detail, memory, movers, percent, seconds, similarity


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    workspace = build_workspace(tmp_path_factory.mktemp("street"), count=5, width=96, height=64)
    write_metrics(run_evaluation(workspace), workspace / "metrics.json")
    return workspace


def photographs(workspace: Path) -> list[np.ndarray]:
    return [read_image(f.image_path) for f in read_imported(workspace / "drive").frames]


def delivered(workspace: Path) -> list[np.ndarray]:
    return [read_image(p) for p in sorted((workspace / "frames/front").glob("*.png"))]


def test_mp4_shows_both(finished: Path, tmp_path: Path) -> None:
    path = write_video(finished, tmp_path / "movie/street.mp4")
    assert path.suffix == ".mp4"
    movie = cv2.VideoCapture(str(path))
    for before, after in zip(photographs(finished), delivered(finished), strict=True):
        found, picture = movie.read()
        assert found
        assert picture.shape == (64, 2 * 96 + video.GAP_PX, 3)
        shown = picture[..., ::-1].astype(float)
        assert np.abs(shown[:, :96] - before).mean() < 8
        assert np.abs(shown[:, -96:] - after).mean() < 8
    assert not movie.read()[0]
    assert [p.name for p in path.parent.iterdir()] == ["street.mp4"]


def test_a_movie_goes_as_fast_as_the_drive_did(finished: Path, tmp_path: Path) -> None:
    frames = read_imported(finished / "drive").frames
    assert video.recorded_rate(frames) == video.USUAL_FPS
    for step, rate in ((0.1, 10.0), (1 / 30, 30.0), (20.0, 1.0), (0.001, 60.0)):
        timed = [replace(f, timestamp=1.5e9 + step * i) for i, f in enumerate(frames)]
        assert video.recorded_rate(timed) == pytest.approx(rate, rel=1e-3)
    workspace = tmp_path / "timed"
    shutil.copytree(finished, workspace)
    document = json.loads((workspace / "drive/cameras.json").read_text())
    for i, entry in enumerate(document["frames"]):
        entry["timestamp"] = 0.05 * i
    (workspace / "drive/cameras.json").write_text(json.dumps(document))
    movie = cv2.VideoCapture(str(write_video(workspace, tmp_path / "street.mp4")))
    assert movie.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)


def test_webp_where_there_is_no_encoder(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Closed:
        fourcc = staticmethod(cv2.VideoWriter.fourcc)

        def __init__(self, *arguments: object) -> None: ...

        def isOpened(self) -> bool:
            return False

        def release(self) -> None: ...

    monkeypatch.setattr(video.cv2, "VideoWriter", Closed)
    path = write_video(finished, tmp_path / "street.mp4", height=32)
    assert path == tmp_path / "street.webp"
    movie = Image.open(path)
    assert movie.n_frames == 5
    assert movie.size == (2 * 48 + video.GAP_PX, 32)
    assert [p.name for p in tmp_path.iterdir()] == ["street.webp"]


def test_a_cancelled_movie_leaves_nothing(finished: Path, tmp_path: Path) -> None:
    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    for name in ("a.mp4", "a.webp"):
        with pytest.raises(Cancelled):
            write_video(finished, tmp_path / name, progress=stop)
    assert not list(tmp_path.iterdir())


def test_movies_that_cannot_be(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(WorkspaceError, match="format"):
        write_video(finished, tmp_path / "street.avi")
    with pytest.raises(WorkspaceError, match="Not made yet: delivered frames"):
        write_video(finished, tmp_path / "street.mp4", camera_name="rear")


def test_summary_says_what_metrics_say(finished: Path) -> None:
    out = io.StringIO()
    print_summary(finished, out)
    text = out.getvalue()
    methods = json.loads((finished / "metrics.json").read_text())["truth"]["regions"]["removed"]["methods"]
    for name, method in (("Unveil", "ours"), ("Telea", "telea"), ("shift-map", "shift_map")):
        line = next(line for line in text.splitlines() if line.strip().startswith(f"{name} "))
        assert f"{methods[method]['psnr']:.1f} dB / {methods[method]['ssim']:.3f}" in line
        row = [line for line in text.splitlines() if line.strip().startswith(f"{name} ")][1]
        figures = ("gradient", "line_recall", "false_lines", "residue")
        assert row.split(name, 1)[1].split("  ")[-1].strip() == detail("residue", methods[method]["residue"])
        assert all(detail(figure, methods[method][figure]) in row for figure in figures)
    assert f"spectrum inside, ratio to the truth: {methods['ours']['spectrum_4px']:.2f} (2 to 4 px), " in text
    assert "Unveil, in cast shadows" in text
    assert str(finished / "frames") in text
    assert "meshes" not in text
    stages = json.loads((finished / "workspace.json").read_text())["stages"]
    for name, stage in stages.items():
        line = next(line for line in text.splitlines() if line.split()[:1] == [name])
        assert seconds(stage["seconds"]) in line
        assert memory(stage["peak_memory_mb"]) in line
    assert "change outside the masks: none" in text
    assert max(len(line) for line in text.splitlines() if str(finished) not in line) <= 100


def test_summary_has_a_line_for_free_viewpoints(finished: Path, tmp_path: Path) -> None:
    metrics = json.loads((finished / "metrics.json").read_text())
    metrics["free_views"] = {"views": 4, "regions": {"free_removed": {"psnr": 18.24, "ssim": 0.611}}}
    (tmp_path / "metrics.json").write_text(json.dumps(metrics))
    out = io.StringIO()
    print_summary(tmp_path, out)
    line = next(line for line in out.getvalue().splitlines() if "beside and above the path" in line)
    assert line.endswith("-") and "18.2 dB / 0.611" in line
    assert len(line) <= 100


def test_summary_of_nothing(tmp_path: Path) -> None:
    out = io.StringIO()
    print_summary(tmp_path, out)
    assert out.getvalue() == "\n\n"


def test_movers_have_a_line_and_a_card_where_there_are_any(finished: Path, tmp_path: Path) -> None:
    for count, told in (
        (0, ""),
        (1, "1 dynamic object, removed from every frame"),
        (3, "3 dynamic objects, removed from every frame"),
    ):
        state = {"format": 1, "generator": "unveil", "stages": {"segment": {"movers": count}}}
        (tmp_path / "workspace.json").write_text(json.dumps(state))
        out = io.StringIO()
        print_summary(tmp_path, out)
        assert out.getvalue().strip() == told
    assert movers({}) == (0, "")
    shown = replace(gather(finished, None, no_progress), state={"stages": {"segment": {"movers": 3}}})
    assert "dynamic objects, removed from every frame" in build_page(shown)
    assert "dynamic objects" not in build_page(replace(shown, state={}))


def test_wording() -> None:
    assert [seconds(s) for s in (0.034, 0.999, 8.24, 9.99, 59.4, 59.9, 185.0, 4321.0)] == [
        "0.03 s",
        "1.0 s",
        "8.2 s",
        "10 s",
        "59 s",
        "1 min 00 s",
        "3 min 05 s",
        "1 h 12 min",
    ]
    assert [memory(m) for m in (640.4, 2355.0)] == ["640 MB", "2.3 GB"]
    assert [percent(p) for p in (0.0, 0.034, 0.5, 1.0)] == ["0 %", "3.4 %", "50 %", "100 %"]
    assert (decibels(None), decibels(31.44), similarity(None), similarity(0.91)) == ("exact", "31.4 dB", "–", "0.910")


def test_a_movie_for_which_there_was_no_room_is_none(finished: Path, tmp_path: Path) -> None:
    """OpenCV writes what fits, and says nothing."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no right to mount a small disk")
    try:
        with pytest.raises(OSError, match="No space left on device"):
            write_video(finished, disk / "street.mp4")
        assert not list(disk.iterdir())
    finally:
        subprocess.run(["umount", str(disk)], check=True)

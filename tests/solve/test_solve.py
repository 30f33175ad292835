"""The sample clip, solved as a whole: in a process that knows no torch, continued, and read back."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.solve.films import COUNT, SIZE, frames, truth, write_clip, write_frames, write_labels
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.output.stamps import is_unchanged
from unveil_core.drives import open_drive
from unveil_core.drives.scale_and_up import place_drive
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.solve import planned, solve

needs_colmap = pytest.mark.skipif(find_spec("pycolmap") is None, reason="pycolmap is not installed")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive of 16 frames, by the command, as a user has it."""
    if find_spec("pycolmap") is None:
        pytest.skip("pycolmap is not installed")
    root = tmp_path_factory.mktemp("solve")
    write_frames(root / "frames", list(frames()))
    write_labels(root / "labels")
    focal, height, _ = truth()
    words = [
        "solve",
        "frames",
        "-o",
        "drive",
        "--labels",
        "labels",
        "--camera-height",
        str(height),
        "--focal",
        str(focal),
        "--json",
    ]
    code = f"import sys; from unveil_core.app.cli import main; code = main({words!r}); "
    code += "assert 'torch' not in sys.modules; sys.exit(code)"
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert {"decode", "look", "features", "match", "map", "rest", "points"} <= {e.get("stage") for e in events}
    assert events[-1]["solve"]["placed"] == COUNT
    return root / "drive"


def test_the_cameras_are_where_they_were(solved: Path) -> None:
    drive = open_drive(solved)
    focal, _, poses = truth()
    assert [f.name for f in drive.frames] == [f"{k:04d}" for k in range(COUNT)]
    here, there = np.stack([f.camera.centre for f in drive.frames]), poses[:, :3, 3]
    way = float(np.linalg.norm(np.diff(there, axis=0), axis=1).sum())
    own = float(np.linalg.norm(np.diff(here, axis=0), axis=1).sum())
    assert own == pytest.approx(way, rel=0.06)  # in metres, by the height of the camera
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    off = b - s.sum() / (a**2).sum() * a @ turn.T
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.01 * way
    assert drive.frames[0].camera.fx == pytest.approx(focal)


def test_an_import_needs_no_more(solved: Path) -> None:
    drive = open_drive(solved)
    placement = place_drive(drive)
    assert placement.scale_is_known and placement.up_is_known and placement.up_name == "z"
    assert all(f.semantic_path is not None and f.camera_name == "camera" for f in drive.frames)
    assert len(drive.points.positions) > 2000 and drive.points.colors is not None
    ground = drive.points.positions[:, 2]
    assert drive.frames[0].camera.centre[2] - np.percentile(ground, 5) == pytest.approx(truth()[1], abs=0.35)


def test_the_colmap_model_has_the_same_cameras(solved: Path) -> None:
    drive, model = open_drive(solved), open_drive(solved / "sparse/0", DriveOptions())
    assert len(model.frames) == COUNT and len(model.points.positions) > 100
    for a, b in zip(drive.frames, model.frames, strict=True):
        assert a.name == b.name
        assert np.allclose(a.camera.world_to_camera, b.camera.world_to_camera, atol=1e-6)
        assert a.camera.intrinsics == pytest.approx(b.camera.intrinsics)


def test_the_page_needs_nothing_but_itself(solved: Path) -> None:
    page = (solved / "solve.html").read_text()
    assert f"{COUNT} of {COUNT} frames have a camera" in page and "The way from above" in page
    assert "http://" not in page and "https://" not in page and "<script" not in page


def test_a_plan_tells_what_a_rerun_would_do(solved: Path) -> None:
    footage = [solved.parent / "frames"]
    focal, height, _ = truth()
    same = SolveSettings(labels=solved.parent / "labels", camera_height=height, focal=str(focal))
    plan = planned(footage, solved, same)
    assert not plan.would_run and plan.lines() == ["solve        up to date"] and plan.frames == COUNT
    other = planned(footage, solved, replace(same, every=2))
    assert other.why == "the footage or its settings have changed"
    assert (other.frames, other.width, other.height) == (COUNT // 2, *SIZE)
    assert 0 < other.seconds < plan.seconds < planned(footage, solved, replace(same, thorough=True)).seconds
    new = planned(footage, solved.parent / "nowhere", same)
    assert new.why == "it has not run" and not (solved.parent / "nowhere").exists()
    with pytest.raises(DriveError, match="no frames in that part"):
        planned(footage, solved, replace(same, frames="200:"))


def test_a_rerun_does_only_what_is_missing(solved: Path) -> None:
    root, told = solved.parent, []
    same = {"labels": root / "labels", "focal": str(truth()[0])}

    def reporter(event: dict[str, object]) -> None:
        told.append((event["stage"], event["message"]))

    before = (solved / "images/0003.png").stat().st_mtime_ns
    facts = solve([root / "frames"], solved, SolveSettings(**same, known_length=30.0), reporter).facts  # type: ignore[arg-type]
    assert {s for s, m in told if m == "up to date"} == {"decode", "look", "map", "rest", "points"}
    assert ("features", "started") not in told
    assert facts["way_m"] == pytest.approx(30.0, rel=0.02)
    assert (solved / "images/0003.png").stat().st_mtime_ns == before


@needs_colmap
def test_a_night_whose_noise_hides_all_is_said_to_be_dark(tmp_path: Path) -> None:
    """Small pictures average the noise away and look well enough; those that are matched do not."""
    generator = np.random.default_rng(0)
    dark = [np.clip(p * 0.05 + generator.normal(0, 6, p.shape), 0, 255).astype(np.uint8) for p in frames()]
    footage = write_frames(tmp_path / "night", dark)
    with pytest.raises(DriveError, match="night: The footage is too dark .mean grey . of 255.: .*film by day"):
        solve([footage], tmp_path / "drive", SolveSettings())


def test_five_frames_are_one_line(tmp_path: Path) -> None:
    clip = write_clip(tmp_path / "a.mp4", list(frames())[:5])
    with pytest.raises(DriveError, match=r"a\.mp4: Too few frames: 5"):
        solve([clip], tmp_path / "drive", SolveSettings())


@pytest.mark.parametrize("what", ["nothing there", "a text", "an empty folder", "own folder", "somebody's folder"])
def test_what_is_no_footage_or_no_place_is_one_line(what: str, tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("mine")
    (tmp_path / "empty").mkdir()
    source = write_frames(tmp_path / "frames", list(frames())[:2])
    given, output, line, kind = {
        "nothing there": (tmp_path / "b.mp4", tmp_path / "o", r"b\.mp4: Not found", DriveError),
        "a text": (tmp_path / "a.txt", tmp_path / "o", r"a\.txt: Not footage .*as \.mp4", DriveError),
        "an empty folder": (tmp_path / "empty", tmp_path / "o", "the folder has no photographs", DriveError),
        "own folder": (source, source / "drive", "lies in the footage", SettingsError),
        "somebody's folder": (source, tmp_path, "lies in the footage, or around it", SettingsError),
    }[what]
    with pytest.raises(kind, match=line):
        solve([given], output, SolveSettings())
    assert not (tmp_path / "o").exists()


def test_a_folder_that_no_solve_made_is_left_alone(tmp_path: Path) -> None:
    source = write_frames(tmp_path / "frames", list(frames())[:2])
    (tmp_path / "o").mkdir()
    (tmp_path / "o/notes.txt").write_text("mine")
    with pytest.raises(SettingsError, match="Not replaced: no solve wrote it .*--replace"):
        solve([source], tmp_path / "o", SolveSettings())
    assert [p.name for p in (tmp_path / "o").iterdir()] == ["notes.txt"]


def _refused(solved: Path, line: str, settings: SolveSettings, footage: Path | None = None) -> None:
    before = {p: p.read_bytes() for p in solved.rglob("*") if p.is_file() and p.name not in (".lock",)}
    with pytest.raises(SettingsError, match=line):
        solve([footage or solved.parent / "frames"], solved, settings)
    assert {p: p.read_bytes() for p in before} == before


def test_a_drive_of_other_footage_is_not_replaced(solved: Path, tmp_path: Path) -> None:
    other = write_frames(tmp_path / "other", list(frames())[:3])
    for k, path in enumerate(sorted(other.iterdir())):
        path.rename(other / f"take2_{k}.png")
    _refused(solved, "Not replaced: it was solved from other footage, frames .*--replace", SolveSettings(), other)


def test_what_somebody_changed_is_not_replaced(solved: Path, tmp_path: Path) -> None:
    shutil.copytree(solved, tmp_path / "drive")
    shutil.copytree(solved.parent / "frames", tmp_path / "frames")
    drive = tmp_path / "drive"
    (drive / "transforms.json").write_text((drive / "transforms.json").read_text() + " ")
    _refused(drive, r"transforms\.json: Changed since Unveil wrote it", SolveSettings(every=2))
    shutil.copyfile(solved / "transforms.json", drive / "transforms.json")
    (drive / "images/0003.png").write_bytes(b"a plate painted over")
    _refused(drive, r"0003\.png: Changed since Unveil wrote it", SolveSettings(every=2))


def test_a_label_that_was_mended_stays(solved: Path, tmp_path: Path) -> None:
    for name in ("drive", "frames", "labels"):
        shutil.copytree(solved.parent / name, tmp_path / name)
    mended = tmp_path / "drive/semantics/0002.png"
    shutil.copyfile(mended.with_name("0009.png"), mended)
    (tmp_path / "drive/notes.txt").write_text("mine")
    same = SolveSettings(labels=tmp_path / "labels", focal=str(truth()[0]), known_length=20.0)
    facts = solve([tmp_path / "frames"], tmp_path / "drive", same).facts
    assert mended.read_bytes() == mended.with_name("0009.png").read_bytes()
    assert "1 pictures of labels or masks were changed since" in facts["notices"][-2]
    assert (tmp_path / "drive/notes.txt").read_text() == "mine"


def test_a_solve_that_ends_too_early_leaves_the_drive_before_as_it_was(solved: Path, tmp_path: Path) -> None:
    for name in ("drive", "frames"):
        shutil.copytree(solved.parent / name, tmp_path / name)
    listed = json.loads((tmp_path / "drive/.unveil.json").read_text())["files"]
    with pytest.raises(DriveError, match="Too few frames"):
        solve([tmp_path / "frames"], tmp_path / "drive", SolveSettings(frames="0:4"))
    assert json.loads((tmp_path / "drive/.unveil.json").read_text())["files"] == listed
    assert all(is_unchanged(tmp_path / "drive" / name, stamp) for name, stamp in listed.items())
    assert json.loads((tmp_path / "drive/solve.json").read_text())["state"] == "done"


@pytest.mark.parametrize("place", ["street", "street/images/solved", "street/solved", "around", ""])
def test_no_solve_goes_into_a_drive_or_around_one(place: str, tmp_path: Path) -> None:
    source = write_frames(tmp_path / "frames", list(frames())[:3])
    street = Path(make_tiny_drive(tmp_path / "work/street")).parent
    shutil.copytree(street, tmp_path / "work/around/images")
    before = sorted(p for p in tmp_path.rglob("*"))
    with pytest.raises(SettingsError, match="Not for results"):
        solve([source], tmp_path / "work" / place, SolveSettings(replace=True))
    assert sorted(p for p in tmp_path.rglob("*")) == before


def test_names_that_no_list_of_colmap_holds_are_solved(solved: Path, tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    names = [f"DSC {k:02d} (1) #ä.png" for k in range(COUNT)]
    for name, path in zip(names, sorted((solved.parent / "frames").iterdir()), strict=True):
        shutil.copyfile(path, tmp_path / "in" / name)
    facts = solve([tmp_path / "in"], tmp_path / "drive", SolveSettings(focal=str(truth()[0]))).facts
    assert facts["placed"] == COUNT
    assert [f.image_path.name for f in open_drive(tmp_path / "drive").frames] == names


@pytest.mark.skipif(os.name == "nt", reason="rights of POSIX")
def test_who_may_not_read_the_footage_may_not_read_what_shows_it(tmp_path: Path) -> None:
    source = write_frames(tmp_path / "frames", list(frames()))
    for path in source.iterdir():
        path.chmod(0o600)
    pytest.importorskip("pycolmap")
    solve([source], tmp_path / "drive", SolveSettings(focal=str(truth()[0])))
    shown = [p for p in (tmp_path / "drive").rglob("*") if p.suffix in (".png", ".html", ".ply", ".npz")]
    assert len(shown) > COUNT and not [p for p in shown if p.stat().st_mode & 0o077]


def test_nothing_names_the_folder_that_the_footage_came_from(solved: Path) -> None:
    told = str(solved.parent).encode()
    assert [p for p in solved.rglob("*") if p.is_file() and told in p.read_bytes()] == []

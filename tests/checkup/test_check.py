"""`unveil check`: one page and a few lines of a drive, and nothing else left behind."""

from __future__ import annotations

import html
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.tiny_drive import edit, make_tiny_drive
from tests.small_street import make_small_street
from unveil_core.app.cli import main
from unveil_core.base.files import write_image_atomic
from unveil_core.checkup.examined import examine_drive
from unveil_core.checkup.page import check_page
from unveil_core.pipeline.settings import RunSettings


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to be in, and another for what is temporary."""
    place, scratch = tmp_path / "here", tmp_path / "scratch"
    place.mkdir()
    scratch.mkdir()
    monkeypatch.chdir(place)
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    return place


def test_a_page_is_all_that_is_left(tmp_path: Path, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_small_street(tmp_path / "street")
    before = {p: p.stat().st_mtime_ns for p in drive.parent.rglob("*")}
    assert main(["check", str(drive)]) == 0
    assert [p.name for p in here.iterdir()] == ["check_street.html"]
    assert list((tmp_path / "scratch").iterdir()) == []
    assert {p: p.stat().st_mtime_ns for p in drive.parent.rglob("*")} == before
    page = (here / "check_street.html").read_text(encoding="utf-8")
    for title in (
        "What looks wrong",
        "What it is",
        "What is assumed",
        "The way from above",
        "Points in one photograph",
    ):
        assert f"<h2>{title}</h2>" in page
    assert page.count("<img src=") == 4 and "http" not in page.replace("http-equiv", "")
    said = capsys.readouterr().out
    assert "looks wrong            nothing" in said and "check_street.html" in said
    assert "<b>Nothing.</b>" in page
    assert main(["check", str(drive)]) == 0  # its own page is written again


def test_what_looks_wrong_is_on_the_page_and_in_the_exit_code(
    tmp_path: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_tiny_drive(tmp_path / "drive", semantics=False, masks=True)
    assert main(["check", str(drive), "-o", "page.html", "--mask-removes", "white"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == error.count("check ") + 1 and "asks before it begins: masks remove 94 %" in error
    page = (here / "page.html").read_text(encoding="utf-8")
    assert 'class="card asks"' in page and "masks remove 94 % of 4 of 4 frames" in page
    assert main(["check", str(drive), "-o", "page.html", "--mask-removes", "white", "--yes"]) == 0
    assert main(["check", str(drive), "-o", "page.html"]) == 0


def test_json_has_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    edit(drive, lambda d: d.update(cx=31.0))
    assert main(["check", str(drive), "-o", "page.html", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    told = events[-1]["check"]
    assert told["page"] == "page.html" and told["facts"]["frames"] == "4"
    assert [f["asks"] for f in told["findings"]] == [False]
    assert "principal point" in told["findings"][0]["problem"]
    assert all(e["stage"] == "check" for e in events[:-1])


def test_somebody_s_page_and_drive_are_left_alone(
    tmp_path: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    (here / "mine.html").write_text("<html>mine</html>")
    assert main(["check", str(drive), "-o", "mine.html"]) == 2
    assert (here / "mine.html").read_text() == "<html>mine</html>"
    assert main(["check", str(drive), "-o", "mine.html", "--replace"]) == 0
    assert main(["check", str(drive), "-o", str(drive.parent / "page.html")]) == 2
    assert "lies in the drive" in capsys.readouterr().err or not (drive.parent / "page.html").exists()
    assert main(["check", str(here)]) == 2  # no drive


def test_names_of_strangers_are_text(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    edit(drive, lambda d: [f.update(camera="<script>alert(1)</script>") for f in d["frames"]])
    page = check_page(examine_drive(drive))
    assert "<script" not in page.lower()
    assert "script" in html.unescape(page) and "default-src" in page and "script-src" not in page


@pytest.mark.parametrize("name", WRITERS)
def test_each_format_can_be_checked(name: str, tmp_path: Path) -> None:
    path = WRITERS[name](tmp_path / "d", tiny_street())
    found = examine_drive(path, RunSettings(cameras=("all",)))
    facts = dict(found.facts)
    assert facts["frames"] == "4" and len(found.labels) == 3 and not found.asks
    assert found.way.ground.ndim == 3 and np.ptp(found.way.ground) > 0  # points are seen from above
    assert found.points is not None and found.points.points > 0
    assert all(p.removed is not None for p in found.labels)


def test_a_drive_without_labels_says_so(tmp_path: Path) -> None:
    found = examine_drive(make_tiny_drive(tmp_path / "drive", semantics=False))
    assert "no labels, masks or boxes say what can be removed" in found.assumed
    assert all(p.removed is None for p in found.labels)
    assert "Nothing labels this drive" in check_page(found)


def test_the_photograph_of_which_most_can_be_removed_is_shown(tmp_path: Path) -> None:
    folder = tmp_path / "street"
    drive = make_small_street(folder, masks_only=True)
    masks = sorted((folder / "masks").iterdir())
    for path in masks:
        write_image_atomic(path, np.full((80, 128), 255, np.uint8))
    some = np.full((80, 128), 255, np.uint8)
    some[40:60, 40:70] = 0
    write_image_atomic(masks[2], some)
    found = examine_drive(drive)
    removed = {p.frame: p.removed for p in found.labels}
    assert len(removed) == 3 and removed["02"] == pytest.approx(600 / 10240, rel=0.1)


def test_a_height_that_was_assumed_is_none(tmp_path: Path) -> None:
    drive = make_small_street(tmp_path / "street")
    assert dict(examine_drive(drive).facts)["height of the cameras"].startswith("1.6")
    edit(drive, lambda d: d.update(metric=False))
    assert "height of the cameras" not in dict(examine_drive(drive).facts)

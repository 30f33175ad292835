"""What a slip in ``-o``, a folder of another program, or a brush in Blender may cost: nothing. The command as a user starts it.

The matrix of all verbs and all places is ``tests/app/test_slips.py``; here are the ways in which work was once lost, end to end.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from tests.small_street import make_small_street

QUICK = ("--quality", "draft", "--iterations", "50", "--splats", "5000", "--no-adaptation")


def unveil(*arguments: object) -> tuple[int, str]:
    """Exit code and last line that the command says."""
    command = [sys.executable, "-P", "-m", "unveil_core", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL)
    return done.returncode, (done.stderr.strip().splitlines() or [""])[-1]


def digest(root: Path) -> dict[str, str]:
    files = (p for p in sorted(root.rglob("*")) if p.is_file())
    return {str(p.relative_to(root)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a drive ``street`` and its finished workspace ``w``; the camera is called as an export's own file."""
    root = tmp_path_factory.mktemp("output")
    path = make_small_street(root / "street")
    edit(path, lambda d: d.update(frames=[{**f, "camera": "export.json"} for f in d["frames"][:4]]))
    code, said = unveil("run", root / "street", "-o", root / "w", "--until", "mesh", *QUICK)
    assert code == 0, said
    return root


def test_a_check_beside_the_drive_leaves_the_drive(finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished / "street", tmp_path / "project/drive")
    before = digest(tmp_path)
    for source, place in (
        (tmp_path / "project/drive", tmp_path / "project"),
        (tmp_path / "project/drive", tmp_path / "project/drive"),
        (finished / "w", finished / "w"),
    ):
        code, said = unveil("evaluate", source, "--holdout-masks", "-o", place, "--quality", "draft", "--cars", "1")
        assert code == 2 and str(place) in said
    assert digest(tmp_path) == before and (finished / "w/drive/cameras.json").is_file()


def test_views_and_exports_do_not_go_over_a_drive(finished: Path, tmp_path: Path) -> None:
    drive = Path(shutil.copytree(finished / "street", tmp_path / "project/drive"))
    before = digest(tmp_path)
    for arguments in (
        ("render", finished / "w", "-o", drive),
        ("export", finished / "w", "--to", "ply", "-o", drive / "points.ply"),
        ("export", finished / "w", "--to", "png,nerfstudio", "-o", drive),
    ):
        code, said = unveil(*arguments)
        assert code == 2 and "drive" in said
    assert digest(tmp_path) == before


def test_rendering_again_is_no_slip(finished: Path, tmp_path: Path) -> None:
    render = ("render", finished / "w", "--state", "full", "-o", tmp_path / "views")
    assert unveil(*render)[0] == unveil(*render, "--planes", "rgb,alpha")[0] == 0
    (tmp_path / "views/depth").mkdir()
    (tmp_path / "views/depth/00.png").write_text("mine")
    before = digest(tmp_path)
    code, said = unveil(*render, "--planes", "depth")
    assert code == 2 and "depth/00.png" in said and digest(tmp_path) == before


def test_exported_folders_keep_what_people_put_into_them(finished: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "png").mkdir(parents=True)
    (out / "png/export.json").write_text('{"preset": "of another program"}')
    (out / "png/roto.nk").write_text("a month of work")
    assert unveil("export", finished / "w", "--to", "png,chan", "-o", out)[0] == 2
    assert sorted(p.name for p in out.iterdir()) == ["png"]
    assert unveil("export", finished / "w", "--to", "chan", "-o", out)[0] == 0
    (out / "chan/comp_v012.nk").write_text("made after the first export")
    code, said = unveil("export", finished / "w", "--to", "chan", "-o", out)
    assert code == 2 and "comp_v012.nk" in said
    assert (out / "png/roto.nk").read_text() == "a month of work" and (out / "chan/comp_v012.nk").is_file()


def test_a_camera_may_be_called_as_a_file_of_the_export(finished: Path, tmp_path: Path) -> None:
    for _ in range(2):
        code, said = unveil("export", finished / "w", "--to", "png,mattes", "-o", tmp_path)
        assert code == 0, said
    assert len(list((tmp_path / "png/camera_export.json").glob("*.png"))) == 4


def test_a_file_that_no_export_made_is_asked_for(finished: Path, tmp_path: Path) -> None:
    place = tmp_path / "street.ply"
    export = ("export", finished / "w", "-o", place)
    place.write_text("mine")
    code, said = unveil(*export)
    assert code == 2 and "--replace" in said and place.read_text() == "mine"
    assert unveil(*export, "--replace")[0] == unveil(*export)[0] == 0
    place.write_bytes(place.read_bytes() + b"\n")  # as an editor saved it
    assert unveil(*export)[0] == 2
    os.unlink(place)
    (tmp_path / "mine").write_text("mine")
    place.symlink_to(tmp_path / "mine")
    assert unveil(*export)[0] == 2 and place.is_symlink() and (tmp_path / "mine").read_text() == "mine"


def test_folders_of_other_programs_are_no_workspaces(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "drive")
    files = {
        "workspace.json": '{"version": 2, "projects": {"app": "apps/app"}}',
        "drive/notes.txt": "mine",
        "objects/model.obj": "mine",
        ".film.mkv.partial": "a download",
    }
    for name, content in files.items():
        (tmp_path / "repo" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "repo" / name).write_text(content)
    (tmp_path / "locked").mkdir()
    (tmp_path / "locked/.lock").write_text("held by another program")
    before = digest(tmp_path)
    for place in ("repo", "locked"):
        for verb in ("import", "run"):
            code, said = unveil(verb, drive, "-o", tmp_path / place)
            assert code == 2 and "another program's" in said
    assert digest(tmp_path) == before


def test_another_drive_does_not_replace_results(finished: Path, tmp_path: Path) -> None:
    workspace = Path(shutil.copytree(finished / "w", tmp_path / "w"))
    other = make_tiny_drive(tmp_path / "drive")
    before = digest(workspace)
    code, said = unveil("import", other, "-o", workspace)
    assert code == 2 and "another drive" in said and digest(workspace) == before
    for own in ("drive", "drive/images"):
        code, said = unveil("run", workspace / "drive", "-o", workspace / own)
        assert code == 2 and digest(workspace) == before
    assert unveil("run", workspace / "drive", "-o", workspace)[0] == 2 and digest(workspace) == before
    assert unveil("import", other, "-o", workspace, "--replace")[0] == 0


def test_what_people_keep_in_a_workspace_outlives_its_stages(finished: Path, tmp_path: Path) -> None:
    workspace = Path(shutil.copytree(finished / "w", tmp_path / "w"))
    mine = (
        "frames/roto.nk",
        "drive/notes.txt",
        "clean/export.json/comp.blend",
        "objects/model.obj",
        ".film.mkv.partial",
    )
    for name in mine:
        (workspace / name).write_text("mine")
    code, said = unveil("import", finished / "street", "-o", workspace, "--work-side", "64")
    assert code == 0, said
    for stage in ("segment", "choose"):
        assert unveil(stage, workspace)[0] == 0
    assert [n for n in mine if not (workspace / n).is_file() or (workspace / n).read_text() != "mine"] == []


def test_painting_reaches_neither_a_photograph_nor_another_frame(finished: Path) -> None:
    known: dict[tuple[int, int], Path] = {}
    files = [p for folder in ("street", "w") for p in (finished / folder).rglob("*") if p.is_file()]
    for path in files:
        stat = path.stat()
        assert known.setdefault((stat.st_dev, stat.st_ino), path) == path
    assert sum(p.parts[-3] in ("clean", "frames") for p in files) == 8


def test_a_batch_of_other_drives_stays(tmp_path: Path) -> None:
    monday, tuesday = (make_tiny_drive(tmp_path / day / "street").parent for day in ("monday", "tuesday"))
    (tmp_path / "b").mkdir()
    (tmp_path / "b/batch.json").write_text('{"mine": 1}')
    assert unveil("batch", "plan", monday, "-o", tmp_path / "b")[0] == 2
    assert json.loads((tmp_path / "b/batch.json").read_text()) == {"mine": 1}
    assert unveil("batch", "plan", monday, "-o", tmp_path / "plan")[0] == 0
    before = digest(tmp_path)
    code, said = unveil("batch", "plan", tuesday, "-o", tmp_path / "plan")
    assert code == 2 and "other drives" in said and digest(tmp_path) == before
    assert unveil("batch", "plan", monday, "-o", monday.parent)[0] == 2 and digest(tmp_path) == before

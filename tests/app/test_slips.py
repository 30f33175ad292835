"""A slip of the hand in ``-o`` costs nothing: each verb that writes, in each place where it must not, is refused in one line, and
nothing that was there changes."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main

FILES = {
    "workspace.json": '{"version": 2, "projects": {"app": "apps/app"}}',
    "batch.json": '{"mine": 1}',
    "batch.slurm.sh": "#!/bin/sh",
    "transforms.png": "mine",
    "export.json": '{"preset": "of another program"}',
    ".unveil.json": '{"generator": "another", "files": ["rgb/00.png"]}',
    ".lock": "held by another program",
    ".film.mkv.partial": "a download",
    "drive/notes.txt": "mine",
    "objects/model.obj": "mine",
    "frames/roto.nk": "mine",
    "rgb/00.png": "mine",
    "png/export.json": '{"preset": "of another program"}',
    "png/roto.nk": "a month of work",
    "chan/front.chan": "mine",
    "empty.ply": "mine",
    "street.ply": "mine",
    "empty_splats.ply": "mine",
    "bench.json": '{"machine": "another"}',
    "bench.png": "mine",
    "check.html": "<meta name='generator' content='unveil 0'> with notes of mine",
    "solve.json": '{"mine": 1}',
    "images/000000.png": "mine",
    "mattes/object/front/00.png": "mine",
    "marked.json": "[]",
    "holdout/drive/notes.txt": "mine",
    "holdout/cars/front/00.png": "mine",
    "drives/drive/notes.txt": "mine",
    "tasks/drive.all.json": "mine",
}
"""A folder of somebody's work in which everything is called as this program calls its own."""

VERBS: dict[str, list[str]] = {
    "run": ["run", "DRIVE"],
    "import": ["import", "DRIVE"],
    "render": ["render", "WORKSPACE", "--planes", "rgb,alpha"],
    "export plates": ["export", "WORKSPACE", "--to", "png"],
    "export cameras": ["export", "WORKSPACE", "--to", "chan"],
    "export splats": ["export", "WORKSPACE", "--to", "splat-ply,png"],
    "evaluate": ["evaluate", "DRIVE", "--holdout-masks"],
    "solve": ["solve", "FOOTAGE"],
    "solve anew": ["solve", "FOOTAGE", "--replace"],
    "mask": ["mask", "DRIVE", "--click", "00:5,5"],
    "batch plan": ["batch", "plan", "DRIVE"],
}
"""Verbs that write folders."""
FILE_VERBS: dict[str, tuple[list[str], str]] = {
    "export a mesh": (["export", "WORKSPACE", "--to", "ply"], "street.ply"),
    "export splats": (["export", "WORKSPACE", "--to", "splat-ply"], "empty_splats.ply"),
    "bench step": (["bench", "step", "--quick"], "bench.json"),
    "bench raster": (["bench", "raster", "--quick"], "bench.json"),
    "check": (["check", "DRIVE"], "check.html"),
}
"""Verbs that write a file."""
PLACES = (
    "drive",
    "in the drive",
    "holds one",
    "look-alike",
    "other workspace",
    "in a workspace",
    "file",
    "link",
    "root",
    "home",
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a drive and another one, and a workspace of each."""
    root = tmp_path_factory.mktemp("slips")
    make_tiny_drive(root / "project/drive")
    make_tiny_drive(root / "elsewhere/drive", offset=(5.0, 0.0, 0.0))
    assert main(["import", str(root / "project/drive"), "-o", str(root / "ours")]) == 0
    assert main(["import", str(root / "elsewhere/drive"), "-o", str(root / "others")]) == 0
    for name, content in FILES.items():
        path = root / "work" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    shutil.copytree(root / "project/drive/images", root / "footage")
    (root / "home").mkdir()
    (root / "home/letter.txt").write_text("dear")
    (root / "file").write_text("mine")
    (root / "link").symlink_to(root / "work", target_is_directory=True)
    return root


def digest(root: Path) -> dict[str, str]:
    """What lies in a folder, by name: contents of files, targets of links."""
    found = {}
    for path in sorted(root.rglob("*")):
        name = str(path.relative_to(root))
        if path.is_symlink():
            found[name] = os.readlink(path)
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = "folder"
    return found


def place_of(name: str, root: Path) -> Path:
    return {
        "drive": root / "project/drive",
        "in the drive": root / "project/drive/images/out",
        "holds one": root / "project",
        "look-alike": root / "work",
        "other workspace": root / "others",
        "in a workspace": root / "others/drive/images",
        "file": root / "file",
        "link": root / "link",
        "root": Path("/"),
        "home": root / "home",
    }[name]


def refused(arguments: list[str], output: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The line with which a command is refused that changes nothing."""
    whole = {"DRIVE": str(root / "project/drive"), "WORKSPACE": str(root / "ours"), "FOOTAGE": str(root / "footage")}
    before, top = digest(root), sorted(os.listdir("/"))
    code = main([*(whole.get(a, a) for a in arguments), "-o", str(output)])
    said = capsys.readouterr().err
    assert digest(root) == before and sorted(os.listdir("/")) == top
    assert code == 2 and said.count("\n") == 1 and said.startswith("unveil: error: "), said
    return said


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("verb", VERBS)
def test_a_folder_that_is_not_for_results_stays_as_it_is(
    verb: str, place: str, made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(made / "home"))
    monkeypatch.setenv("USERPROFILE", str(made / "home"))
    if (verb, place) == ("export splats", "look-alike"):
        assert "empty_splats.ply" in refused(VERBS[verb], made / "work", made, capsys)
        return
    said = refused(VERBS[verb], place_of(place, made), made, capsys)
    named = {"drive": "a drive", "in the drive": "it lies in the drive", "holds one": "it holds the drive"}
    assert named.get(place, "") in said
    assert {"root": "the root of a disk", "home": "the home folder"}.get(place, "") in said


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("verb", FILE_VERBS)
def test_a_file_of_somebody_stays_as_it_is(
    verb: str, place: str, made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder that holds a drive it is a file of its own; everywhere else there is one, or must not be one."""
    monkeypatch.setenv("HOME", str(made / "home"))
    arguments, name = FILE_VERBS[verb]
    if verb == "check" and place in ("home", "other workspace"):
        return  # a page of its own there
    if place in ("root", "home", "other workspace", "file"):
        refused(arguments, place_of(place, made), made, capsys)
        return
    refused(arguments, place_of("look-alike" if place == "holds one" else place, made) / name, made, capsys)


@pytest.mark.parametrize("name", ["link.ply", "bench.json"])
def test_a_link_is_neither_followed_nor_replaced(
    name: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / name).symlink_to(tmp_path / "mine")
    arguments = ["export", "WORKSPACE"] if name.endswith("ply") else ["bench", "step", "--quick"]
    refused(arguments, tmp_path / name, made, capsys)
    assert (tmp_path / name).is_symlink() and (tmp_path / "mine").read_text() == "mine"
    (tmp_path / "gone").symlink_to(tmp_path / "nothing")
    for verb in VERBS.values():
        refused(verb, tmp_path / "gone", made, capsys)
    assert not (tmp_path / "nothing").exists()


def test_another_programs_lock_and_workspace_stay(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for content in ("12345", "held", '{"pid": 7}'):
        place = tmp_path / f"locked{len(content)}"
        place.mkdir()
        (place / ".lock").write_text(content)
        assert ".lock: Another program's file" in refused(["run", "DRIVE"], place, made, capsys)
        assert (place / ".lock").read_text() == content
    for content in ('{"format": 1, "stages": {"build": {}}}', '{"format": 1, "generator": "x", "stages": {}}', "{}"):
        (tmp_path / "w").mkdir(exist_ok=True)
        (tmp_path / "w/workspace.json").write_text(content)
        assert "workspace.json: Another program's file" in refused(["import", "DRIVE"], tmp_path / "w", made, capsys)
        for verb in (["choose"], ["status"], ["export", "--to", "chan", "-o", str(tmp_path / "x")]):
            assert main([verb[0], str(tmp_path / "w"), *verb[1:]]) == 2
            assert "Another program's file" in capsys.readouterr().err
        assert [p.name for p in (tmp_path / "w").iterdir()] == ["workspace.json"]


def test_a_template_is_not_written_over_somebodys_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, batch = make_tiny_drive(tmp_path / "drive").parent, tmp_path / "batch"
    assert main(["batch", "plan", str(drive), "-o", str(batch)]) == 0
    script = batch / "batch.slurm.sh"
    script.write_text("mine")
    template = ["batch", "template", str(batch), "--to", "slurm"]
    assert (
        main(template) == 2
        and "batch.slurm.sh: Not replaced: Unveil did not write it, or it was changed since" in capsys.readouterr().err
    )
    assert script.read_text() == "mine"
    script.unlink()
    assert main(template) == main(template) == 0 and "sbatch" in script.read_text()
    script.write_text("mine")
    assert main([*template, "--replace"]) == 0 and "sbatch" in script.read_text()


def test_a_batch_of_other_drives_stays_unless_it_is_to_be_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from unveil_core.farm.manifest import read_batch

    monday, tuesday = (str(make_tiny_drive(tmp_path / day / "street").parent) for day in ("monday", "tuesday"))
    plan = ["batch", "plan", "-o", str(tmp_path / "b")]
    assert main([*plan, monday]) == main([*plan, monday]) == 0
    (first,) = read_batch(tmp_path / "b").drives
    assert main(["import", monday, "-o", first.workspace]) == 0
    before = digest(tmp_path)
    capsys.readouterr()
    assert main([*plan, tuesday]) == 2
    assert "Holds the plan of other drives, as " in capsys.readouterr().err and digest(tmp_path) == before
    assert main([*plan, tuesday, monday]) == 0  # more drives are no others
    assert [Path(d.workspace).name for d in read_batch(tmp_path / "b").drives] == ["street_2", "street"]
    assert main([*plan, tuesday, "--replace"]) == 0
    (second,) = read_batch(tmp_path / "b").drives
    assert second.workspace != first.workspace and (Path(first.workspace) / "drive/cameras.json").is_file()


def test_what_was_rendered_or_measured_may_be_again(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = ["bench", "step", "--size", "32x24", "--surfels", "50", "--quick", "-o", str(tmp_path / "step.json")]
    assert main(bench) == main(bench) == 0
    shutil.copytree(made / "ours", tmp_path / "w")
    export = ["export", str(tmp_path / "w"), "--to", "chan", "-o", str(tmp_path / "out")]
    assert main(export) == main(export) == 0
    (tmp_path / "out/chan/comp_v012.nk").write_text("made after the first export")
    capsys.readouterr()
    assert main(export) == 2 and "chan/comp_v012.nk: Not written by Unveil" in capsys.readouterr().err
    assert (tmp_path / "out/chan/comp_v012.nk").is_file() and (tmp_path / "out/chan/export.json").is_file()

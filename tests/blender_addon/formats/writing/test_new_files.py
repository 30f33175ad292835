"""Files that are written into a folder together: what is somebody's stays, and what was begun leaves nothing half."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from blender_addon.formats.writing.new_files import RECORD, Somebodys, new_files

NAMES = ("a.txt", "b.txt", "images/*.png")


def write(folder: Path, /, *, replace: bool = False, whole: bool = True, **texts: str) -> None:
    with new_files(folder, NAMES, mend="move it", replace=replace, whole=whole) as files:
        for name, text in texts.items():
            files.path(name.replace("_", ".").replace("images.", "images/", 1)).write_text(text)


def content(folder: Path) -> dict[str, str]:
    """All that lies in a folder, by name, but the record."""
    files = (p for p in sorted(folder.rglob("*")) if not p.is_dir() and p.name != RECORD)
    return {p.relative_to(folder).as_posix(): p.read_text() for p in files}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two files and a picture, written."""
    write(tmp_path / "f", a_txt="1", b_txt="2", images_0001_png="3")
    return tmp_path / "f"


def test_what_was_written_is_replaced_and_what_is_not_written_again_goes(folder: Path) -> None:
    assert content(folder) == {"a.txt": "1", "b.txt": "2", "images/0001.png": "3"}
    write(folder, a_txt="4")
    assert content(folder) == {"a.txt": "4"} and not (folder / "images").exists()


def test_the_record_is_laid_out_as_the_command_has_it(folder: Path) -> None:
    record = json.loads((folder / RECORD).read_text())
    assert set(record) == {"generator", "files"}
    assert set(record["files"]) == {"a.txt", "b.txt", "images/0001.png"}
    assert all(len(digest) == 32 for digest in record["files"].values())


@pytest.mark.parametrize("name", ["a.txt", "images/0001.png"])
def test_what_was_changed_since_stays(folder: Path, name: str) -> None:
    found = os.stat(folder / name)
    (folder / name).write_text("m")
    os.utime(folder / name, ns=(found.st_atime_ns, found.st_mtime_ns))  # as large, and as old
    before = content(folder)
    with pytest.raises(Somebodys, match=rf"{name}: Changed since Unveil wrote it, and so not replaced \(move it\)"):
        write(folder, a_txt="4", images_0001_png="5")
    assert content(folder) == before
    write(folder, replace=True, a_txt="4", images_0001_png="5")
    assert content(folder) == {"a.txt": "4", "images/0001.png": "5"}


@pytest.mark.parametrize("name", ["a.txt", "notes.txt", "images/0001.png", "images/notes.txt", "labels/0001.png"])
def test_what_is_somebodys_stays(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    with pytest.raises(Somebodys, match=r"Not written by Unveil"):
        write(tmp_path, a_txt="1")
    assert content(tmp_path) == {name: "mine"} and not (tmp_path / RECORD).exists()
    write(tmp_path, replace=True, a_txt="1", images_0002_png="2")
    others = {} if name == "a.txt" else {name: "mine"}
    assert content(tmp_path) == {"a.txt": "1", "images/0002.png": "2", **others}


def test_what_was_changed_stays_though_others_are_to_be_replaced(folder: Path) -> None:
    (folder / "b.txt").write_text("mine")
    write(folder, replace=True, a_txt="4")
    assert content(folder) == {"a.txt": "4", "b.txt": "mine"}


@pytest.mark.parametrize("name", ["a.txt", "images", "images/0001.png", "elsewhere"])
@pytest.mark.parametrize("replace", [False, True])
def test_nothing_is_written_through_a_link(tmp_path: Path, name: str, replace: bool) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/0001.png").write_text("mine")
    link = tmp_path / "f" / name
    link.parent.mkdir(parents=True)
    link.symlink_to(tmp_path / "mine" if "." not in name else tmp_path / "mine/0001.png")
    with pytest.raises(OSError, match="is a link"):
        write(tmp_path / "f", replace=replace, a_txt="1", images_0001_png="2")
    assert link.is_symlink() and (tmp_path / "mine/0001.png").read_text() == "mine"


def test_a_link_that_comes_meanwhile_is_not_followed(folder: Path, tmp_path: Path) -> None:
    before = content(folder)
    (tmp_path / "mine").mkdir()
    with pytest.raises(OSError, match="is a link"), new_files(folder, NAMES, mend="move it") as files:
        files.path("images/0001.png").write_text("new")
        (folder / "images").rename(tmp_path / "aside")
        (folder / "images").symlink_to(tmp_path / "mine")
    assert not list((tmp_path / "mine").iterdir()) and (folder / "a.txt").read_text() == before["a.txt"]


def test_what_comes_in_the_way_meanwhile_stays(folder: Path) -> None:
    with pytest.raises(Somebodys, match=r"a\.txt: Changed since"), new_files(folder, NAMES, mend="move it") as files:
        files.path("a.txt").write_text("new")
        (folder / "a.txt").write_text("mine")
    assert content(folder) == {"a.txt": "mine", "b.txt": "2", "images/0001.png": "3"}


def test_a_folder_of_a_files_name_stays(folder: Path) -> None:
    (folder / "a.txt").unlink()
    (folder / "a.txt").mkdir()
    with pytest.raises(Somebodys, match=r"a\.txt: Changed since"):
        write(folder, replace=True, a_txt="new")
    assert content(folder) == {"b.txt": "2", "images/0001.png": "3"}


def test_an_error_leaves_what_was_there(folder: Path, tmp_path: Path) -> None:
    before, record = content(folder), json.loads((folder / RECORD).read_text())
    for place in (folder, tmp_path / "new"):
        with pytest.raises(ZeroDivisionError), new_files(place, NAMES, mend="move it") as files:
            files.path("a.txt").write_text("new")
            raise ZeroDivisionError
    assert content(folder) == before and json.loads((folder / RECORD).read_text()) == record
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("renamed", [0, 1, 2])
def test_one_that_is_ended_halfway_leaves_nothing_that_is_somebodys(
    folder: Path, renamed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by a power cut while files get their names: nothing is taken back."""
    import blender_addon.formats.writing.new_files as module

    done = []

    def cut(source: Path, target: Path) -> None:
        if len(done) == renamed:
            raise KeyboardInterrupt
        done.append(source.replace(target))

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(module, "move", cut)
        patched.setattr(module.NewFiles, "clear", lambda self: None)
        write(folder, a_txt="4", b_txt="5", images_0001_png="6")
    assert list(folder.glob(".unveil-*.partial"))
    write(folder, a_txt="6")
    assert content(folder) == {"a.txt": "6"} and not list(folder.glob(".unveil-*.partial"))


def test_two_at_once_do_not_mix(folder: Path) -> None:
    with pytest.raises(Somebodys, match="Another Blender writes here"), new_files(folder, NAMES, mend="") as files:
        files.path("a.txt").write_text("first")
        write(folder, a_txt="second")
    assert content(folder) == {"a.txt": "second"}
    write(folder, a_txt="third")


def test_what_systems_leave_is_nobodys(folder: Path) -> None:
    (folder / "images/.DS_Store").write_text("")
    write(folder, a_txt="4")
    assert content(folder) == {"a.txt": "4", "images/.DS_Store": ""}


def test_files_are_added_beside_what_is_there(folder: Path) -> None:
    (folder / "b.txt").write_text("mine")
    write(folder, whole=False, a_txt="4")
    assert content(folder) == {"a.txt": "4", "b.txt": "mine", "images/0001.png": "3"}
    with pytest.raises(Somebodys, match=r"b\.txt: Changed since"):
        write(folder, whole=False, b_txt="5")


@pytest.mark.parametrize(
    "record", ["[" * 100_000, "[]", '{"generator": "other"}', '{"generator": "unveil 0.1.0", "files": ["a.txt"]}']
)
def test_a_record_that_is_none_lists_nothing(folder: Path, record: str) -> None:
    (folder / RECORD).write_text(record)
    with pytest.raises(Somebodys, match=r"a\.txt: Not written by Unveil"):
        write(folder, a_txt="4")


def test_a_record_removes_nothing_elsewhere(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.partial").mkdir()
    record = json.loads((folder / RECORD).read_text())
    record["files"]["../mine.txt"], record["partial"] = "0" * 32, "../mine.partial"
    (folder / RECORD).write_text(json.dumps(record))
    (tmp_path / "mine.txt").write_text("mine")
    write(folder, a_txt="4")
    assert (tmp_path / "mine.txt").is_file() and (tmp_path / "mine.partial").is_dir()

"""The add-on's files: written whole or not at all, also where another program holds them."""

from __future__ import annotations

import errno
import os
import tracemalloc
from pathlib import Path

import pytest

from blender_addon.formats.files import copied, file_stamp, files_stamp, make_own, write_changed, write_whole
from blender_addon.formats.open_safely import LARGEST_TEXT, json_in, read_bytes, refuse_links


class Holder:
    """Another program that holds a file for so many attempts to rename it."""

    def __init__(self, times: int, winerror: int | None = 32) -> None:
        self.times, self.winerror, self.real = times, winerror, os.replace

    def __call__(self, source: object, target: object) -> None:
        if self.times:
            self.times -= 1
            error = PermissionError(errno.EACCES, "held")
            if self.winerror is not None:
                error.winerror = self.winerror  # type: ignore[attr-defined]
            raise error
        self.real(source, target)  # type: ignore[arg-type]


def test_a_rename_waits_for_who_holds_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "replace", Holder(3))
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"new"
    monkeypatch.setattr(os, "replace", Holder(2, 5))
    copied(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "b").read_bytes() == b"new" and len(list(tmp_path.iterdir())) == 2


def test_it_does_not_wait_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a").write_text("old")
    for winerror in (32, None):
        monkeypatch.setattr(os, "replace", holder := Holder(1000, winerror))
        with pytest.raises(PermissionError):
            write_whole(tmp_path / "a", b"new")
        tries = 1000 - holder.times
        assert 1 < tries < 1000 if winerror else tries == 1
        assert [p.name for p in tmp_path.iterdir()] == ["a"] and (tmp_path / "a").read_text() == "old"


def test_a_name_may_be_as_long_as_the_system_allows(tmp_path: Path) -> None:
    write_whole(tmp_path / ("x" * 251 + ".obj"), b"content")
    assert [p.name for p in tmp_path.iterdir()] == ["x" * 251 + ".obj"]


def test_a_stamp_is_another_when_a_file_is_written_anew(tmp_path: Path) -> None:
    paths = [tmp_path / "a", tmp_path / "b"]
    assert file_stamp(paths[0]) == ""
    found = {files_stamp(paths)}
    for path, content in zip([*paths, paths[0]], ("1", "2", "22"), strict=True):
        path.write_text(content)
        assert file_stamp(path).startswith(f"{len(content)} ")
        found.add(files_stamp(paths))
    os.utime(paths[0], ns=(0, 5))
    assert len(found | {files_stamp(paths)}) == 5 and file_stamp(paths[0]) == "2 5"
    assert files_stamp(paths) == files_stamp(iter(paths))


needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")


@needs_pipes
def test_only_regular_files_are_read_and_none_without_an_end(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("content")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(1 << 40)
    assert read_bytes(tmp_path / "a", 7) == b"content"
    for name, says in (("link", "a link"), ("zero", "a link"), ("pipe", "pipe or a device"), ("large", "larger than")):
        with pytest.raises(OSError, match=says):
            read_bytes(tmp_path / name, LARGEST_TEXT)
    with pytest.raises(OSError, match="larger than 6 bytes"):
        read_bytes(tmp_path / "a", 6)
    assert file_stamp(tmp_path / "pipe") == "" != file_stamp(tmp_path / "a")


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"[" + b"[]," * (1 << 21) + b"[]]", "it holds 4,"), (b"[" * 200_000, "within one another"), (b"\xff", "utf-8")],
)
def test_json_without_measure_takes_no_memory(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(content)
    tracemalloc.start()
    with pytest.raises(ValueError, match=says):
        json_in(tmp_path / "a.json")
    assert tracemalloc.get_traced_memory()[1] < 3 * len(content) + 1_000_000
    tracemalloc.stop()
    (tmp_path / "a.json").write_text('{"a": [1, 2.5]}')
    assert json_in(tmp_path / "a.json") == {"a": [1, 2.5]}


@needs_pipes
@pytest.mark.parametrize("make", ["link", "link to a folder", "pipe"])
def test_a_workspace_with_a_link_or_a_pipe_is_refused(make: str, tmp_path: Path) -> None:
    (tmp_path / "w/frames").mkdir(parents=True)
    (tmp_path / "w/frames/a.png").write_text("")
    refuse_links(tmp_path / "w")
    path = tmp_path / "w/frames/b.png"
    if make == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(tmp_path if make == "link to a folder" else tmp_path / "w/frames/a.png")
    with pytest.raises(ValueError, match=r"b\.png: (is a link|Not a file but a pipe)"):
        refuse_links(tmp_path / "w")


def test_two_blenders_that_write_one_file_do_not_meet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str] = []
    real = os.replace
    monkeypatch.setattr(os, "replace", lambda source, target: (names.append(Path(source).name), real(source, target)))
    for content in (b"1", b"2", b"2"):
        write_changed(tmp_path / "marked.json", content)
    assert len(set(names)) == len(names) == 2 and (tmp_path / "marked.json").read_bytes() == b"2"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights")
def test_a_copy_of_a_private_picture_is_private_and_has_one_name(tmp_path: Path) -> None:
    (tmp_path / "frame").write_text("clean")
    (tmp_path / "frame").chmod(0o600)
    write_whole(tmp_path / "copy", b"clean", like=tmp_path / "frame")
    assert (tmp_path / "copy").stat().st_mode & 0o777 == 0o600
    os.link(tmp_path / "copy", tmp_path / "elsewhere")
    make_own(tmp_path / "copy")
    assert (tmp_path / "copy").stat().st_nlink == 1 and (tmp_path / "copy").read_bytes() == b"clean"
    assert (tmp_path / "copy").stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights")
def test_a_copy_of_a_private_photograph_is_private(tmp_path: Path) -> None:
    photograph = tmp_path / "photograph.png"
    photograph.write_bytes(b"own")
    photograph.chmod(0o600)
    copied(photograph, tmp_path / "shown.png")
    assert (tmp_path / "shown.png").read_bytes() == b"own" and (tmp_path / "shown.png").stat().st_mode & 0o077 == 0

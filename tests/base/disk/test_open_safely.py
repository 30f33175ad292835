"""What is opened is a regular file of a bounded size; nothing else is waited for, followed or written in place."""

from __future__ import annotations

import os
import socket
import threading
from pathlib import Path

import pytest

from unveil_core.base.disk.open_safely import RefusedFileError, check_file, open_file, open_in_place, read_bytes

needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
APPEND = os.O_WRONLY | os.O_APPEND | os.O_CREAT


def test_a_file_is_read_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"a\r\n\0b" * 1000)
    assert read_bytes(path) == path.read_bytes()
    assert read_bytes(path, 5000) == path.read_bytes()
    with open_file(path) as stream:
        assert stream.read(3) == b"a\r\n" and os.get_blocking(stream.fileno())
    path.write_bytes(b"")
    assert read_bytes(path) == b""
    with pytest.raises(FileNotFoundError):
        read_bytes(tmp_path / "none")
    with pytest.raises(IsADirectoryError):
        read_bytes(tmp_path)


def test_what_is_larger_than_any_such_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with path.open("wb") as stream:
        stream.truncate(1 << 40)  # takes no room on the disk, and would take all memory
    with pytest.raises(RefusedFileError, match="larger than 1,073,741,824 bytes"):
        read_bytes(path)
    with pytest.raises(RefusedFileError, match="larger than 9 bytes"):
        open_file(path, 9)


@needs_pipes
@pytest.mark.parametrize("follow", [True, False])
def test_nobody_waits_for_a_pipe(tmp_path: Path, follow: bool) -> None:
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    said: list[str] = []

    def attempt() -> None:
        for path in (pipe, link):
            for act in (lambda p: open_file(p, links=follow), lambda p: open_in_place(p, APPEND), check_file):
                try:
                    act(path)
                except RefusedFileError as error:
                    said.append(str(error.strerror))

    thread = threading.Thread(target=attempt, daemon=True)
    thread.start()
    thread.join(10)
    assert not thread.is_alive()
    assert len(said) == 6 and all("a pipe or a device" in line or "a symbolic link" in line for line in said)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such device")
def test_devices_are_refused_behind_a_link_too(tmp_path: Path) -> None:
    (tmp_path / "zero").symlink_to("/dev/zero")
    for path in (Path("/dev/zero"), tmp_path / "zero"):
        with pytest.raises(RefusedFileError, match="a pipe or a device"):
            read_bytes(path)


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no sockets in folders")
def test_a_socket_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # its path may have a hundred letters
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("s")
        with pytest.raises(RefusedFileError, match="a pipe or a device"):
            read_bytes("s")


def test_a_link_is_followed_where_it_may_be(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("photograph")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert read_bytes(tmp_path / "link") == b"photograph"
    with pytest.raises(RefusedFileError, match="symbolic link"):
        read_bytes(tmp_path / "link", links=False)


def test_a_file_of_the_system_that_says_it_is_empty_is_read_up_to_the_limit() -> None:
    path = Path("/proc/self/maps")
    if not path.exists():
        pytest.skip("no such files")
    assert path.stat().st_size == 0 and len(read_bytes(path)) > 100
    with pytest.raises(RefusedFileError, match="larger than 50 bytes"):
        read_bytes(path, 50)


def test_nothing_is_written_to_a_file_by_another_name(tmp_path: Path) -> None:
    (tmp_path / "letter").write_text("dear")
    os.link(tmp_path / "letter", tmp_path / "hard")
    (tmp_path / "soft").symlink_to(tmp_path / "letter")
    (tmp_path / "dangling").symlink_to(tmp_path / "new")
    for name, says in (("hard", "hard link"), ("soft", "symbolic link"), ("dangling", "symbolic link")):
        with pytest.raises(RefusedFileError, match=says):
            open_in_place(tmp_path / name, APPEND)
    assert (tmp_path / "letter").read_text() == "dear" and not (tmp_path / "new").exists()
    handle = open_in_place(tmp_path / "own", APPEND)
    os.write(handle, b"mine")
    os.close(handle)
    assert (tmp_path / "own").read_bytes() == b"mine"
    with pytest.raises(FileNotFoundError):
        open_in_place(tmp_path / "none", os.O_RDWR)

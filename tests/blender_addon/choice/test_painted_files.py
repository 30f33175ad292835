"""Which copies of clean frames somebody has painted."""

from __future__ import annotations

from pathlib import Path

from blender_addon.choice.painted_files import is_painted, leave, put_aside


def copies(folder: Path, painted: bytes, before: bytes) -> None:
    (folder / "03.png").write_bytes(painted)
    (folder / "03_before.png").write_bytes(before)


def test_a_copy_is_painted_where_it_differs(tmp_path: Path) -> None:
    assert not is_painted(tmp_path, "03")
    copies(tmp_path, b"as delivered", b"as delivered")
    assert not is_painted(tmp_path, "03")
    copies(tmp_path, b"green", b"as delivered")
    assert is_painted(tmp_path, "03")
    (tmp_path / "03_before.png").unlink()  # nobody knows over what it was painted: it is kept, but not taken for a fix
    assert not is_painted(tmp_path, "03")
    put_aside(tmp_path, "03")
    assert (tmp_path / "03_forgotten.png").read_bytes() == b"green"


def test_what_is_forgotten_is_kept_aside_and_not_taken_again(tmp_path: Path) -> None:
    copies(tmp_path, b"green", b"as delivered")
    leave(tmp_path, "03")
    assert not is_painted(tmp_path, "03") and (tmp_path / "03.png").read_bytes() == b"green"
    put_aside(tmp_path, "03")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {
        "03_forgotten.png": b"green",
        "03_before.png": b"as delivered",
    }
    copies(tmp_path, b"red", b"as delivered")
    assert is_painted(tmp_path, "03")


def test_what_nobody_painted_is_not_kept(tmp_path: Path) -> None:
    copies(tmp_path, b"as delivered", b"as delivered")
    put_aside(tmp_path, "03")
    assert (tmp_path / "03.png").exists() and not (tmp_path / "03_forgotten.png").exists()


def test_what_was_put_aside_before_stays(tmp_path: Path) -> None:
    for number, painted in enumerate((b"green", b"red"), 1):
        copies(tmp_path, painted, b"as delivered")
        put_aside(tmp_path, "03")
        assert len(list(tmp_path.glob("03_forgotten*.png"))) == number

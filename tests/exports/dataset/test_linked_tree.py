"""A copy of a folder by links."""

from __future__ import annotations

from pathlib import Path

from unveil_core.exports.dataset.linked_tree import linked_tree


def test_files_are_linked_some_are_put_anew_and_what_lies_elsewhere_is_left_out(tmp_path: Path) -> None:
    source, elsewhere, target = tmp_path / "source", tmp_path / "elsewhere", tmp_path / "target"
    for name in ("a/one.txt", "a/two.txt", "b/c/three.txt"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(name)
    for name in ("disk", "other"):
        (elsewhere / name).mkdir(parents=True)
        (elsewhere / name / "four.txt").write_text("four")
        (source / name).symlink_to(elsewhere / name, target_is_directory=True)
    (source / "gone.txt").symlink_to(tmp_path / "nothing")

    def anew(path: Path) -> None:
        path.write_text("anew")

    (elsewhere / "disk/five.txt").write_text("five")
    (source / "a/key.txt").symlink_to(elsewhere / "disk/five.txt")
    (source / "a/also.txt").symlink_to("one.txt")
    (source / "also").symlink_to(source / "b", target_is_directory=True)
    left_out = linked_tree(source, target, {"a/two.txt": anew, "disk/four.txt": anew})
    assert sorted(left_out) == ["a/key.txt", "disk/five.txt", "other"]
    assert (target / "a/one.txt").samefile(source / "a/one.txt")
    assert (target / "b/c/three.txt").stat().st_nlink == 2
    assert (target / "a/also.txt").samefile(source / "a/one.txt")
    assert (target / "also/c/three.txt").samefile(target / "b/c/three.txt") and not (
        target / "also"
    ).readlink().is_absolute()
    assert (target / "a/two.txt").read_text() == (target / "disk/four.txt").read_text() == "anew"
    assert (source / "a/two.txt").read_text() == "a/two.txt" and (elsewhere / "disk/four.txt").read_text() == "four"
    assert not (target / "disk").is_symlink()
    assert {p.name for p in target.rglob("*") if not p.is_dir()} == {
        "one.txt",
        "two.txt",
        "three.txt",
        "four.txt",
        "also.txt",
    }
    assert not (target / "gone.txt").exists() and not (target / "other").is_symlink()

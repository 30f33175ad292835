"""Pictures numbered as Blender wants them, and regions in colour."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from blender_addon.formats import sequences
from blender_addon.formats.files import copied, write_whole
from blender_addon.formats.sequences import REGION_COLORS, in_color, numbered, with_palette


@pytest.mark.parametrize("start", ["", "front.", "car_0005."])
def test_numbered_files_are_taken_as_they_are(tmp_path: Path, start: str) -> None:
    files = [tmp_path / f"{start}{i:04d}.png" for i in range(7, 12)]
    for f in files:
        f.write_bytes(b"x")
    found = numbered(files, tmp_path, "links")
    assert list(found.files) == files and found.first == 7 and not (tmp_path / "links").exists()


@pytest.mark.parametrize(
    "names", [("3", "5"), ("9", "10"), ("a", "b"), ("1533.1", "1533.2"), ("a.1", "b.2"), ("1", "2.jpg")]
)
def test_other_files_get_numbered_links(names: tuple[str, ...], tmp_path: Path) -> None:
    files = [tmp_path / (n if "." in n[-4:-3] else f"{n}.png") for n in names]
    for f in files:
        f.write_text(f.name)
    found = numbered(files, tmp_path, "links")
    assert found.first == 0 and [f.stem for f in found.files] == ["000000", "000001"]
    assert [f.read_text() for f in found.files] == [f.name for f in files]
    files[0].unlink()
    files[0].write_text("new")  # as a stage replaces its results
    (tmp_path / "links/000007.png").write_text("left over")
    (tmp_path / "links/holiday.jpg").write_text("somebody's")
    (tmp_path / "links/000007.jpg.bak").write_text("somebody's")
    again = numbered(files, tmp_path, "links")
    assert again.files[0].read_text() == "new"
    # What was not made here stays.
    left = {p.name for p in (tmp_path / "links").iterdir()} - {f.name for f in again.files}
    assert left == {"holiday.jpg", "000007.jpg.bak"}


@pytest.mark.parametrize("link", ["blender", "blender/original", "blender/original/front"])
def test_nothing_is_written_or_removed_through_a_link(link: str, tmp_path: Path) -> None:
    """A stranger's workspace whose folders lead to somebody's renderings."""
    workspace, elsewhere = tmp_path / "w", tmp_path / "elsewhere"
    mine = elsewhere / Path("blender/original/front").relative_to(link)
    mine.mkdir(parents=True)
    (mine / "000007.png").write_text("mine")
    (workspace / link).parent.mkdir(parents=True)
    (workspace / link).symlink_to(elsewhere)
    (tmp_path / "a.png").write_text("a frame")
    with pytest.raises(OSError, match="is a link") as caught:
        numbered([tmp_path / "a.png"], workspace, "blender", "original", "front")
    assert caught.value.filename == str(workspace / link)
    assert {p.name: p.read_text() for p in elsewhere.rglob("*") if p.is_file()} == {"000007.png": "mine"}


def test_a_link_in_the_place_of_an_unfinished_file_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    for name in (".marked.json.partial", ".copy.png.partial"):
        (tmp_path / name).symlink_to(tmp_path / "mine.txt")
    write_whole(tmp_path / "marked.json", b"[]")
    copied(tmp_path / "marked.json", tmp_path / "copy.png")
    assert (tmp_path / "mine.txt").read_text() == "mine"
    assert (tmp_path / "copy.png").read_bytes() == (tmp_path / "marked.json").read_bytes() == b"[]"


@pytest.mark.parametrize("name", ["front_1533.25", "000004"])
def test_who_paints_on_what_is_shown_writes_in_no_other_file(name: str, tmp_path: Path) -> None:
    """Neither by a copy with another name, nor where a workspace of before has a hard link to the photograph."""
    original, imported = tmp_path / "original.png", tmp_path / f"w/drive/images/{name}.png"
    imported.parent.mkdir(parents=True)
    original.write_bytes(b"photograph")
    os.link(original, imported)
    (shown,) = numbered([imported], tmp_path / "w", "blender", "original", "front").files
    shown.write_bytes(b"painted on")
    assert original.read_bytes() == imported.read_bytes() == b"photograph"
    stays = numbered([imported], tmp_path / "w", "blender", "original", "front").files
    assert stays == (shown,) and shown.read_bytes() == b"photograph"
    assert shown.with_name("000000_painted.png").read_bytes() == b"painted on"
    shown.unlink()
    os.link(imported, shown)  # as versions before made it
    numbered([imported], tmp_path / "w", "blender", "original", "front")
    assert shown.stat().st_nlink == 1 and shown.read_bytes() == b"photograph"


def test_regions_get_colours_and_keep_their_pixels(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).integers(0, 4, (30, 41), dtype=np.uint8)
    png = cv2.imencode(".png", numbers)[1].tobytes()
    shown = cv2.imdecode(np.frombuffer(with_palette(png, REGION_COLORS), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.array_equal(shown, np.array(REGION_COLORS, np.uint8)[numbers])
    for bad in (b"", b"GIF89a", cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()):
        with pytest.raises(ValueError, match="Not a grey 8-bit PNG"):
            with_palette(bad, REGION_COLORS)


def test_regions_in_colour_are_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And anew when the regions were, also by older ones that were put back."""
    regions, shown = tmp_path / "00.png", tmp_path / "shown.png"
    cv2.imwrite(str(regions), np.array([[0, 1], [2, 3]], np.uint8))
    in_color(regions, shown)
    assert np.array_equal(cv2.imread(str(shown))[..., ::-1].reshape(4, 3), REGION_COLORS)
    read: list[Path] = []
    whole = sequences.read_bytes
    monkeypatch.setattr(sequences, "read_bytes", lambda path, most: (read.append(path), whole(path, most))[1])
    in_color(regions, shown)
    assert read == []
    cv2.imwrite(str(regions), np.full((2, 2), 3, np.uint8))
    os.utime(regions, ns=(0, 1_000_000_000))
    in_color(regions, shown)
    assert read == [regions] and (cv2.imread(str(shown))[..., ::-1] == REGION_COLORS[3]).all()
    regions.write_bytes(b"no picture")
    with pytest.raises(ValueError, match="00.png: Not a grey 8-bit PNG"):
        in_color(regions, shown)


@pytest.mark.skipif(os.name == "nt", reason="no rights of POSIX")
def test_regions_of_private_photographs_are_private(tmp_path: Path) -> None:
    regions, shown = tmp_path / "00.png", tmp_path / "shown.png"
    cv2.imwrite(str(regions), np.zeros((2, 2), np.uint8))
    regions.chmod(0o600)
    in_color(regions, shown)
    assert shown.stat().st_mode & 0o077 == 0

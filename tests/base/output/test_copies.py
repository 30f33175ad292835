"""Copies share nothing with what they are copies of, unless the user chose hard links."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from unveil_core.base.output.copies import LINK_VARIABLE, copied, copied_or_linked, copied_png
from unveil_core.base.pictures.metadata import Metadata


def test_who_writes_in_a_copy_leaves_the_original(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(LINK_VARIABLE, raising=False)
    (tmp_path / "original").write_bytes(os.urandom(3_000_000))
    os.symlink(tmp_path / "original", tmp_path / "link")
    before = (tmp_path / "original").read_bytes()
    for k, source in enumerate(("original", "link")):
        copy = tmp_path / f"deep/{k}"
        copied_or_linked(tmp_path / source, copy)
        assert copy.read_bytes() == before and not copy.is_symlink() and copy.stat().st_nlink == 1
        with copy.open("rb+") as stream:
            stream.write(b"painted")
    assert (tmp_path / "original").read_bytes() == before
    assert sorted(p.name for p in (tmp_path / "deep").iterdir()) == ["0", "1"]


def test_hard_links_are_made_where_they_are_chosen_and_can_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LINK_VARIABLE, "1")
    (tmp_path / "original").write_bytes(b"photograph")
    copied_or_linked(tmp_path / "original", tmp_path / "linked")
    copied(tmp_path / "original", tmp_path / "copy")
    assert (tmp_path / "linked").samefile(tmp_path / "original")
    assert not (tmp_path / "copy").samefile(tmp_path / "original")

    def refuse(*_: object) -> None:
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", refuse)
    copied_or_linked(tmp_path / "original", tmp_path / "b")
    assert (tmp_path / "b").read_bytes() == b"photograph" and (tmp_path / "b").stat().st_nlink == 1


def test_a_copy_has_what_another_picture_has_beside_its_pixels(tmp_path: Path) -> None:
    done, content = cv2.imencode(".png", np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    assert done
    original = tmp_path / "original.png"
    original.write_bytes(content.tobytes())
    original.chmod(0o600)
    metadata = Metadata(chunks=((b"gAMA", bytes(3) + b"\1"),))
    copied_png(original, tmp_path / "noted.png", metadata)
    copied_png(original, tmp_path / "plain.png", Metadata())
    assert (tmp_path / "noted.png").read_bytes() == metadata.in_png(original.read_bytes()) != original.read_bytes()
    assert (tmp_path / "plain.png").read_bytes() == original.read_bytes()
    assert {(tmp_path / f"{n}.png").stat().st_mode & 0o777 for n in ("noted", "plain")} == {0o600}

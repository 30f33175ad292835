"""Copies share nothing with what they are copies of, unless the user chose hard links."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from unveil_core.base.output.copies import LINK_VARIABLE, copied, copied_or_linked


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

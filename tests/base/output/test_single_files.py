"""A file that the program made may be made again, wherever it lies, as long as nobody changed it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.base.output.single_files import MOST_OF_USER, Receipts, of_user, receipts_at, whole_file


def write(place: Path, text: str, receipts: Receipts) -> None:
    with whole_file(place, receipts) as made:
        made.write_text(text)


def test_what_was_made_is_replaced_until_somebody_changes_it(tmp_path: Path) -> None:
    held, page = tmp_path / "w/.exports.json", tmp_path / "out/page.html"
    (tmp_path / "w").mkdir()
    write(page, "1", receipts_at(held))
    write(page, "2", receipts_at(held))
    page.write_text("2, with notes")
    with pytest.raises(
        SettingsError, match=r"page\.html: Not replaced: Unveil did not write it, or it was changed since"
    ):
        write(page, "3", receipts_at(held))
    assert page.read_text() == "2, with notes" and list(page.parent.iterdir()) == [page]
    write(page, "3", receipts_at(held, replace=True))
    os.utime(page, (1, 1))
    write(page, "4", receipts_at(held))
    assert page.read_text() == "4" and str(tmp_path) not in held.read_text()


def test_links_and_folders_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "mine")
    (tmp_path / "folder").mkdir()
    for name in ("link", "mine", "folder"):
        with pytest.raises(SettingsError):
            write(tmp_path / name, "1", receipts_at(tmp_path / "receipts"))
    assert (tmp_path / "mine").read_text() == "mine"


def test_a_users_receipts_do_not_grow_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    receipts = of_user()
    receipts.known.update({str(k): [0, 0, ""] for k in range(MOST_OF_USER + 5)})
    (tmp_path / "a").write_text("a")
    receipts.note(tmp_path / "a", tmp_path / "b")
    assert len(of_user().known) == MOST_OF_USER and list(of_user().known)[-1] == list(receipts.known)[-1]

"""New files have the rights that the user's umask leaves, and those made from a file no more than that."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from unveil_core.base.disk.new_files import mode_like, new_file, new_folder
from unveil_core.base.disk.rights import keep_rights, rights_of

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights")

PROGRAM = """
import os, sys
from pathlib import Path
import numpy as np
from unveil_core.base.files import write_bytes_atomic, write_image_atomic
from unveil_core.base.output.copies import copied
from unveil_core.base.disk.new_files import new_folder
from unveil_core.base.disk.rights import keep_rights, rights_of
from unveil_core.base.output.single_files import receipts_at, whole_file
from unveil_core.exports.whole import whole_folder
from unveil_core.workspace.workspace import Workspace
root = Path(sys.argv[1])
os.umask(int(sys.argv[2], 8))
write_bytes_atomic(root / "made/text", b"")
write_image_atomic(root / "made/picture.png", np.zeros((2, 2), np.uint8), like=root / "own")
copied(root / "own", root / "made/copy")
with whole_file(root / "made/scene.ply", receipts_at(root / "receipts")) as path: path.write_bytes(b"")
with whole_folder(root / "made/folder") as path: (path / "a").write_bytes(b"")
new_folder(root / "made", "f", "")
space = Workspace.create(root / "made/w")
space.log("import", "hello")
"""


def rights(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize(("umask", "own"), [("077", 0o644), ("022", 0o600), ("027", 0o640), ("002", 0o664)])
def test_who_may_read(umask: str, own: int, tmp_path: Path) -> None:
    (tmp_path / "own").write_text("photograph")
    (tmp_path / "own").chmod(own)
    subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path), umask], check=True)
    left = ~int(umask, 8)
    made = list((tmp_path / "made").rglob("*"))
    assert len(made) == 12
    for path in made:
        like_own = path.name in ("picture.png", "copy")
        wanted = 0o777 if path.is_dir() else own if like_own else 0o666
        assert rights(path) == wanted & left, path


def test_names_are_new_and_never_lead_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "letter").write_text("dear")
    (tmp_path / "a00z").symlink_to(tmp_path / "letter")
    (tmp_path / "a01z").symlink_to(tmp_path / "not there")
    names = iter(["00", "01", "02"])
    monkeypatch.setattr("secrets.token_hex", lambda _: next(names))
    handle, path = new_file(tmp_path, "a", "z")
    os.write(handle, b"mine")
    os.close(handle)
    assert path.name == "a02z" and path.read_text() == "mine" and (tmp_path / "letter").read_text() == "dear"
    assert not (tmp_path / "not there").exists()


def test_no_name_that_is_free_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("secrets.token_hex", lambda _: "0")
    os.close(new_file(tmp_path, "a", "")[0])
    with pytest.raises(FileExistsError):
        new_file(tmp_path, "a", "")
    with pytest.raises(FileExistsError):
        new_folder(tmp_path, "a", "")


def test_the_owner_may_always_replace_what_was_made(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("")
    (tmp_path / "a").chmod(0o4444)
    assert mode_like(tmp_path / "a") == 0o644 and mode_like(tmp_path / "none") == mode_like(None) == 0o666


def test_results_have_the_rights_that_all_their_sources_have(tmp_path: Path) -> None:
    (tmp_path / "images/a").mkdir(parents=True)
    for name, mode in (("0", 0o644), ("1", 0o640)):
        (tmp_path / f"images/a/{name}.png").write_text("")
        (tmp_path / f"images/a/{name}.png").chmod(mode)
    (tmp_path / "made/deep").mkdir(parents=True)
    for name in ("deep/a", "own"):
        (tmp_path / "made" / name).write_text("")
        (tmp_path / "made" / name).chmod(0o644)
    os.link(tmp_path / "made/own", tmp_path / "elsewhere")
    assert rights_of([tmp_path / "images", tmp_path / "none"]) == 0o640
    keep_rights([tmp_path / "made", tmp_path / "made/deep/a"], 0o640)
    assert rights(tmp_path / "made/deep/a") == 0o640 and rights(tmp_path / "made/deep") == 0o755
    assert rights(tmp_path / "elsewhere") == 0o644  # who has another name for it did not ask for this
    (tmp_path / "made/deep/a").chmod(0o600)
    keep_rights([tmp_path / "made"], 0o666)
    assert rights(tmp_path / "made/deep/a") == 0o600

"""A folder that one command after another writes: what is somebody's stays, and a kill leaves all old files or all new ones."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from unveil_core.base.errors import InUseError, SettingsError, WorkspaceError
from unveil_core.base.output import own_folder
from unveil_core.base.output.own_folder import EXCHANGE, NEW, OwnFolder
from unveil_core.base.output.written import GENERATOR, RECORD


def put(folder: Path, **files: str) -> None:
    for name, text in files.items():
        place = folder / name.replace("__", "/")
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)


def write(root: Path, *, replace: bool = False, drop: tuple[str, ...] = (), **files: str) -> None:
    with OwnFolder(root, replace=replace) as own:
        own.begin_anew()
        put(own.new, **files)
        own.exchange(drop=drop)


def files_of(root: Path) -> dict[str, str]:
    hidden = {".lock", RECORD}
    return {
        p.relative_to(root).as_posix(): p.read_text() for p in root.rglob("*") if p.is_file() and p.name not in hidden
    }


def test_new_files_take_the_places_of_old_ones_and_of_nothing_else(tmp_path: Path) -> None:
    root = tmp_path / "deep/masks"
    write(root, a="1", b__c="1", b__d="1")
    put(root, notes="mine", b__e="mine")
    write(root, a="2", b__c="2", drop=("b/d",))
    assert files_of(root) == {"a": "2", "b/c": "2", "b/e": "mine", "notes": "mine"}
    assert set(json.loads((root / RECORD).read_text())["files"]) == {"a", "b/c"}


@pytest.mark.parametrize("name", ["notes", "b"])
def test_what_somebody_put_there_is_refused_and_named(name: str, tmp_path: Path) -> None:
    write(tmp_path, a="1")
    put(tmp_path, notes="mine", b="mine")
    with pytest.raises(SettingsError, match=rf"{name}: (Not written by Unveil|A file, and a folder)"):
        write(tmp_path, a="2", **{"notes" if name == "notes" else "b__c": "2"})
    assert files_of(tmp_path) == {"a": "1", "notes": "mine", "b": "mine", f"{NEW}/a": "2"} | (
        {f"{NEW}/notes": "2"} if name == "notes" else {f"{NEW}/b/c": "2"}
    )


def test_what_somebody_changed_is_refused_and_replaced_by_request_alone(tmp_path: Path) -> None:
    write(tmp_path, a="1", b="1")
    put(tmp_path, a="mine")
    with OwnFolder(tmp_path) as own:
        assert own.changed() == ["a"]
        own.check(["b", "c"])
    with pytest.raises(SettingsError, match="a: Changed since Unveil wrote it"):
        write(tmp_path, a="2", b="2")
    write(tmp_path, a="2", b="2", replace=True)
    put(tmp_path, b="mine")
    write(tmp_path, a="3", drop=("b",))
    assert files_of(tmp_path) == {"a": "3", "b": "mine"}


@pytest.mark.parametrize("moves", range(4))
def test_an_exchange_that_is_killed_is_finished_by_the_next_command(
    moves: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, a="1", b="1", c="1", old="1")
    left = iter(range(moves))

    class Killed(BaseException):
        pass

    def move(source: Path, target: Path) -> None:
        if next(left, None) is None:
            raise Killed
        os.replace(source, target)

    def tidied(*_: object, **__: object) -> None:
        raise Killed

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(own_folder, "move", move)
        patched.setattr(own_folder.shutil, "rmtree", tidied)
        with OwnFolder(tmp_path) as own:
            put(own.new, a="2", b="2", c="2")
            own.exchange(drop=["old"])
    with OwnFolder(tmp_path):
        pass
    assert files_of(tmp_path) == {"a": "2", "b": "2", "c": "2"}
    assert sorted(p.name for p in tmp_path.iterdir()) == [".lock", RECORD, "a", "b", "c"]


def test_two_commands_do_not_write_at_once(tmp_path: Path) -> None:
    with OwnFolder(tmp_path):
        code = "import sys; from pathlib import Path; from unveil_core.base.output.own_folder import OwnFolder; "
        code += "OwnFolder(Path(sys.argv[1])).__enter__()"
        other = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
        assert InUseError.__name__ in other.stderr


@pytest.mark.parametrize("name", ["b", "solve/c", NEW, ".lock", RECORD, EXCHANGE])
def test_a_strangers_folder_leads_nowhere(name: str, tmp_path: Path) -> None:
    root, home = tmp_path / "masks", tmp_path / "home"
    write(root, a="1")
    put(home, secret="mine")
    place = root / name
    place.parent.mkdir(exist_ok=True)
    place.unlink(missing_ok=True)
    place.symlink_to(home / "secret")
    with pytest.raises(WorkspaceError, match="A symbolic link"):
        write(root, a="2", b="2", solve__c="2")
    assert files_of(home) == {"secret": "mine"}


@pytest.mark.parametrize(
    "entry",
    [
        "",
        "[]",
        json.dumps({"files": {"a": None}, "dropped": []}),
        json.dumps({"generator": GENERATOR, "files": {"../a": None}, "dropped": []}),
        json.dumps({"generator": GENERATOR, "files": {}, "dropped": ["/etc/passwd"]}),
        json.dumps({"generator": GENERATOR, "files": 3, "dropped": []}),
    ],
)
def test_a_journal_that_no_exchange_wrote_is_refused(entry: str, tmp_path: Path) -> None:
    (tmp_path / EXCHANGE).write_text(entry)
    with pytest.raises(WorkspaceError, match="Not a journal of this program"), OwnFolder(tmp_path):
        pass


def test_nothing_stays_of_a_folder_that_was_made_for_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), OwnFolder(tmp_path / "deep/masks") as own:
        own.begin_anew()
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="rights of POSIX")
def test_new_files_show_no_more_than_what_they_are_made_of(tmp_path: Path) -> None:
    with OwnFolder(tmp_path) as own:
        put(own.new, a__b="1")
        assert own.new.stat().st_mode & 0o077 == 0
        own.exchange(rights=0o600)
    assert (tmp_path / "a/b").stat().st_mode & 0o777 == 0o600

"""A stranger's drive or workspace with links, pipes and devices in it, and users who share a machine: end to end, by the command.

Each test failed on commit 25e4784. What can be seen without a whole command is under ``tests/``: ``base/disk`` (the one way to
open files), ``workspace/test_links.py``, ``workspace/test_lock.py``; the add-on in ``blender_addon/in_blender/check_strangers.py``.
"""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from tests.blender_addon.run_in_blender import BLENDER, HERE, run_check
from tests.drives.tiny_drive import edit, make_tiny_drive

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes, no rights of POSIX")
PATIENCE_S = 60
"""Of a command that takes one or two; whoever waits for a pipe waits for ever."""
SECRET = b"-----BEGIN OPENSSH PRIVATE KEY-----\n" * 20


def unveil(*arguments: object, umask: int = 0o022, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command; a TimeoutExpired means that it waits."""
    return subprocess.run(
        [sys.executable, "-P", "-m", "unveil_core", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        stdin=subprocess.DEVNULL,
        cwd=cwd,
        umask=umask,
    )


def one_line(done: subprocess.CompletedProcess[str], name: str) -> None:
    """Check that a command refused bad input in a line that names the file."""
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1 and name in done.stderr


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a drive, and a workspace that it was imported into, with clean frames as a run delivers them."""
    folder = tmp_path_factory.mktemp("made")
    make_tiny_drive(folder / "drive")
    assert unveil("import", folder / "drive", "-o", folder / "w").returncode == 0
    shutil.copytree(folder / "w/drive/images", folder / "w/frames")
    return folder


@pytest.fixture
def workspace(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made / "w", tmp_path / "w"))


# ---------------------------------------------------------------------------------------------------------------- hard links


@pytest.mark.parametrize("name", ["events.jsonl", ".lock"])
@pytest.mark.parametrize("verb", ["status", "segment"])
def test_a_hard_link_in_an_archive_leads_to_no_file_of_the_user(
    name: str, verb: str, workspace: Path, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    (home / ".bashrc").write_text("precious\n" * 100)
    (workspace / name).unlink(missing_ok=True)
    with tarfile.open(tmp_path / "street.tar", "w") as archive:
        archive.add(workspace, "w")
        link = tarfile.TarInfo(f"w/{name}")
        link.type, link.linkname = tarfile.LNKTYPE, ".bashrc"
        archive.addfile(link)
    subprocess.run(["tar", "xf", str(tmp_path / "street.tar")], cwd=home, check=True)
    done = unveil(verb, "w", cwd=home)
    assert (home / ".bashrc").read_text() == "precious\n" * 100
    one_line(done, name)


# ------------------------------------------------------------------------------------------------- symbolic links, pipes, devices


VERBS = {
    ".digests.json": "status W",
    "workspace.json": "status W",
    "labels.json": "render W --planes semantics -o OUT",
    "surfels/sky.npz": "render W -o OUT",
    "drive/cameras.json": "render W -o OUT",
    "meshes/empty.ply": "export W --to ply -o OUT",
    "objects.json": "report W",
    "metrics.json": "evaluate W",
    ".journal.json": "choose W",
    "anything/else": "export W --to png -o OUT",
}
"""A command that reads a file of a workspace, by the file."""


@pytest.mark.parametrize(
    ("make", "name"), [("pipe", name) for name in VERBS] + [(m, n) for m in ("zero", "link") for n in list(VERBS)[:3]]
)
def test_no_verb_waits_for_a_file_of_a_workspace_or_follows_it(
    make: str, name: str, workspace: Path, tmp_path: Path
) -> None:
    path, elsewhere = workspace / name, tmp_path / "elsewhere"
    path.parent.mkdir(exist_ok=True)
    if path.exists():
        shutil.copy(path, elsewhere)
        path.unlink()
    else:
        elsewhere.write_bytes(b"{}")
    if make == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero" if make == "zero" else elsewhere)
    before = elsewhere.read_bytes()
    places = {"W": workspace, "OUT": tmp_path / "out"}
    one_line(
        unveil(*(places.get(word, word) for word in VERBS[name].split())), Path(name).name.replace("workspace.json", "")
    )
    assert elsewhere.read_bytes() == before and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("make", "name"),
    [
        ("pipe", "images/01.png"),
        ("pipe", "semantics/01.png"),
        ("pipe", "points.ply"),
        ("pipe", "transforms.json"),
        ("pipe behind a link", "instances/01.png"),
        ("zero", "images/01.png"),
        ("zero", "points.ply"),
        ("sparse", "images/01.png"),
        ("sparse", "transforms.json"),
    ],
)
def test_an_import_waits_for_no_file_of_a_drive(make: str, name: str, made: Path, tmp_path: Path) -> None:
    drive = Path(shutil.copytree(made / "drive", tmp_path / "drive"))
    (drive / name).unlink()
    if make == "sparse":
        with (drive / name).open("wb") as stream:
            stream.truncate(1 << 42)  # four terabytes that take no room
    elif make == "zero":
        (drive / name).symlink_to("/dev/zero")
    else:
        os.mkfifo(tmp_path / "pipe")
        if make == "pipe":
            (tmp_path / "pipe").rename(drive / name)
        else:
            (drive / name).symlink_to(tmp_path / "pipe")
    done = unveil("import", drive, "-o", tmp_path / "w")
    assert done.returncode == 2 and done.stderr.strip().count("\n") == 0, done.stderr
    assert not (tmp_path / "w").exists()


def test_photographs_of_a_drive_may_lie_behind_links(made: Path, tmp_path: Path) -> None:
    drive = Path(shutil.copytree(made / "drive", tmp_path / "drive"))
    (drive / "images").rename(tmp_path / "archive")
    (drive / "images").mkdir()
    for path in (tmp_path / "archive").iterdir():
        (drive / "images" / path.name).symlink_to(path)
    assert unveil("import", drive, "-o", tmp_path / "w").returncode == 0
    imported = list((tmp_path / "w/drive/images").rglob("*.png"))
    assert len(imported) == 4 and not any(path.is_symlink() for path in imported)


@pytest.mark.parametrize("make", ["symbolic", "hard"])
def test_an_export_takes_no_other_file_for_a_clean_frame(make: str, workspace: Path, tmp_path: Path) -> None:
    (tmp_path / "id_rsa").write_bytes(SECRET)
    frame = sorted((workspace / "frames").rglob("*.png"))[1]
    frame.unlink()
    (frame.symlink_to if make == "symbolic" else frame.hardlink_to)(tmp_path / "id_rsa")
    one_line(unveil("export", workspace, "--to", "png", "-o", tmp_path / "plates"), frame.name)
    left = (
        [path for path in (tmp_path / "plates").rglob("*") if path.is_file()] if (tmp_path / "plates").exists() else []
    )
    assert not any(SECRET in path.read_bytes() for path in left)


def test_an_export_does_not_write_through_a_link(workspace: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (workspace / "meshes").symlink_to(tmp_path / "elsewhere")
    one_line(unveil("export", workspace, "--to", "ply"), "meshes")
    assert not any((tmp_path / "elsewhere").iterdir())


def test_a_workspace_may_itself_be_reached_through_a_link(workspace: Path, tmp_path: Path) -> None:
    (tmp_path / "here").symlink_to(workspace)
    assert unveil("status", tmp_path / "here").returncode == 0
    assert unveil("segment", tmp_path / "here").returncode == 0


# ------------------------------------------------------------------------------------------------------------------- the lock

HOLD = "import sys\nfrom unveil_core.workspace.workspace import Workspace\nwith Workspace.open(sys.argv[1]).lock():\n"
HOLD += "    print('held', flush=True)\n    sys.stdin.readline()"


def test_a_lock_whose_file_a_cleaner_removes_still_keeps_others_out(workspace: Path) -> None:
    command = [sys.executable, "-P", "-c", HOLD, str(workspace)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        (workspace / ".lock").unlink()
        one_line(unveil("choose", workspace), "In use by another process")
        holder.communicate("\n")
    assert unveil("choose", workspace).returncode == 0


# ---------------------------------------------------------------------------------------------------------------- who may read


def readable(root: Path) -> list[str]:
    """Files that others than the owner may read, write or run."""
    return [str(p.relative_to(root)) for p in root.rglob("*") if p.is_file() and stat.S_IMODE(p.stat().st_mode) & 0o077]


def test_what_a_careful_user_makes_nobody_else_may_read(made: Path, tmp_path: Path) -> None:
    drive = Path(shutil.copytree(made / "drive", tmp_path / "drive"))
    for path in drive.rglob("*"):
        path.chmod(0o700 if path.is_dir() else 0o600)
    assert unveil("import", drive, "-o", tmp_path / "w", umask=0o077).returncode == 0
    shutil.copytree(tmp_path / "w/drive/images", tmp_path / "w/frames")
    assert unveil("export", tmp_path / "w", "--to", "png", "-o", tmp_path / "out", umask=0o077).returncode == 0
    assert readable(tmp_path / "w") == readable(tmp_path / "out") == []


@pytest.mark.parametrize("lens", [0.0, 0.05])
def test_private_photographs_stay_private(lens: float, made: Path, tmp_path: Path) -> None:
    """Whatever the umask: so do copies, pictures without the lens, and what shows them."""
    drive = Path(shutil.copytree(made / "drive", tmp_path / "drive"))
    edit(drive / "transforms.json", lambda content: content.update(k1=lens))
    for path in drive.rglob("*"):
        path.chmod(0o700 if path.is_dir() else 0o600)
    assert unveil("import", drive, "-o", tmp_path / "w").returncode == 0
    shutil.copytree(tmp_path / "w/drive/images", tmp_path / "w/frames")
    assert unveil("export", tmp_path / "w", "--to", "png,chan", "-o", tmp_path / "out").returncode == 0
    told = {"workspace.json", "events.jsonl", ".lock", ".digests.json"}
    found = {name for name in readable(tmp_path / "w") if not name.startswith(".made/")}  # lists of names
    assert found <= told and readable(tmp_path / "out") == []


# ------------------------------------------------------------------------------------------------------------------ the add-on


@pytest.mark.skipif(not BLENDER.is_file(), reason="there is no bpy: make .venv-bpy-5.0/.installed")
def test_the_add_on_shows_and_paints_on_a_strangers_workspace(tmp_path: Path) -> None:
    done = run_check(str(BLENDER), HERE / "in_blender/check_strangers.py", shared=tmp_path, timeout_s=300)
    assert done.returncode == 0, done.stdout + done.stderr

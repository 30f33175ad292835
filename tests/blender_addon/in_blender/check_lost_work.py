"""What must not cost work, by script: killed workers, a killed Blender, a full disk. Each tells one line, and all goes on."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="kill -9")

LONG = ("--quality", "draft", "--iterations", "100000")
"""Reconstruct comes next, and takes long."""
BLENDER = """
import importlib, sys
import bpy
addon_utils = importlib.import_module("addon_utils")
bpy.context.preferences.use_preferences_save = False
assert addon_utils.enable("bl_ext.user_default.unveil", default_set=True) is not None
main = importlib.import_module("bl_ext.user_default.unveil.work.command_line").main
sys.exit(main(sys.argv[1:]))
"""
"""``blender --background --command unveil ...``, which bpy as a module has not."""


def until(true: Callable[[], object], seconds: float = 60) -> bool:
    deadline = time.monotonic() + seconds
    while not true() and time.monotonic() < deadline:
        time.sleep(0.02)
    return bool(true())


def at_work(root: Path, stage: str) -> bool:
    try:
        return json.loads((root / "workspace.json").read_text())["stages"][stage]["status"] == "running"
    except (OSError, KeyError, ValueError):
        return False


def children(pid: int) -> list[int]:
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True).stdout
    return [int(word) for word in found.split()]


def alive(pid: int) -> bool:
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True).stdout.strip()
    return bool(state) and not state.startswith("Z")


def test_a_killed_worker_is_one_line_and_the_run_goes_on(addon, street, workspace, capfd) -> None:  # type: ignore[no-untyped-def]
    def kill() -> None:
        if until(lambda: at_work(workspace, "reconstruct")):
            for line in subprocess.check_output(
                ["ps", "-o", "pid=,args=", "--ppid", str(os.getpid())], text=True
            ).splitlines():
                if "unveil_core" in line:
                    os.kill(int(line.split()[0]), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    assert addon.module("work.command_line").main(["run", str(street), "-o", str(workspace), *LONG]) == 1
    thread.join()
    said = capfd.readouterr().err.splitlines()
    assert said[-1] == "unveil: failed: the worker was ended by signal 9 (run the same command again to go on)"
    assert addon.module("work.command_line").main(["segment", str(workspace)]) == 0
    # What it had computed is kept for the next attempt, with the digest of its inputs.
    assert [p.parent.name for p in workspace.glob(".partial-*/.inputs")] == [".partial-reconstruct"]


def test_a_killed_blender_takes_its_worker_along_and_the_run_goes_on(addon, street, workspace) -> None:  # type: ignore[no-untyped-def]
    blender = subprocess.Popen([sys.executable, "-c", BLENDER, "run", str(street), "-o", str(workspace), *LONG])
    try:
        assert until(lambda: at_work(workspace, "reconstruct"))
        (worker,) = children(blender.pid)
    finally:
        blender.kill()
        blender.wait()
    assert until(lambda: not alive(worker), 8)
    assert addon.module("work.command_line").main(["segment", str(workspace)]) == 0  # nobody holds the workspace
    done = json.loads((workspace / "workspace.json").read_text())["stages"]
    assert done["import"]["status"] == "done" and done["reconstruct"]["status"] != "done"
    # What it had computed is kept for the next attempt, with the digest of its inputs.
    assert [p.parent.name for p in workspace.glob(".partial-*/.inputs")] == [".partial-reconstruct"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 24 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no right to mount a small disk")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def fill(disk: Path) -> Path:
    filler = disk / "filler"
    with filler.open("wb", buffering=0) as stream, pytest.raises(OSError):
        while True:
            stream.write(bytes(4096))
    return filler


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_full_disk_is_one_line_and_nothing_is_lost(
    addon, scene, street, finished, small_disk, tmp_path, capfd
) -> None:  # type: ignore[no-untyped-def]
    import bpy

    root = Path(shutil.copytree(finished, small_disk / "ws"))
    shutil.rmtree(root / "meshes")
    shutil.rmtree(root / "blender", ignore_errors=True)
    meshes = {k: v for k, v in files(finished / "meshes").items()}
    scene.unveil.quality, scene.unveil.workspace, scene.unveil.drive = "draft", str(root), str(street)
    # A stage that has no room.
    filler = fill(small_disk)
    with pytest.raises(RuntimeError, match="the disk is full .free some space and run"):
        bpy.ops.unveil.stage(stage="mesh")
    assert not (root / "meshes").exists() and not list(root.rglob("*.partial*"))
    # Results: the regions in colour have no room.
    with pytest.raises(RuntimeError, match="the disk is full .free some space"):
        bpy.ops.unveil.load_workspace()
    assert not list((root / "blender").rglob("*.png"))
    filler.unlink()
    assert bpy.ops.unveil.stage(stage="mesh") == {"FINISHED"}
    assert files(root / "meshes") == meshes
    assert "Mesh after" in bpy.data.objects
    # A mark, which the run is to read.
    filler = fill(small_disk)
    bpy.ops.unveil.add_box()
    with pytest.raises(RuntimeError, match="the disk is full .free some space"):
        bpy.ops.unveil.run()
    assert not (root / "marked.json").exists() and not list(root.rglob("*.partial*"))
    addon.module("work.stage_states").stage_states(scene)  # the panel goes on
    # A .blend: the old one stays as it is.
    save = small_disk / "street.blend"
    filler.unlink()
    save.write_bytes(b"the old one")
    filler = fill(small_disk)
    arguments = ["import", scene.unveil.drive, "-o", str(root), "--quality", "draft"]
    capfd.readouterr()
    assert addon.module("work.command_line").main([*arguments, "--save", str(save), "--replace"]) == 1
    said = capfd.readouterr().err.splitlines()
    assert said[-1].startswith("unveil: failed: ") and "disk is full" in said[-1]
    assert save.read_bytes() == b"the old one"
    # The workspace has room elsewhere, the .blend has not.
    assert addon.module("work.command_line")._load_and_save(finished, save) == 1
    said = capfd.readouterr().err.splitlines()
    assert (
        said[-1].startswith(f"unveil: failed: {save}: cannot be saved: ")
        and len([s for s in said if s.startswith("unveil:")]) == 1
    )
    assert save.read_bytes() == b"the old one" and {p.name for p in small_disk.iterdir()} == {
        "ws",
        "filler",
        "street.blend",
    }


def test_another_drive_replaces_no_results_without_a_word(addon, scene, street, workspace, tmp_path) -> None:  # type: ignore[no-untyped-def]
    import bpy

    shutil.copytree(street.parent, tmp_path / "other")
    before = {p: p.stat().st_mtime_ns for p in workspace.rglob("*")}
    given = {"filepath": str(tmp_path / "other/transforms.json"), "workspace": str(workspace)}
    with pytest.raises(RuntimeError, match="has results of another drive, .*street"):
        bpy.ops.unveil.import_drive(**given)
    assert {p: p.stat().st_mtime_ns for p in workspace.rglob("*")} == before
    assert bpy.ops.unveil.import_drive(**given, replace=True) == {"FINISHED"}
    assert json.loads((workspace / "workspace.json").read_text())["drive"] == given["filepath"]


def test_what_is_painted_on_is_no_photograph(addon, scene, street, workspace, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Of no picture that is shown the bytes are those of a file elsewhere, in a workspace of before neither."""
    import bpy

    assert bpy.ops.unveil.load_workspace(directory=str(workspace)) == {"FINISHED"}
    shown = [Path(bpy.path.abspath(i.filepath)) for i in bpy.data.images if i.filepath]
    assert shown and all(p.stat().st_nlink == 1 for p in shown if p.is_file())
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for picture in (workspace / "drive/images").rglob("*.png"):
        os.link(picture, tmp_path / picture.name)
    assert bpy.ops.unveil.load_workspace(directory=str(workspace)) == {"FINISHED"}
    shown = [Path(bpy.path.abspath(i.filepath)) for i in bpy.data.images if i.filepath]
    assert shown and all(p.stat().st_nlink == 1 for p in shown if p.is_file())

"""The batch command: exit codes and lines as those of ``unveil``, and a .blend with the results in it."""

from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import pytest


@pytest.fixture
def command(addon, scene):  # type: ignore[no-untyped-def]
    return addon.module("work.command_line").main


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "required"),
        (["run", "/nowhere", "-o", "WS"], "/nowhere: Not found"),
        (["run", "x", "-o", "WS", "--quality", "best"], "invalid choice"),
        (["run", "x", "-o", "WS", "--save"], "expected one argument"),
        (["doctor", "--save", "out.blend"], "--save goes with the verbs run and import"),
    ],
)
def test_bad_input_ends_with_2_and_one_line(command, arguments: list[str], line: str, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    assert command([a.replace("WS", str(tmp_path / "ws")) for a in arguments]) == 2
    said = capfd.readouterr().err
    assert line in said and said.count("\n") == 1 and said.startswith("unveil: error: ")
    assert not (tmp_path / "ws").exists()


def test_verbs_pass_through(command, capfd) -> None:  # type: ignore[no-untyped-def]
    assert command(["doctor", "--json"]) == 0
    assert capfd.readouterr().out.startswith('{"unveil": ')


def test_without_a_python_it_fails(command, addon, monkeypatch, capfd) -> None:  # type: ignore[no-untyped-def]
    for name in ("UNVEIL_PYTHON", "VIRTUAL_ENV", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", "/nowhere")
    addon.module("work.preferences").forget()
    assert command(["doctor"]) == 1
    assert "no Python with unveil was found" in capfd.readouterr().err
    addon.module("work.preferences").forget()


def test_a_run_is_loaded_and_saved(command, street, workspace, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    """The workspace is finished already, so this is quick; what a run makes is looked at elsewhere."""
    import bpy

    save = tmp_path / "shots/street.blend"
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Cube", None))  # a new file has something in it
    assert command(["run", str(street), "-o", str(workspace), "--quality", "draft", "--save", str(save)]) == 0
    said = capfd.readouterr()
    assert str(save) in said.out and "reconstruct  up to date" in said.err
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(save))
    assert Path(bpy.context.scene.unveil.workspace) == workspace
    assert Path(bpy.context.scene.unveil.drive) == street
    assert "Cube" not in bpy.data.objects
    cameras = [o for o in bpy.data.objects if o.type == "CAMERA"]
    assert len(cameras) == 1 and bpy.context.scene.camera == cameras[0]
    assert {m.get("unveil_role") for m in bpy.data.meshes} >= {"mesh:full", "mesh:empty"}
    assert any("frames" in bpy.path.abspath(i.filepath) or "clean" in i.filepath for i in bpy.data.images)


def test_a_blend_of_somebody_is_not_saved_over(command, street, workspace, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    save = tmp_path / "street.blend"
    arguments = ["import", str(street), "-o", str(workspace), "--quality", "draft", "--save", str(save)]
    save.write_bytes(b"an evening's work")
    assert command(arguments) == 2 and save.read_bytes() == b"an evening's work"
    assert "is there already, and was not saved by this command" in capfd.readouterr().err
    save.unlink()
    for _ in range(2):  # what it saved itself it saves again
        assert command(arguments) == 0
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    save.write_bytes(save.read_bytes() + b"changed")
    assert command(arguments) == 2


def test_what_lies_beside_cameras_is_not_written_over(command, street, workspace, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    cameras = tmp_path / "street.abc"
    arguments = ["import", str(street), "-o", str(workspace), "--quality", "draft", "--save-cameras", str(cameras)]
    beside = tmp_path / "street.abc.json"
    beside.write_text("mine")
    assert command(arguments) == 2 and beside.read_text() == "mine" and not cameras.exists()
    assert f"{beside}: is there already, and was not saved by this command" in capfd.readouterr().err
    beside.unlink()
    for _ in range(2):  # what it wrote itself it writes again
        assert command(arguments) == 0
    beside.write_text("mine")
    assert command(arguments) == 2 and beside.read_text() == "mine"


@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_an_interrupt_ends_with_130(command, street, tmp_path: Path, capfd) -> None:  # type: ignore[no-untyped-def]
    root = tmp_path / "ws"

    def interrupt() -> None:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and not (root / ".partial-reconstruct").exists():
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=interrupt)
    thread.start()
    assert command(["run", str(street), "-o", str(root), "--iterations", "100000"]) == 130
    thread.join()
    assert "unveil: cancelled; run the same command again to go on" in capfd.readouterr().err

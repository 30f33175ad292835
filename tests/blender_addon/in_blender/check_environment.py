"""The button that makes an environment: only online, cancelled and failed without a trace, found when it is made."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest


@pytest.fixture
def chosen(addon, scene, monkeypatch):  # type: ignore[no-untyped-def]
    """The preferences, with pip cut off from the network and no other Python with unveil in sight."""
    import bpy

    for name in ("UNVEIL_PYTHON", "VIRTUAL_ENV", "CONDA_PREFIX"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    preferences = addon.module("work.preferences")
    preferences.forget()
    found = preferences.preferences(bpy.context)
    found.torch_index = ""
    yield found
    found.install_from = found.wheels = ""
    preferences.forget()


def online() -> None:  # type: ignore[no-untyped-def]
    import bpy

    bpy.context.preferences.system.use_online_access = True
    assert bpy.app.online_access


@pytest.mark.parametrize("saved", [True, False])
def test_a_path_from_the_open_file_is_made_whole_or_refused(addon, chosen, tmp_path: Path, saved: bool) -> None:
    import bpy

    for folder in ("own", "strange"):
        (tmp_path / folder / "tools").mkdir(parents=True)
        (tmp_path / folder / "tools/python").write_text(f"#!/bin/sh\ntouch {tmp_path / folder}/run\n")
        (tmp_path / folder / "tools/python").chmod(0o755)
        (tmp_path / folder / "shot").mkdir()
    if saved:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "own/shot/a.blend"))
    chosen.python, chosen.wheels = "//../tools/python", "//../tools"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "strange/shot/a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "strange/shot/a.blend"))
    if saved:
        assert (chosen.python, chosen.wheels) == (str(tmp_path / "own/tools/python"), str(tmp_path / "own/tools"))
    preferences = addon.module("work.preferences")
    preferences.forget()
    found = preferences.unveil_interpreter(bpy.context)
    assert (found is not None) is saved and not (tmp_path / "strange/run").exists()
    if not saved:
        with pytest.raises(RuntimeError, match="name the whole path of a Python"):
            bpy.ops.unveil.check_python()
        online()
        chosen.install_from = "/nowhere/unveil_core-0.1.0-py3-none-any.whl"
        with pytest.raises(RuntimeError, match="Folder of Wheels begins with //"):
            bpy.ops.unveil.create_environment()
    chosen.python = ""


def test_offline_it_is_not_offered(addon, chosen) -> None:
    import bpy

    bpy.context.preferences.system.use_online_access = False
    assert not bpy.app.online_access and not bpy.ops.unveil.create_environment.poll()


def test_a_failure_is_told_and_nothing_stays(addon, chosen) -> None:
    import bpy

    online()
    chosen.install_from = "/nowhere/unveil_core-0.1.0-py3-none-any.whl"
    with pytest.raises(RuntimeError, match="/nowhere/unveil_core-0.1.0-py3-none-any.whl"):
        bpy.ops.unveil.create_environment()
    assert not addon.module("work.preferences").environment_folder().exists()
    with pytest.raises(RuntimeError, match="No Python was found"):
        bpy.ops.unveil.check_python()


def test_offline_a_folder_of_wheels_will_do(addon, chosen, tmp_path: Path) -> None:
    import bpy

    from tests.blender_addon.tiny_wheel import tiny_wheel

    bpy.context.preferences.system.use_online_access = False
    chosen.wheels = str(tmp_path / "wheels")
    assert bpy.ops.unveil.create_environment.poll()
    chosen.install_from = str(tiny_wheel(tmp_path, requires=("street-shapes",)))
    with pytest.raises(RuntimeError, match="Not a folder of wheels"):
        bpy.ops.unveil.create_environment()
    tiny_wheel(tmp_path / "wheels", "", "street_shapes", "1.0")
    assert bpy.ops.unveil.create_environment() == {"FINISHED"}
    assert addon.module("work.preferences").unveil_interpreter(bpy.context).source == "made by the add-on"


def test_it_is_made_with_a_copy_of_blenders_own_python_and_found_and_a_base_that_is_gone_is_told(
    addon, chosen, tmp_path: Path, monkeypatch
) -> None:
    """bpy has no Python of its own, so what lies in Blender's folder is forced."""
    import shutil

    import bpy

    from tests.blender_addon.tiny_wheel import tiny_wheel

    online()
    monkeypatch.setattr(addon.module("worker.base_python"), "lies_in", lambda python, folder: bool(folder))
    chosen.install_from = str(tiny_wheel(tmp_path))
    chosen.python = "/nowhere/python"
    assert bpy.ops.unveil.create_environment() == {"FINISHED"}
    preferences = addon.module("work.preferences")
    found = preferences.unveil_interpreter(bpy.context)
    assert found.ok and found.source == "made by the add-on" and found.facts["unveil"] == "0.1.0"
    base = preferences.environment_folder() / "base"
    if sys.base_prefix in ("/usr", "/usr/local"):
        pytest.skip("a system's own Python lies in no folder of its own, and is rightly not copied")
    assert any((base / "lib").glob("python3*/encodings"))

    shutil.rmtree(base)
    with pytest.raises(RuntimeError, match="made with is gone.*press Install"):
        bpy.ops.unveil.check_python()
    bpy.context.scene.unveil.drive = str(tmp_path)
    with pytest.raises(RuntimeError, match="made with is gone.*press Install"):
        bpy.ops.unveil.run()
    assert any("is gone" in line for line in preferences.known(chosen).lines())

"""The zip, as a user installs it; and that it goes again."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    import bpy
    from conftest import ROOT

    from tests.blender_addon.tiny_wheel import tiny_core

    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
    source = shutil.copytree(ROOT / "blender_addon", tmp_path / "source")
    tiny_core(source)  # as `make extension` puts the real one
    folders = ["--source-dir", str(source), "--output-dir", str(tmp_path)]
    subprocess.run([sys.executable, str(tool), "build", *folders], check=True, capture_output=True)
    return next(tmp_path.glob("unveil-*.zip"))


def test_the_zip_installs_enabled_and_goes_again(archive: Path) -> None:
    import bpy

    done = bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    assert done == {"FINISHED"}
    package = "bl_ext.user_default.unveil"
    assert package in bpy.context.preferences.addons
    assert bpy.context.scene.unveil.quality == "standard"
    assert bpy.context.preferences.addons[package].preferences.python == ""

    preferences = importlib.import_module(f"{package}.work.preferences")
    folder = preferences.environment_folder(create=True)
    assert folder.parent.is_dir() and ".user" in folder.parts and not folder.exists()

    environment = importlib.import_module(f"{package}.worker.environment")
    wheel = Path(environment.requirement())
    assert wheel.name.startswith("unveil_core-0.1.0") and wheel.is_file() and wheel.parent == environment.ADDON / "core"
    assert environment.locks() == wheel.parent  # with its hash: requirement() has looked

    bpy.ops.preferences.addon_disable(module=package)
    assert not hasattr(bpy.types.Scene, "unveil")

"""The zip, as a user installs it; and that it goes again."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    import bpy
    from conftest import ROOT

    tool = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
    source = ["--source-dir", str(ROOT / "blender_addon"), "--output-dir", str(tmp_path)]
    subprocess.run([sys.executable, str(tool), "build", *source], check=True, capture_output=True)
    return next(tmp_path.glob("unveil-*.zip"))


def test_the_zip_installs_enabled_and_goes_again(archive: Path) -> None:
    import bpy

    done = bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    assert done == {"FINISHED"}
    package = "bl_ext.user_default.unveil"
    assert package in bpy.context.preferences.addons
    assert bpy.context.scene.unveil.quality == "standard"
    assert bpy.context.preferences.addons[package].preferences.python == ""

    preferences = importlib.import_module(f"{package}.preferences")
    folder = preferences.environment_folder(create=True)
    assert folder.parent.is_dir() and ".user" in folder.parts and not folder.exists()

    bpy.ops.preferences.addon_disable(module=package)
    assert not hasattr(bpy.types.Scene, "unveil")

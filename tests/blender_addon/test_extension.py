"""The extension as a whole: what it says of itself, what it may import, and that Blender's own tool takes it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.blender_addon.run_in_blender import BLENDER, ROOT
from unveil_core import __version__

ADDON = ROOT / "blender_addon"
MANIFEST = tomllib.loads((ADDON / "blender_manifest.toml").read_text())
BLENDERS_TAGS = {
    "3D View",
    "Add Curve",
    "Add Mesh",
    "Animation",
    "Bake",
    "Camera",
    "Compositing",
    "Development",
    "Game Engine",
    "Geometry Nodes",
    "Grease Pencil",
    "Import-Export",
    "Lighting",
    "Material",
    "Mesh",
    "Modeling",
    "Node",
    "Object",
    "Paint",
    "Physics",
    "Pipeline",
    "Render",
    "Rigging",
    "Scene",
    "Sculpt",
    "Sequencer",
    "System",
    "Text Editor",
    "Tracking",
    "User Interface",
    "UV",
}
OUTSIDE = {"torch", "unveil_core", "cv2", "numba", "scipy", "skimage", "onnxruntime", "trimesh"}


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_the_manifest() -> None:
    assert MANIFEST["version"] == __version__
    assert "blender" not in MANIFEST["name"].lower() and set(MANIFEST["tags"]) <= BLENDERS_TAGS
    assert MANIFEST["blender_version_min"] == "4.2.0" and set(MANIFEST["permissions"]) == {"files", "network"}


def test_nothing_heavy_is_imported_into_blender() -> None:
    for path in ADDON.rglob("*.py"):
        assert not imports(path) & OUTSIDE, path.name


def test_only_one_module_asks_which_blender_this_is() -> None:
    for path in ADDON.rglob("*.py"):
        if path.name != "versions.py":
            assert "bpy.app.version" not in path.read_text(), path.name


@pytest.mark.skipif(not BLENDER.is_file(), reason="there is no bpy in an environment of its own")
def test_blenders_own_tool_builds_it_and_a_repository(tmp_path: Path) -> None:
    tool = next(BLENDER.parents[1].rglob("bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))

    def run(*arguments: str) -> None:
        done = subprocess.run([sys.executable, str(tool), *arguments], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr

    run("validate", str(ADDON))
    run("build", "--source-dir", str(ADDON), "--output-dir", str(tmp_path))
    archive = tmp_path / f"unveil-{__version__}.zip"
    run("validate", str(archive))
    run("server-generate", "--repo-dir", str(tmp_path))
    names = zipfile.ZipFile(archive).namelist()
    assert {"blender_manifest.toml", "__init__.py", "LICENSE", "worker/__init__.py", "worker/jobs.py"} <= set(names)
    assert not [n for n in names if "__pycache__" in n or n.endswith((".pyc", ".zip", ".jpg"))]
    entry = json.loads((tmp_path / "index.json").read_text())["data"][0]
    assert entry["id"] == "unveil" and entry["archive_size"] == archive.stat().st_size

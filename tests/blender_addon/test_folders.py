"""The add-on's folders: who may import whom, and which of them do without Blender."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.blender_addon.run_in_blender import ROOT

ADDON = ROOT / "blender_addon"
MAY_IMPORT = {
    "formats": set(),
    "worker": {"formats"},
    "scene": {"formats"},
    "choice": {"formats", "scene"},
    "work": {"formats", "worker", "scene", "choice"},
    "ui": {"formats", "worker", "scene", "choice", "work"},
}
"""By folder, lowest first: those below that it may import from, beside its own."""
WITHOUT_BLENDER = ("formats", "worker")
BLENDERS = {"bpy", "bpy_extras", "mathutils", "gpu", "gpu_extras", "blf", "bmesh", "addon_utils", "bl_ext"}
MODULES = sorted(path for folder in MAY_IMPORT for path in (ADDON / folder).rglob("*.py"))


def folder_of(path: Path) -> str:
    return path.relative_to(ADDON).parts[0]


def name_of(path: Path) -> str:
    return str(path.relative_to(ADDON))


def imported(path: Path) -> list[tuple[int, str, str]]:
    """All imports of a file, those inside functions too: (level, module, name); level 0 is an absolute one."""
    found: list[tuple[int, str, str]] = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(0, alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found += [(node.level, node.module or "", alias.name) for alias in node.names]
    return found


def folders_imported(path: Path) -> set[str]:
    """The add-on's folders that a module imports from; "" is the package itself."""
    depth = len(path.relative_to(ADDON).parts)  # so many dots lead to the package
    found = set()
    for level, module, name in imported(path):
        if level == 0:
            assert module.split(".")[0] != ADDON.name, (
                f"{name_of(path)} names the package, which Blender calls otherwise"
            )
            continue
        assert level <= depth, f"{name_of(path)} imports from outside the add-on"
        if level < depth:
            found.add(folder_of(path))
        elif (module, name) != ("", "__package__"):  # the package's name is no module
            found.add(module.split(".")[0] or (name if (ADDON / name).is_dir() else ""))
    return found


def test_the_folders_are_all_there_is() -> None:
    there = {path.name for path in ADDON.iterdir() if any(path.glob("*.py"))}
    assert there == set(MAY_IMPORT)
    assert [path.name for path in ADDON.glob("*.py")] == ["__init__.py"]
    assert all((ADDON / folder / "__init__.py").is_file() for folder in MAY_IMPORT)


def test_a_folder_stands_above_those_it_imports_from() -> None:
    order = list(MAY_IMPORT)
    for folder, below in MAY_IMPORT.items():
        assert below <= set(order[: order.index(folder)]), folder


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_point_downwards(path: Path) -> None:
    folder = folder_of(path)
    assert folders_imported(path) <= MAY_IMPORT[folder] | {folder}


def test_importing_the_package_imports_nothing_else() -> None:
    assert folders_imported(ADDON / "__init__.py") == set()
    for folder in MAY_IMPORT:
        assert imported(ADDON / folder / "__init__.py") == [], folder


@pytest.mark.parametrize("folder", WITHOUT_BLENDER)
def test_folders_that_do_without_blender(folder: str) -> None:
    paths = [path for path in MODULES if folder_of(path) == folder]
    assert len(paths) > 5
    assert MAY_IMPORT[folder] <= set(WITHOUT_BLENDER)  # what they import does without it, too
    for path in paths:
        assert not {module.split(".")[0] for level, module, _ in imported(path) if level == 0} & BLENDERS, path.name
    modules = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths if path.stem != "__init__"]
    program = f"""
import importlib, sys
sys.modules.update(dict.fromkeys({sorted(BLENDERS)}))
for name in {modules}:
    importlib.import_module(name)
ours = {{name.split(".")[1] for name in sys.modules if name.startswith("blender_addon.")}}
assert ours == {set((folder, *MAY_IMPORT[folder]))!r}, ours
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ------------------------------------------------------------------------ what points elsewhere without an import: by its name


def test_properties_of_the_scene_are_defined_below_whoever_reads_them() -> None:
    """``scene.unveil_selection`` stands in no folder below that in which it is registered."""
    owners: dict[str, str] = {}
    for path in MODULES:
        for name in re.findall(r"^ +bpy\.types\.Scene\.(\w+) = ", path.read_text(), re.MULTILINE):
            owners[name] = folder_of(path)
    assert owners == {"unveil": "scene", "unveil_view": "scene", "unveil_selection": "choice"}
    for path in MODULES:
        folder = folder_of(path)
        attributes = {node.attr for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Attribute)}
        read = {owners[name] for name in attributes & set(owners)}
        assert read <= MAY_IMPORT[folder] | {folder}, name_of(path)


def test_operators_are_called_from_above() -> None:
    owners: dict[str, str] = {}
    for path in MODULES:
        for name in re.findall(r'^    bl_idname = "unveil\.(\w+)"', path.read_text(), re.MULTILINE):
            assert name not in owners, name
            owners[name] = folder_of(path)
    assert len(owners) > 12
    for path in MODULES:
        folder = folder_of(path)
        called = set(re.findall(r"bpy\.ops\.unveil\.(\w+)", path.read_text()))
        called |= set(re.findall(r'"unveil\.(\w+)"', path.read_text()))
        assert {owners[name] for name in called} <= MAY_IMPORT[folder] | {folder}, name_of(path)


def test_whatever_registers_is_registered() -> None:
    """Modules with ``CLASSES``, ``register()`` or ``unregister()`` are in the package's list, and no others."""
    from blender_addon import MODULES as REGISTERED

    own = set()
    for path in MODULES:
        for node in ast.parse(path.read_text()).body:
            named = [node.name] if isinstance(node, ast.FunctionDef) else []
            named += [t.id for t in getattr(node, "targets", ()) if isinstance(t, ast.Name)]
            if {"CLASSES", "register", "unregister"} & set(named):
                own.add(".".join(path.relative_to(ADDON).with_suffix("").parts))
    assert own == set(REGISTERED) and len(REGISTERED) == len(own)
    folders = [list(MAY_IMPORT).index(name.split(".")[0]) for name in REGISTERED]
    assert folders == sorted(folders)  # from below upwards, so that nothing goes before what uses it

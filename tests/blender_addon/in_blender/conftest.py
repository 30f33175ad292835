"""The add-on, enabled in a Blender of its own: nothing of the user's Blender is read or written."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(os.environ["UNVEIL_ROOT"])
SHARED = Path(os.environ["UNVEIL_SHARED"])


@dataclass(frozen=True)
class AddOn:
    """The enabled add-on.

    Attributes:
        package: its name in Blender, ``bl_ext.user_default.unveil``.
    """

    package: str

    def module(self, name: str) -> ModuleType:
        """One of its modules, as ``addon.module("worker.jobs")``."""
        return importlib.import_module(f"{self.package}.{name}")


@pytest.fixture(scope="session")
def addon() -> Iterator[AddOn]:
    """The add-on's source folder, linked into the user's extensions and enabled."""
    assert "bpy" not in sys.modules, "import bpy inside the tests, after the user folders are set"
    extensions = Path(os.environ["BLENDER_USER_RESOURCES"]) / "extensions/user_default"
    extensions.mkdir(parents=True)
    (extensions / "unveil").symlink_to(ROOT / "blender_addon", target_is_directory=True)
    import bpy

    addon_utils = importlib.import_module("addon_utils")  # is there once bpy is

    package = "bl_ext.user_default.unveil"
    bpy.context.preferences.use_preferences_save = False
    assert addon_utils.enable(package, default_set=True) is not None
    yield AddOn(package)
    addon_utils.disable(package, default_set=True)


@pytest.fixture
def scene(addon: AddOn):  # type: ignore[no-untyped-def]
    """An empty scene in a new file, with the add-on enabled."""
    import bpy

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    return bpy.context.scene


def outside(*arguments: str) -> None:
    """Run the Python that has unveil_core."""
    subprocess.run([os.environ["UNVEIL_PYTHON"], *arguments], check=True, timeout=240, stdin=subprocess.DEVNULL)


@pytest.fixture(scope="session")
def street() -> Path:
    """transforms.json of a small street with a red car, 8 frames of 128x80; its truth lies beside it."""
    folder = SHARED / "street"
    if not folder.exists():
        program = (
            "import sys, pathlib; from tests.small_street import make_small_street as m; m(pathlib.Path(sys.argv[1]))"
        )
        outside("-c", program, str(SHARED / "street.partial"))
        (SHARED / "street.partial").rename(folder)
    return folder / "transforms.json"


@pytest.fixture(scope="session")
def finished(addon: AddOn, street: Path) -> Path:
    """A workspace of that street, run at draft quality through the operator. Not to be changed: see :func:`workspace`."""
    folder = SHARED / "finished"
    if not folder.exists():
        import bpy

        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        settings = bpy.context.scene.unveil
        settings.drive, settings.workspace = str(street), str(SHARED / "finished.partial")
        settings.quality = "draft"
        assert bpy.ops.unveil.run() == {"FINISHED"}
        (SHARED / "finished.partial").rename(folder)
    return folder


@pytest.fixture
def workspace(finished: Path, tmp_path: Path) -> Path:
    """A copy of the finished workspace."""
    return Path(shutil.copytree(finished, tmp_path / "workspace"))

"""The add-on, enabled in a Blender of its own: nothing of the user's Blender is read or written."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(os.environ["UNVEIL_ROOT"])


@dataclass(frozen=True)
class AddOn:
    """The enabled add-on.

    Attributes:
        package: its name in Blender, ``bl_ext.user_default.unveil``.
    """

    package: str

    def module(self, name: str) -> ModuleType:
        """One of its modules, as ``addon.module("jobs")``."""
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

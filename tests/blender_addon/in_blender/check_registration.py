"""Registration: classes and nothing else, and all of them go again."""

from __future__ import annotations

import sys

import pytest


def test_the_add_on_registers_and_keeps_torch_out(addon, scene) -> None:
    assert scene.unveil.quality == "standard"
    assert not {"torch", "unveil_core", "cv2", "numba"} & set(sys.modules)


def ours() -> set[str]:
    """What the add-on has in Blender: classes by their names, and properties of the scene."""
    import bpy

    properties = {n for n in dir(bpy.types.Scene) if n.startswith("unveil")}
    return {n for n in dir(bpy.types) if "unveil" in n.lower()} | properties


def test_unregister_takes_everything_back(addon) -> None:
    package = sys.modules[addon.package]
    before = ours()
    assert {"UNVEIL_PT_work", "unveil", "unveil_view", "unveil_selection"} <= before
    package.unregister()
    assert not ours()
    package.unregister()  # there is nothing more to take back
    package.register()
    assert ours() == before


def test_a_failing_module_leaves_nothing_registered(addon, monkeypatch) -> None:
    package = sys.modules[addon.package]
    before = ours()
    package.unregister()
    modules = [module for module in map(addon.module, package.MODULES) if hasattr(module, "register")]
    assert len(modules) > 5
    for failing in modules:
        with monkeypatch.context() as patch:
            patch.setattr(failing, "register", lambda: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                package.register()
        assert not ours(), failing
    package.register()
    assert ours() == before


def test_a_failing_class_leaves_nothing_registered(addon, monkeypatch) -> None:
    """Whichever it is: also those of its own module that came before it go again."""
    import bpy

    package = sys.modules[addon.package]
    before, register_class = ours(), bpy.utils.register_class
    package.unregister()
    classes = [cls for name in package.MODULES for cls in getattr(addon.module(name), "CLASSES", ())]
    assert len(classes) > 20
    for failing in classes:
        with monkeypatch.context() as patch:
            patch.setattr(bpy.utils, "register_class", failing_at(failing, register_class))
            with pytest.raises(RuntimeError, match=failing.__name__):
                package.register()
        assert not ours(), failing
    package.register()
    assert ours() == before


def failing_at(failing: type, register_class):  # type: ignore[no-untyped-def]
    def register(cls: type) -> None:
        if cls is failing:
            raise RuntimeError(cls.__name__)
        register_class(cls)

    return register

"""Registration: classes and nothing else, and all of them go again."""

from __future__ import annotations

import sys

import pytest


def test_the_add_on_registers_and_keeps_torch_out(addon, scene) -> None:
    assert scene.unveil.quality == "standard"
    assert not {"torch", "unveil_core", "cv2", "numba"} & set(sys.modules)


def test_unregister_takes_everything_back(addon) -> None:
    import bpy

    def ours() -> set[str]:
        return {n for n in dir(bpy.types) if "unveil" in n.lower()}

    package = sys.modules[addon.package]
    before = ours()
    assert "UNVEIL_PT_main" in before
    package.unregister()
    assert not ours() and not hasattr(bpy.types.Scene, "unveil")
    package.register()
    assert ours() == before


def test_a_failing_module_leaves_nothing_registered(addon, monkeypatch) -> None:
    import bpy

    package = sys.modules[addon.package]
    package.unregister()
    last = addon.module(package.MODULES[-1])
    monkeypatch.setattr(last, "register", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        package.register()
    assert not hasattr(bpy.types.Scene, "unveil")
    monkeypatch.undo()
    package.register()
    assert hasattr(bpy.types.Scene, "unveil")

"""The files of ``in_blender/``, under the bpy of this environment (``make test-blender`` runs them under others)."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from tests.blender_addon.run_in_blender import checks, run_check


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shared")


@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason="bpy is not installed")
@pytest.mark.parametrize("check", checks(), ids=lambda path: path.stem)
def test_in_blender(check: Path, shared: Path) -> None:
    done = run_check(sys.executable, check, shared=shared)
    assert done.returncode == 0, done.stdout + done.stderr

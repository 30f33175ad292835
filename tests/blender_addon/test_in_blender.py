"""The files of ``in_blender/``, under bpy 5.0 in an environment of its own (``make test-blender`` runs them under others)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.blender_addon.run_in_blender import BLENDER, checks, run_check


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shared")


@pytest.mark.skipif(
    not BLENDER.is_file(), reason="there is no bpy in an environment of its own: make .venv-bpy-5.0/.installed"
)
@pytest.mark.parametrize("check", checks(), ids=lambda path: path.stem)
def test_in_blender(check: Path, shared: Path) -> None:
    done = run_check(str(BLENDER), check, shared=shared)
    assert done.returncode == 0, done.stdout + done.stderr

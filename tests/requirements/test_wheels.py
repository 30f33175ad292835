"""The folder of wheels for machines without a network, filled by the lock files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from requirements import wheels
from tests.blender_addon.tiny_wheel import locked, tiny_wheel


@pytest.fixture
def packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What pip finds, and lock files that list some of it."""
    folder, locks = tmp_path / "packages", tmp_path / "locks"
    locks.mkdir()
    kept = {name: tiny_wheel(folder, "", name, "1.0") for name in ("pip", "core", "solve", "torch", "cuda")}
    tiny_wheel(folder, "", "core", "2.0")  # newer, and not in the lock
    for name, wheel in kept.items():
        (locks / f"{name}.txt").write_text(locked(wheel))
    monkeypatch.setattr(wheels, "HERE", locks)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_FIND_LINKS", str(folder))
    return folder


def names(folder: Path) -> set[str]:
    return {"-".join(file.name.split("-")[:2]) for file in folder.iterdir()}


def test_all_that_the_locks_list_is_there_and_nothing_else(packages: Path, tmp_path: Path) -> None:
    wheels.main([str(tmp_path / "all"), "", ""])
    assert names(tmp_path / "all") == {"pip-1.0", "core-1.0", "solve-1.0", "torch-1.0", "cuda-1.0"}
    wheels.main([str(tmp_path / "windows"), "", "--platform win_amd64"])
    assert names(tmp_path / "windows") == {"pip-1.0", "core-1.0", "solve-1.0", "torch-1.0"}


def test_torch_of_another_index_has_the_version_of_the_lock(packages: Path, tmp_path: Path) -> None:
    tiny_wheel(packages, "build = 'cpu'\n", "torch", "1.0+cpu")
    wheels.main([str(tmp_path / "cpu"), packages.as_uri(), ""])
    assert names(tmp_path / "cpu") == {"pip-1.0", "core-1.0", "solve-1.0", "torch-1.0+cpu"}


def test_what_pip_refuses_is_an_error(packages: Path, tmp_path: Path) -> None:
    tiny_wheel(packages, "import os\n", "core", "1.0")
    with pytest.raises(SystemExit, match="not complete"):
        wheels.main([str(tmp_path / "all"), "", ""])
    with pytest.raises(SystemExit, match="make wheels FOLDER"):
        wheels.main(["", "", ""])


def test_make_starts_it() -> None:
    makefile = (Path(wheels.__file__).parents[1] / "Makefile").read_text()
    assert '$(PYTHON) requirements/wheels.py "$(FOLDER)" "$(TORCH_INDEX)" "$(FOR)"' in makefile

"""What is installed against the lock: another version, a package nobody asked for, a file that was changed."""

from __future__ import annotations

import zipfile
from importlib.metadata import distributions
from pathlib import Path

import pytest

from requirements.check import pins, problems
from tests.blender_addon.tiny_wheel import tiny_wheel

LOCKED = pins("street-shapes==1.0 \\\n    --hash=sha256:00\nnumpy==1.26.4 ; python_full_version < '3.13' \\\n")


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Packages that are installed: one of the lock, in a build of its own, and unveil."""
    for wheel in (tiny_wheel(tmp_path, "", "street_shapes", "1.0+cpu"), tiny_wheel(tmp_path)):
        with zipfile.ZipFile(wheel) as files:
            files.extractall(tmp_path / "place")
    return tmp_path / "place"


def found(place: Path) -> list[str]:
    return problems(distributions(path=[str(place)]), LOCKED)


def test_what_the_lock_lists_is_in_order(place: Path) -> None:
    assert found(place) == []


def test_a_changed_file_is_named(place: Path) -> None:
    (place / "street_shapes/__init__.py").write_text("import os\n")
    assert found(place) == ["street-shapes 1.0+cpu: street_shapes/__init__.py has changed since it was installed"]
    (place / "street_shapes/__init__.py").unlink()
    assert "has changed" in found(place)[0]


@pytest.mark.parametrize(("name", "says"), [("numpy", "the lock has 1.26.4"), ("left_pad", "nothing of that name")])
def test_another_package_is_named(name: str, says: str, place: Path) -> None:
    info = place / f"{name}-9.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.0\n")
    (line,) = found(place)
    assert line.startswith(f"{name.replace('_', '-')} 9.0: ") and says in line

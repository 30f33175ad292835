"""What is released agrees with itself: versions, changelog, manifest; and the wheel holds what it must."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from requirements.release import _problems_of_wheel, changelog_version, problems_of_dist, problems_of_versions
from unveil_core import __version__

ROOT = Path(__file__).parents[2]


def test_version_changelog_and_manifest_agree() -> None:
    assert list(problems_of_versions(ROOT)) == []
    assert changelog_version(ROOT)[0] == __version__


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("unveil_core/__init__.py", f'"{__version__}"', '"9.0.0"', f"begins with {__version__}, unveil_core is 9.0.0"),
        ("CHANGELOG.md", f"## [{__version__}] - Unreleased", f"## [{__version__}] - soon", "as soon: write YYYY-MM-DD"),
        ("blender_addon/blender_manifest.toml", f'version = "{__version__}"', 'version = "8.1.0"', "says 8.1.0"),
    ],
)
def test_what_does_not_agree_is_named(file: str, old: str, new: str, says: str, tmp_path: Path) -> None:
    for name in ("unveil_core/__init__.py", "CHANGELOG.md", "blender_addon/blender_manifest.toml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    text = (tmp_path / file).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    assert any(says in problem for problem in problems_of_versions(tmp_path))


def test_the_wheel_is_whole(tmp_path: Path) -> None:
    built = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as packed:
        assert list(_problems_of_wheel(packed, __version__)) == []
    left = list(problems_of_dist(tmp_path, __version__))  # a wheel alone is no release
    assert len(left) == 2 and "source archive" in left[0] and left[1].endswith("index.json is missing")

"""The lock files: whole, of the versions that constraints.txt pins, and what pyproject.toml and the add-on ask for."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

import pytest

from blender_addon.worker.environment import FOOTAGE, LOCKS
from requirements.check import pins, plain
from requirements.lock import BLENDERS

ROOT = Path(__file__).parents[2]
LOCK_FILES = sorted((ROOT / "requirements").glob("*.txt"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
OF_NUMPY_1 = {"numpy-1.txt", *(f"bpy-{release}.txt" for release, _, _, numpy in BLENDERS if numpy)}
PINNED = pins((ROOT / "constraints.txt").read_text())


def locked(*names: str) -> set[str]:
    return {package for name in names for package in pins((ROOT / "requirements" / name).read_text())}


def wanted(requirements: list[str]) -> set[str]:
    return {plain(re.split(r"[^\w.-]", line)[0]) for line in requirements}


@pytest.mark.parametrize("path", LOCK_FILES, ids=lambda path: path.name)
def test_every_package_has_hashes_and_the_version_that_is_pinned(path: Path) -> None:
    entries = [e for e in re.split(r"\n(?=\S)", path.read_text().strip()) if not e.startswith("#")]
    assert entries
    for entry in entries:
        assert re.fullmatch(r"[a-z0-9-]+==[\w.+]+( ; [^\\\n]+)?(\s+(\\\n\s+)?--hash=sha256:[0-9a-f]{64})+", entry), (
            entry[:80]
        )
        ((name, versions),) = pins(entry).items()
        if name == "numpy" and path.name in OF_NUMPY_1:
            assert versions == {"1.26.4"}
        elif name != "bpy":  # one of each Blender
            assert {v.split("+")[0] for v in versions} <= PINNED[name], name


def test_what_make_installs_is_what_the_project_asks_for() -> None:
    run = locked("core.txt", "torch.txt")
    assert wanted(PROJECT["dependencies"]) <= run == locked("core.txt", "torch-cpu.txt")
    extras = PROJECT["optional-dependencies"]
    asked = [
        line
        for extra in ("dev", "bpy", "gpu", "datasets", "farm", "exports", "plates", "solve")
        for line in extras[extra]
    ]
    assert wanted(asked) <= locked("core.txt", "dev.txt", "bpy-5.0.txt")
    assert wanted(["hatchling"]) <= locked("build.txt")


def test_the_extension_brings_the_locks_that_the_add_on_reads() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert (
        f"$(foreach lock,{' '.join(n.removesuffix('.txt') for n in LOCKS)},requirements/$(lock).txt) requirements/{FOOTAGE}"
        in makefile
    )
    assert locked(FOOTAGE) >= wanted(PROJECT["optional-dependencies"]["solve"])
    assert "unveil-core" not in locked(*(path.name for path in LOCK_FILES))


def test_nothing_is_installed_but_by_hash() -> None:
    """Whatever ``make`` and the add-on tell pip to install."""
    commands = re.findall(r"-m pip (install[^;\n]*)", (ROOT / "Makefile").read_text())
    free = [c for c in commands if "--require-hashes" not in c]
    # the project itself, from this folder; and uv, which writes the locks but is never part of what is installed
    assert [c.split(" && ")[0].rstrip(" }") for c in free] == [
        "install --quiet --no-deps --no-build-isolation -e .",
        "install --quiet uv",
    ]


def test_nobody_is_told_to_install_what_a_registry_calls_unveil_core() -> None:
    """The name there may be another's."""
    named = re.compile(r"pip3? install[^\n]*unveil[-_]core", re.IGNORECASE)
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    # Without git, as in an archive of the sources, all files are looked at.
    files = [Path(p) for p in listed.stdout.split("\0") if p] or [p.relative_to(ROOT) for p in ROOT.rglob("*.*")]
    texts = [
        p
        for p in files
        if p.suffix in (".py", ".md", ".toml", ".j2") and (ROOT / p).is_file() and p.parts[0] != ".venv"
    ]
    assert len(texts) > 300
    assert not [
        p for p in texts if p != Path(__file__).relative_to(ROOT) and named.search((ROOT / p).read_text("utf-8"))
    ]

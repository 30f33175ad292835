"""Write the lock files of this folder: every package that is installed, with its version and the hashes of its files.

    make lock

The versions are those of ``constraints.txt``; what needs what is asked of the package index, through uv, for all systems and
Pythons at once. A lock file holds the hashes of every file of a release, so it serves Linux, macOS and Windows alike.

| file | installed by |
|---|---|
| ``pip.txt`` | the add-on: a pip that tells how far a download is |
| ``build.txt`` | make: what builds the project itself |
| ``core.txt`` | make, the add-on: what Unveil needs to run, but torch |
| ``torch-cpu.txt`` | make, where pip is told of a place that has it: torch without CUDA |
| ``torch.txt`` | make without that one, the add-on: torch as the usual index has it |
| ``cuda.txt`` | make, the add-on: what torch's build with CUDA loads (Linux) |
| ``solve.txt`` | the add-on: what reads clips and finds cameras |
| ``dev.txt`` | make test: tests, linters, the optional parts |
| ``audit.txt`` | make lint, into an environment of its own: what looks known holes up |
| ``numpy-1.txt`` | make test: the oldest series of NumPy that is supported, and what OpenCV is with it |
| ``bpy-5.0.txt`` | make test, into an environment of its own |
| ``bpy-4.2.txt``, ``bpy-4.5.txt``, ``bpy-5.1.txt`` to ``bpy-5.3.txt`` | make test-blender, each into an environment of its own |
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent

EXTRAS = ("dev", "docs", "gpu", "datasets", "farm", "exports", "plates", "solve")
"""Optional parts of pyproject.toml that ``make test`` installs, but for bpy."""
NUMPY_1 = "numpy==1.26.4"
"""The NumPy of Blender up to 5.0, and the oldest that Unveil itself runs with."""
BLENDERS = (
    ("4.2", "4.2.23", "3.11", NUMPY_1),
    ("4.5", "4.5.15", "3.11", NUMPY_1),
    ("5.0", "5.0.1", "3.11", NUMPY_1),
    ("5.1", "5.1.2", "3.13", None),
    ("5.2", "5.2.3", "3.13", None),
    ("5.3", "5.3.0", "3.13", None),
)
"""Per Blender its bpy, the one Python that this is built for, and its NumPy; None: the usual one."""
CUDA = re.compile(r"nvidia-|cuda-|triton$")
"""Names of what only torch's build with CUDA needs."""
CPU_TORCH = "torch==2.13.0+cpu --hash=sha256:6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b\n"
"""The build of this torch without CUDA for Linux x86_64 and Python 3.11, which the usual index does not have."""
SYSTEMS = ("x86_64-manylinux_2_28", "x86_64-pc-windows-msvc", "aarch64-apple-darwin")
PYTHONS = ("3.11", "3.12", "3.13")
"""What the add-on makes environments for: each must find a built wheel of every package."""


def compile_lock(uv: str, wanted: list[str], *options: str, numpy: str | None = None) -> dict[str, str]:
    """The lock of some requirements and of what they need.

    Args:
        uv: the program.
        wanted: requirements; a line that ends in ``pyproject.toml`` is that file.
        numpy: that is pinned instead of the one of ``constraints.txt``.
    Returns:
        per name the lines of its entries (several where the version depends on the Python), names sorted.
    """
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "wanted.in"
        source.write_text("".join(f"{line}\n" for line in wanted if not line.endswith(".toml")))
        files = [line for line in wanted if line.endswith(".toml")] or [str(source)]
        command = [uv, "pip", "compile", "--quiet", "--no-header", "--no-annotate", *options, *files]
        pinned = (ROOT / "constraints.txt").read_text().splitlines()
        if numpy is not None:
            pinned = [numpy if line.startswith("numpy==") else line for line in pinned]
        constraints = Path(folder) / "constraints.txt"
        constraints.write_text("".join(f"{line}\n" for line in pinned))
        command += ["--constraints", str(constraints)]
        oldest = os.environ | {"MACOSX_DEPLOYMENT_TARGET": "14.0"}  # that torch has wheels for
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=oldest)
    if done.returncode:
        raise SystemExit(done.stderr)
    entries: dict[str, str] = {}
    for entry in re.split(r"\n(?=\S)", done.stdout.strip()):
        name = re.split(r"[=\s]", entry)[0]
        entries[name] = entries.get(name, "") + entry + "\n"
    return entries


def write(name: str, entries: dict[str, str]) -> None:
    """Write one lock file."""
    path = HERE / f"{name}.txt"
    path.write_text("# Made by `make lock` from constraints.txt and pyproject.toml.\n" + "".join(entries.values()))
    print(f"{path.relative_to(ROOT)}: {len(entries)} packages")


def main(uv: str) -> None:
    """Write all lock files, and see that the add-on's have a wheel for each system."""
    locked = ["--universal", "--python-version", "3.11", "--generate-hashes"]
    run = compile_lock(uv, ["pyproject.toml"], *locked)
    core = {name: entry for name, entry in run.items() if name != "torch" and not CUDA.match(name)}
    everything = compile_lock(uv, ["pyproject.toml"], *locked, *(f"--extra={extra}" for extra in EXTRAS))
    write("core", core)
    write("torch", {"torch": run["torch"]})
    write("torch-cpu", {"torch": CPU_TORCH})
    write("cuda", {name: entry for name, entry in run.items() if CUDA.match(name)})
    solve = compile_lock(uv, ["pyproject.toml"], *locked, "--extra=solve")
    write("solve", {name: entry for name, entry in solve.items() if name not in run})
    write("dev", {name: entry for name, entry in everything.items() if name not in run or name == "triton"})
    # editables is asked for by hatchling only while it builds
    write("build", compile_lock(uv, ["hatchling", "editables"], *locked))
    write("pip", compile_lock(uv, ["pip"], *locked))
    write("audit", compile_lock(uv, ["pip-audit"], *locked))
    write("numpy-1", compile_lock(uv, [NUMPY_1], *locked, numpy=NUMPY_1))
    for blender, bpy, python, numpy in BLENDERS:
        options = (f"--python-version={python}", "--generate-hashes")
        write(f"bpy-{blender}", compile_lock(uv, [f"bpy=={bpy}", "pytest"], *options, numpy=numpy))
    for system in SYSTEMS:
        for python in PYTHONS:
            compile_lock(
                uv,
                ["pyproject.toml"],
                "--only-binary=:all:",
                f"--python-platform={system}",
                f"--python-version={python}",
            )
    print("every run-time package has a wheel for", ", ".join(SYSTEMS), "and Python", ", ".join(PYTHONS))


if __name__ == "__main__":
    main(sys.argv[1])

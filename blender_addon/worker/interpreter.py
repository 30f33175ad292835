# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python that has unveil_core: where it may be, and what it has. No bpy here.

Blender's own Python cannot hold it: torch and numba are built for other versions, and would share its process.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .base_python import lost_base, on_path
from .environment import ADDON
from .jobs import own_folder, worker_environment

__all__ = ["Candidate", "Found", "addon_version", "candidates", "check", "find", "lies_beside_files", "venv_python"]

WINDOWS = os.name == "nt"
LEAST_PYTHON, LEAST_UNVEIL = (3, 11), (0, 1)
PROBE = """
import json, sys
found = {"python": sys.version.split()[0], "executable": sys.executable}
try:
    import unveil_core
    found["unveil"] = unveil_core.__version__
except Exception as error:
    found["problem"] = type(error).__name__ + ": " + str(error)
print(json.dumps(found))
"""
LITTLE_MEMORY_GB, LITTLE_DISK_GB = 8, 5
"""Below these *Check* advises. docs/benchmarks.md has a run of 200 frames of 1920x1080 that takes 4.2 GB of memory and 0.9 GB of
disk, and an environment takes 2 GB; the rest of the machine wants some, too."""
MEND = "press Install, or name another Python under Advanced"


@dataclass(frozen=True)
class Candidate:
    """An interpreter that may do.

    Attributes:
        python: its path; it need not have unveil_core.
        source: where it was found, for people.
    """

    python: Path
    source: str


@dataclass(frozen=True)
class Found:
    """What an interpreter has.

    Attributes:
        python, source: as in :class:`Candidate`.
        ok: whether it can do the work.
        problem: one line on what is wrong and what to do, or empty.
        facts: what it said: python, unveil, and after a full check torch, cpus, memory_gb, gpu and more; addon: its version.
    """

    python: Path
    source: str
    ok: bool
    problem: str = ""
    facts: dict[str, object] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """What people want to know of it; the last line is what is wrong, or that nothing is."""
        facts = self.facts
        said = [f"{self.python} ({self.source})"]
        names = (("unveil", "unveil"), ("python", "Python"), ("torch", "torch"), ("numba", "numba"))
        versions = [f"{label} {facts[key]}" for key, label in names if facts.get(key)]
        if versions:
            said.append(", ".join(versions))
        if "cpus" in facts:
            said += [_machine(facts), _gpu(facts)]
        if isinstance(facts.get("work_free_gb"), int | float):
            said.append(f"Free disk: {facts['work_free_gb']:g} GB in {facts.get('work_folder')}")
        return [*said, *self.advice(), self.problem or "Ready."]

    def advice(self) -> list[str]:
        """What hinders it though it works, with what to do: one line each."""
        facts, said = self.facts, []
        addon, unveil = _numbers(facts.get("addon")), _numbers(facts.get("unveil"))
        if self.ok and unveil and addon and unveil[:2] != addon[:2]:
            mend = "press Install" if unveil < addon else "update the add-on"
            said.append(f"unveil {facts['unveil']} is not of this add-on's version {facts['addon']}: {mend}")
        if facts.get("gpu_unused"):
            said.append("This torch cannot use the NVIDIA GPU: empty Index for Torch and press Install")
        if _less(facts, "memory_gb", LITTLE_MEMORY_GB):
            said.append("Little memory: choose Draft, or a part of the drive in Frames")
        if _less(facts, "work_free_gb", LITTLE_DISK_GB):
            said.append("Little free disk: make room, or choose another Results Folder before you import")
        return said


def addon_version() -> str:
    """Of the add-on itself, by its manifest."""
    try:
        return str(tomllib.loads((ADDON / "blender_manifest.toml").read_text(encoding="utf-8"))["version"])
    except (OSError, ValueError, KeyError):
        return ""


def _machine(facts: dict[str, object]) -> str:
    memory = facts.get("memory_gb")
    name = f"{facts['cpu']}, " if facts.get("cpu") else ""
    return f"{name}{facts['cpus']} CPU cores" + (f", {memory:g} GB memory" if isinstance(memory, int | float) else "")


def _gpu(facts: dict[str, object]) -> str:
    if not facts.get("cuda"):
        return "GPU: none that torch can use; Unveil works on the processor"
    memory = facts.get("gpu_memory_gb")
    known = f"GPU: {facts.get('gpu')}" + (f", {memory:g} GB" if isinstance(memory, int | float) else "")
    if facts.get("runs_use_gpu"):
        return known
    return f"{known}; Unveil works on the processor: {facts.get('gpu_problem') or 'this unveil cannot use it'}"


def _less(facts: dict[str, object], name: str, least: float) -> bool:
    value = facts.get(name)
    return isinstance(value, int | float) and value < least


# ------------------------------------------------------------------------------------------------------------- where it may be


def venv_python(folder: Path) -> Path:
    """The interpreter of a virtual environment."""
    return folder / ("Scripts/python.exe" if WINDOWS else "bin/python")


def lies_beside_files(named: str) -> bool:
    """Whether a path leads to another place with each .blend: ``//`` is the folder of the open one, and Blender may work there."""
    path = named.strip()
    return bool(path) and (path.startswith("//") or not Path(path).expanduser().is_absolute())


def candidates(
    preferred: str = "",
    *,
    own: Path | None = None,
    environ: Mapping[str, str] | None = None,
) -> list[Candidate]:
    """Interpreters that exist, the likeliest first, each once.

    Args:
        preferred: what the user has named: an interpreter, or a virtual environment's folder.
        own: the environment that the add-on makes.
        environ: UNVEIL_PYTHON, VIRTUAL_ENV, CONDA_PREFIX and PATH are looked at; the process's own by default.
    """
    environ = os.environ if environ is None else environ
    found: dict[Path, Candidate] = {}
    for path, source in _places(preferred, own, environ):
        path = venv_python(path) if path.is_dir() else path
        if (path.is_file() and os.access(path, os.X_OK)) or lost_base(
            path.parent.parent
        ):  # whose user is to hear of it
            # Not resolved: a virtual environment is known by its link to the interpreter that it was made with.
            found.setdefault(Path(os.path.abspath(path)), Candidate(Path(os.path.abspath(path)), source))
    return list(found.values())


def _places(preferred: str, own: Path | None, environ: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    """Nothing that lies beside a drive or a .blend: these come from strangers, and what is found here is run."""
    if preferred.strip():
        if not lies_beside_files(preferred):
            yield Path(preferred.strip()).expanduser(), "from the preferences"
        return  # who names one wants that one, or to hear what is wrong with it
    if environ.get("UNVEIL_PYTHON"):
        yield Path(environ["UNVEIL_PYTHON"]).expanduser(), "from UNVEIL_PYTHON"
    if own is not None:
        yield own, "made by the add-on"
    command = on_path("unveil", environ)
    if command:
        yield from ((python, "of the unveil command") for python in _python_of_script(Path(command)))
    for name in ("VIRTUAL_ENV", "CONDA_PREFIX"):
        if environ.get(name):
            folder = Path(environ[name])
            yield folder / "python.exe" if WINDOWS and name == "CONDA_PREFIX" else venv_python(folder), f"from {name}"
    for name in ("python3", "python"):
        path = on_path(name, environ)  # pyenv's, too: its shims lie on the path
        if path:
            yield Path(path), "on the path"


def _python_of_script(script: Path) -> Iterator[Path]:
    """The interpreter that a console script starts with, and those beside it."""
    try:
        with script.open("rb") as stream:
            first = stream.readline(512).decode("utf-8", "replace").strip()
    except OSError:
        first = ""
    if first.startswith("#!") and "env " not in first:
        yield Path(first[2:].strip().strip('"'))
    for folder in (script.parent, script.resolve().parent):
        yield folder / ("python.exe" if WINDOWS else "python")


# ----------------------------------------------------------------------------------------------------------------- what it has


def check(candidate: Candidate, *, full: bool = True, timeout_s: float = 120, work: Path | None = None) -> Found:
    """Ask an interpreter what it has.

    Args:
        candidate: whom.
        full: also start ``unveil doctor``, which renders once: some seconds, more the first time.
        timeout_s: for each of the questions.
        work: where results will lie: its free disk is told. It need not be there yet.
    """
    lost = lost_base(candidate.python.parent.parent)
    if lost:
        problem = f"the Python that this environment was made with is gone ({lost}): it was updated, moved or removed"
        return Found(candidate.python, candidate.source, False, f"{problem} ({MEND})")
    facts, problem = _ask([str(candidate.python), "-P", "-c", PROBE], min(timeout_s, 20))
    if facts:
        facts["addon"] = addon_version()
    version = _numbers(facts.get("python"))
    if version and version < LEAST_PYTHON:
        problem = f"this is Python {facts['python']}, unveil needs 3.11 or later"
    elif problem and not facts:
        problem = f"this Python does not start: {problem}"
    elif facts.get("problem"):
        problem = f"Not found: unveil_core ({facts['problem']})"
    elif _numbers(facts.get("unveil")) < LEAST_UNVEIL:
        problem = f"unveil {facts.get('unveil')} is too old, this add-on needs {'.'.join(map(str, LEAST_UNVEIL))}"
    elif full:
        answer, problem = _ask([str(candidate.python), "-P", "-m", "unveil_core", "doctor", "--json"], timeout_s)
        facts.update(answer)
        if answer.get("problem"):
            problem = f"unveil does not work there: {answer['problem']}"
        if work is not None:
            facts.update(_free_disk(work))
    return Found(candidate.python, candidate.source, not problem, f"{problem} ({MEND})" if problem else "", facts)


def _free_disk(folder: Path) -> dict[str, object]:
    there = next((place for place in (folder, *folder.parents) if place.is_dir()), None)
    try:
        return (
            {"work_folder": str(there), "work_free_gb": round(shutil.disk_usage(there).free / 2**30, 1)}
            if there
            else {}
        )
    except OSError:
        return {}


def find(places: Iterable[Candidate]) -> Found | None:
    """The first that has unveil_core, by a quick look; else the first at all, with what is wrong with it."""
    first = None
    for candidate in places:
        found = check(candidate, full=False)
        if found.ok:
            return found
        first = first or found
    return first


def _ask(command: list[str], timeout_s: float) -> tuple[dict[str, object], str]:
    """The JSON that a command prints last, and what went wrong."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            encoding="utf-8",
            errors="replace",
            timeout=timeout_s,
            env=worker_environment(),
            cwd=own_folder(),
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return {}, f"no answer within {timeout_s:g} s"
    except OSError as error:
        return {}, error.strerror or str(error)
    for line in reversed(done.stdout.splitlines()):
        if line.startswith("{"):
            try:
                return json.loads(line), ""
            except ValueError:
                break
    said = done.stderr.strip().splitlines()
    return {}, said[-1] if said else f"exit code {done.returncode}"


def _numbers(version: object) -> tuple[int, ...]:
    """(3, 11) of "3.11.7"."""
    parts = str(version or "").split(".")[:2]
    return tuple(int(p) for p in parts) if all(p.isdigit() for p in parts) else ()

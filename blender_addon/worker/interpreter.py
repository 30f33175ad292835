# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python that has unveil_core: where it may be, and what it has. No bpy here.

Blender's own Python cannot hold it: torch and numba are built for other versions, and would share its process.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from .environment import on_path
from .jobs import worker_environment

__all__ = ["Candidate", "Found", "candidates", "check", "find", "venv_python"]

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
MEND = "press Create environment, or name another Python above"


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
        facts: what it said: python, unveil, and after a full check torch, cpus, memory_gb, gpu and more.
    """

    python: Path
    source: str
    ok: bool
    problem: str = ""
    facts: dict[str, object] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """What people want to know of it."""
        said = [f"{self.python} ({self.source})"]
        names = (("unveil", "unveil"), ("python", "Python"), ("torch", "torch"), ("numba", "numba"))
        versions = [f"{label} {self.facts[key]}" for key, label in names if self.facts.get(key)]
        if versions:
            said.append(", ".join(versions))
        if "cpus" in self.facts:
            memory = self.facts.get("memory_gb")
            cores = f"{self.facts['cpus']} CPU cores" + (f", {memory:g} GB" if isinstance(memory, int | float) else "")
            said.append(f"{cores}, GPU: {self.facts.get('gpu', 'not known')}")
        said.append(self.problem or "Ready.")
        return said


# ------------------------------------------------------------------------------------------------------------- where it may be


def venv_python(folder: Path) -> Path:
    """The interpreter of a virtual environment."""
    return folder / ("Scripts/python.exe" if WINDOWS else "bin/python")


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
        if path.is_file() and os.access(path, os.X_OK):
            # Not resolved: a virtual environment is known by its link to the interpreter that it was made with.
            found.setdefault(Path(os.path.abspath(path)), Candidate(Path(os.path.abspath(path)), source))
    return list(found.values())


def _places(preferred: str, own: Path | None, environ: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    """Nothing that lies beside a drive or a .blend: these come from strangers, and what is found here is run."""
    if preferred.strip():
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


def check(candidate: Candidate, *, full: bool = True, timeout_s: float = 120) -> Found:
    """Ask an interpreter what it has.

    Args:
        candidate: whom.
        full: also start ``unveil doctor``, which renders once: some seconds, more the first time.
        timeout_s: for each of the questions.
    """
    facts, problem = _ask([str(candidate.python), "-P", "-c", PROBE], min(timeout_s, 20))
    version = _numbers(facts.get("python"))
    if version and version < LEAST_PYTHON:
        problem = f"this is Python {facts['python']}, unveil needs 3.11 or later"
    elif problem and not facts:
        problem = f"this Python does not start: {problem}"
    elif facts.get("problem"):
        problem = f"unveil_core is not there ({facts['problem']})"
    elif _numbers(facts.get("unveil")) < LEAST_UNVEIL:
        problem = f"unveil {facts.get('unveil')} is too old, this add-on needs {'.'.join(map(str, LEAST_UNVEIL))}"
    elif full:
        answer, problem = _ask([str(candidate.python), "-P", "-m", "unveil_core", "doctor", "--json"], timeout_s)
        facts.update(answer)
        if answer.get("problem"):
            problem = f"unveil does not work there: {answer['problem']}"
    return Found(candidate.python, candidate.source, not problem, f"{problem} ({MEND})" if problem else "", facts)


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

# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a virtual environment that has unveil_core. No bpy here.

The file is also the program that does it, run by the Python that the environment is to have:

    python environment.py FOLDER REQUIREMENT [--locks FOLDER] [--torch-index URL]

The zip brings in ``core/`` the wheel of unveil_core, its hash, and lock files: every package that it needs, its version and hashes.
Nothing else is taken from an index. Only of a torch from an index that the preferences name, the version alone is held.

It tells of its progress in JSON lines, as ``unveil --json``. Whatever goes wrong, no half-made environment stays, and one that
was there before is there again.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

__all__ = ["ADDON", "READY", "base_python", "is_ready", "locks", "on_path", "remove_unfinished", "requirement"]

ADDON = Path(__file__).absolute().parent.parent
"""The add-on's folder; the wheel that came with it lies in its ``core/``."""
READY = "unveil-is-installed"
"""File in an environment that was finished."""
LEAST, MOST = (3, 11), (3, 13)
"""Versions of Python that torch and numba are built for."""
LOCKS = ("pip.txt", "core.txt", "torch.txt", "cuda.txt")
"""Lock files: pip itself; what unveil needs, but torch; torch; what torch's build with CUDA loads. See ``requirements/lock.py``."""
HASH = "unveil_core.hash"
"""File that ``pip hash`` wrote of the wheel when the extension was built."""


def is_ready(folder: Path) -> bool:
    """Whether an environment was finished."""
    return (folder / READY).is_file()


def remove_unfinished(folder: Path) -> bool:
    """Remove an environment that was not finished, and put back the one before it; returns whether there was one to remove."""
    if is_ready(folder):
        return False
    there, before = folder.exists(), _previous(folder)
    shutil.rmtree(folder, ignore_errors=True)
    if is_ready(before) and not folder.exists():
        before.rename(folder)  # to the place that it was made for
    return there


def _previous(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.previous")


def locks(addon: Path = ADDON) -> Path | None:
    """The folder with the lock files that came with the add-on; None in a source folder, which has none."""
    folder = addon / "core"
    return folder if all((folder / name).is_file() for name in LOCKS) else None


def requirement(named: str = "", addon: Path = ADDON) -> str:
    """What pip is to install: what the user has named, else the wheel that came with the add-on.

    Raises:
        LookupError: neither is there (whatever a registry calls unveil-core may be another's), or what came is not whole.
    """
    if named.strip():
        return named.strip()
    wheels = sorted((addon / "core").glob("unveil_core-*.whl"))
    mend = "install the extension again, or name what to install"
    if not wheels:
        raise LookupError(f"the add-on came without unveil_core ({mend})")
    if locks(addon) is None or not (addon / "core" / HASH).is_file():
        raise LookupError(f"the add-on came without the hashes of what it installs ({mend})")
    return str(wheels[-1])


def base_python(own: str, environ: Mapping[str, str] | None = None) -> str | None:
    """A Python of a version that the environment can have and that can make one: Blender's own, or one on the path.

    Args:
        own: the interpreter of this process.
    """
    environ = os.environ if environ is None else environ
    minors = range(LEAST[1], MOST[1] + 1)
    names = [on_path(f"python3.{minor}", environ) for minor in minors] + [on_path("python3", environ)]
    for python in (own, *names):
        if python and _can_make(python):
            return python
    return None


def on_path(name: str, environ: Mapping[str, str]) -> str | None:
    """A program in one of the path's folders. Never one in the working folder, where Windows looks first: who opens a .blend works
    where it lies."""
    folders = [folder for folder in environ.get("PATH", "").split(os.pathsep) if os.path.isabs(folder)]
    return next((found for folder in folders if (found := shutil.which(os.path.join(folder, name)))), None)


def _can_make(python: str) -> bool:
    program = "import ensurepip, sys, venv; print(*sys.version_info[:2])"
    try:
        done = subprocess.run([python, "-I", "-c", program], capture_output=True, text=True, timeout=20)
        return LEAST <= tuple(int(n) for n in done.stdout.split()) <= MOST
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return False


# ----------------------------------------------------------------------------------------------------------------- the program


PATIENCE_S = 5.0
"""What a command has to end once it was asked to."""

_commands: list[subprocess.Popen[str]] = []
_stop = threading.Event()
"""Set when this is to end. No signal interrupts anything, so what was begun is put away in peace."""


def tell(done: int, total: int, message: str, level: str = "info") -> None:
    """An event, as ``unveil --json`` has them."""
    event = {"t": time.time(), "stage": "environment", "done": done, "total": total, "message": message, "level": level}
    print(json.dumps(event), flush=True)


def _run(step: int, steps: int, command: list[str], what: str) -> None:
    """Run a command and tell what it says; pip's own progress counts within the step."""
    if _stop.is_set():
        raise KeyboardInterrupt
    tell(step * 100, steps * 100, what)
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    assert process.stdout is not None
    _commands.append(process)
    if _stop.is_set():  # set while it started: whoever did so has perhaps not seen it
        _end_commands()
    last, label, reported_at, before = "", what, 0.0, 0
    refused: str | None = None
    try:
        for line in process.stdout:
            line = line.strip()
            progress = re.fullmatch(r"Progress (\d+) of (\d+)", line)
            if progress:
                done, total = (int(g) for g in progress.groups())
                if total and (done == total or time.monotonic() - reported_at > 0.2):
                    reported_at = time.monotonic()
                    share = _share(before + done)
                    tell(step * 100 + share, steps * 100, f"{label} ({done / 1e6:.0f} of {total / 1e6:.0f} MB)")
                before += total if done == total else 0
                continue
            if line:
                print(line, flush=True)
                last = line if not line.startswith("[notice]") else last
                if refused == "":  # pip names what it refused, then both hashes
                    refused = re.split(r"\s*(?:@| from | \(|:$)", line)[0]
                elif "DO NOT MATCH THE HASHES" in line:
                    refused = ""
            if line.startswith(("Collecting ", "Downloading ", "Installing ", "Building ", "Processing ")):
                label = _label(line)
                tell(step * 100 + _share(before), steps * 100, label)
    except BaseException:  # nobody listens any more, say
        _end_commands()
        process.wait()
        raise
    code = process.wait()
    if _stop.is_set():
        raise KeyboardInterrupt
    if code and refused:
        raise RuntimeError(f"{refused} is not the file that unveil was built with: its hash is another")
    if code:
        raise RuntimeError(last or f"{command[0]} ended with exit code {code}")


def _share(loaded: int) -> int:
    """Per cent of a step after so many bytes: nobody knows how many are to come, so it only ever grows."""
    return int(90 * (1 - math.exp(-loaded / 3e8)))


def _label(line: str) -> str:
    """What pip does, short enough for a panel: ``Downloading torch 2.13.0``."""
    verb, _, rest = line.partition(" ")
    if verb == "Installing":
        count = rest.count(",") + 1
        return f"Installing {count} package{'s' if count > 1 else ''}"
    file = re.split(r"[\\/]", rest.split(" (")[0])[-1]
    if file.endswith((".whl", ".metadata")):
        file = " ".join(file.split("-")[:2])
    return f"{verb} {file}"[:60]


def make(folder: Path, wanted: str, locked: Path | None, torch_index: str) -> None:
    """Make the environment.

    Args:
        folder: of the environment; what is there goes once the new one is finished.
        wanted: a requirement for pip, or the path of a wheel or a source folder.
        locked: folder of the lock files; None: pip chooses what ``wanted`` needs.
        torch_index: package index for torch: its own has builds without gigabytes of CUDA; empty for none.
    Raises:
        RuntimeError: a step failed, with the last line that it said.
    """
    if is_ready(folder):
        shutil.rmtree(_previous(folder), ignore_errors=True)
        folder.rename(_previous(folder))
    shutil.rmtree(folder, ignore_errors=True)
    temporary = folder / "temporary"  # pip's downloads: a pip that is killed leaves them, gigabytes maybe
    temporary.mkdir(parents=True)
    os.environ.update(dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary)))
    python = str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))
    pip = [python, "-I", "-m", "pip", "--no-input", "--disable-pip-version-check"]
    _run(0, 6, [sys.executable, "-I", "-m", "venv", str(folder)], "making the environment")
    try:  # only a newer pip tells how far a download is
        newer = ["--upgrade", "pip>=24.2"] if locked is None else [*STRICT, "-r", str(locked / "pip.txt")]
        _run(1, 6, [*pip, "install", *newer], "updating pip")
        pip_install = [*pip, "install", "--progress-bar", "raw"]
    except RuntimeError:
        pip_install = [*pip, "install", "--progress-bar", "off"]
    if locked is not None:  # before torch, whose index has some of them too
        _run(2, 6, [*pip_install, *STRICT, "-r", str(locked / "core.txt")], "installing what unveil needs")
    if torch_index:
        _run(3, 6, [*pip_install, "--index-url", torch_index, _torch(locked)], "installing torch")
    elif locked is not None:
        _run(3, 6, [*pip_install, *STRICT, "-r", str(locked / "torch.txt")], "installing torch")
        if subprocess.run([python, "-I", "-c", WITH_CUDA], capture_output=True, check=False).returncode == 0:
            _run(3, 6, [*pip_install, *STRICT, "-r", str(locked / "cuda.txt")], "installing CUDA's libraries")
    _run(4, 6, [*pip_install, *_unveil(wanted, locked, temporary)], "installing unveil")
    _run(5, 6, [python, "-I", "-c", "import unveil_core; print('unveil', unveil_core.__version__)"], "trying it")
    shutil.rmtree(temporary, ignore_errors=True)
    (folder / READY).write_text("")
    shutil.rmtree(_previous(folder), ignore_errors=True)
    tell(1, 1, "done")


STRICT = ("--require-hashes", "--no-deps", "--only-binary", ":all:")
"""How pip installs from a lock file: what it lists, with these hashes, and nothing that has to be built."""
WITH_CUDA = (
    "import importlib.metadata as m; wants = m.requires('torch') or [];"
    " raise SystemExit(not any('nvidia' in r or 'cuda' in r for r in wants))"
)
"""Ends well if the torch that is installed needs CUDA's libraries."""


def _torch(locked: Path | None) -> str:
    """The torch of the lock, whatever its build."""
    found = re.search(r"^torch==[^\s;]+", (locked / "torch.txt").read_text(), re.MULTILINE) if locked else None
    return found.group() if found else "torch>=2.4"


def _unveil(wanted: str, locked: Path | None, temporary: Path) -> list[str]:
    """pip's arguments for unveil itself. The wheel that came with the lock must have the hash that was noted when it was built."""
    if locked is None or Path(wanted).parent != locked:
        return [wanted]
    noted = re.search(r"sha256:[0-9a-f]{64}", (locked / HASH).read_text())
    if noted is None:
        raise RuntimeError(f"{locked / HASH} has no hash (install the extension again)")
    file = temporary / "unveil-core.txt"
    file.write_text(f"unveil-core @ {Path(wanted).as_uri()} --hash={noted.group()}\n", encoding="utf-8")
    return [*STRICT, "-r", str(file)]


def _end_commands() -> None:
    """The command that runs, and what it has started itself."""
    if os.name != "nt":
        os.killpg(0, signal.SIGTERM)  # this process heeds it, see _stop_now(); the others end
        return
    for command in _commands:
        if command.poll() is None:
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(command.pid)], capture_output=True, check=False)


def _stop_now(*_: object) -> None:
    if not _stop.is_set():
        _stop.set()
        _end_commands()


def _end_with_stdin() -> None:
    """Whoever started this has ended: so does this."""
    while os.read(0, 4096):  # not sys.stdin, whose lock would be held when Python shuts down
        pass
    _stop_now()
    time.sleep(PATIENCE_S)
    if os.name != "nt":
        os.killpg(0, signal.SIGKILL)
    os._exit(130)


def _watch() -> None:
    """From now on this ends when it is asked to, or when its standard input does, together with what it has started."""
    for name in ("SIGINT", "SIGTERM", "SIGBREAK"):  # the last is that of Windows
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _stop_now)
    if os.name != "nt" and os.getpgrp() != os.getpid():
        os.setpgid(0, 0)  # its commands are in this group, and nobody else is
    threading.Thread(target=_end_with_stdin, daemon=True).start()


def main(arguments: list[str]) -> int:
    """Exit codes as those of ``unveil``."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("requirement")
    parser.add_argument("--locks", type=Path)
    parser.add_argument("--torch-index", default="")
    given = parser.parse_args(arguments)
    _watch()
    code = 1
    try:
        make(given.folder, given.requirement, given.locks, given.torch_index)
        code = 0
    except KeyboardInterrupt:
        code = 130
    except (RuntimeError, OSError) as error:
        tell(0, 0, str(error), "error")
        print(f"unveil: failed: the environment could not be made: {error}", file=sys.stderr)
    finally:
        if code:
            remove_unfinished(given.folder)
    return code


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

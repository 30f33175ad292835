# SPDX-License-Identifier: GPL-3.0-or-later
"""Make a virtual environment that has unveil_core. No bpy here.

The file is also the program that does it, run by the Python that the environment is to have:

    python environment.py FOLDER REQUIREMENT [--locks FOLDER] [--torch-index URL] [--wheels FOLDER] [--copy-base]

The zip brings in ``core/`` the wheel of unveil_core, its hash, and lock files: every package that it needs, its version and hashes.
Nothing else is taken from an index. Only of a torch from an index that the preferences name, the version alone is held.

With ``--wheels`` everything comes from that folder, by the same lock files, and no index is asked; ``make wheels`` fills one.
With ``--copy-base`` the Python that runs this is copied into the environment first: see ``base_python.py``.

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
from pathlib import Path

__all__ = [
    "ADDON",
    "READY",
    "is_ready",
    "locks",
    "minors_of",
    "remove_unfinished",
    "requirement",
    "system_program",
    "wheels_folder",
]

ADDON = Path(__file__).absolute().parent.parent
"""The add-on's folder; the wheel that came with it lies in its ``core/``."""
READY = "unveil-is-installed"
"""File in an environment that was finished."""
LOCKS = ("pip.txt", "core.txt", "torch.txt", "cuda.txt")
"""Lock files: pip itself; what unveil needs, but torch; torch; what torch's build with CUDA loads. See ``requirements/lock.py``."""
FOOTAGE = "solve.txt"
"""Lock file of what reads clips and finds cameras. Where that cannot be had, everything but *Import Footage* works."""
HASH = "unveil_core.hash"
"""File that ``pip hash`` wrote of the wheel when the extension was built."""


def minors_of(wheels: Path) -> set[int]:
    """The versions of Python 3 that a folder's wheels are built for, 11 for 3.11."""
    return {int(minor) for file in wheels.glob("*.whl") for minor in re.findall(r"-cp3(\d+)-cp3\d+-", file.name)}


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
        LookupError: it lies beside a .blend.
        LookupError: neither is there (whatever a registry calls unveil-core may be another's), or what came is not whole.
    """
    if named.strip():
        return _of_the_user(named, "Install From")
    wheels = sorted((addon / "core").glob("unveil_core-*.whl"))
    mend = "install the extension again, or name what to install"
    if not wheels:
        raise LookupError(f"the add-on came without unveil_core ({mend})")
    if locks(addon) is None or not (addon / "core" / HASH).is_file():
        raise LookupError(f"the add-on came without the hashes of what it installs ({mend})")
    return str(wheels[-1])


def _of_the_user(named: str, label: str) -> str:
    """A path as the user has named it; never one that begins with ``//``, which leads to beside whatever .blend is open."""
    if named.strip().startswith("//"):
        raise LookupError(f"{label} begins with //, which leads to beside the open file: name the whole path")
    return named.strip()


def wheels_folder(named: str, wanted: str) -> Path | None:
    """The folder of wheels that the user has named, None for none.

    Args:
        wanted: what is to be installed; from a folder of wheels nothing is fetched, so no address.
    Raises:
        LookupError: it is no folder, has no wheels, or lies beside a .blend.
    """
    if not named.strip():
        return None
    folder = Path(_of_the_user(named, "Folder of Wheels")).expanduser()
    if not folder.is_dir():
        raise LookupError(f"{folder}: Not a folder of wheels")
    if not any(folder.glob("*.whl")):
        raise LookupError(f"{folder} has no wheels: fill it with `make wheels FOLDER=…`, or empty Folder of Wheels")
    if "://" in wanted:
        raise LookupError(
            "Install From is an address: with Folder of Wheels nothing is fetched, so empty one of the two"
        )
    return folder


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
    missing = trouble = ""
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
                elif not missing and (found := re.search(r"No matching distribution found for ([^\s;(]+)", line)):
                    missing = found.group(1)
                trouble = trouble or _network_trouble(line)
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
    if code and missing:
        raise LookupError(missing, trouble)
    if code:
        raise RuntimeError(last or f"{command[0]} ended with exit code {code}")


NETWORK_TROUBLES = (
    (
        r"certificate.verify.failed|self.signed certificate|unable to get local issuer|certificate is not trusted|"
        r"SSLCertVerificationError",
        "its certificate is not trusted: does the company's network open encrypted connections? Set PIP_CERT to its root "
        "certificate, a .pem file, before Blender starts; or name a Folder of Wheels",
    ),
    (
        r"proxy authentication|cannot connect to proxy|proxyerror|tunnel connection failed",
        "the proxy refuses the connection: set HTTPS_PROXY=http://NAME:PASSWORD@HOST:PORT before Blender starts",
    ),
    (
        r"name resolution|getaddrinfo failed|nodename nor servname|network is unreachable|no route to host",
        "there is no network, or it does not lead there",
    ),
    (
        r"403 client error|403 forbidden|401 client error",
        "the package index refuses the request: is it one of the company's own?",
    ),
)
"""What pip says, some lines before it says that a package was not found, and what that means."""


def _network_trouble(line: str) -> str:
    """What a line of pip tells of the connection; "" where nothing."""
    return next((told for said, told in NETWORK_TROUBLES if re.search(said, line, re.IGNORECASE)), "")


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


def make(
    folder: Path, wanted: str, locked: Path | None, torch_index: str, wheels: Path | None = None, copy: bool = False
) -> None:
    """Make the environment.

    Args:
        folder: of the environment; what is there goes once the new one is finished.
        wanted: a requirement for pip, or the path of a wheel or a source folder.
        locked: folder of the lock files; None: pip chooses what ``wanted`` needs.
        torch_index: package index for torch: its own has builds without gigabytes of CUDA; empty for none.
        wheels: a folder that everything is taken from, and no index asked; ``torch_index`` has no meaning then.
        copy: copy the Python that runs this into the environment, and make it with that.
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
    base = _copied(folder / "base") if copy else sys.executable
    _run(0, 6, [base, "-I", "-m", "venv", str(folder)], "making the environment")
    try:
        _install(folder, wanted, locked, torch_index, wheels)
    except LookupError as error:
        place = f"has no wheel in {wheels}" if wheels else "was not found in the package index"
        python = ".".join(map(str, sys.version_info[:2]))
        trouble = str(error.args[1]) if len(error.args) > 1 and error.args[1] else "is there a network?"
        mend = "fill it anew with `make wheels`, by this Python's version" if wheels else trouble
        raise RuntimeError(f"{error.args[0]} {place} for Python {python} on {sys.platform} ({mend})") from error
    python = _python(folder)
    _run(5, 6, [python, "-I", "-c", "import unveil_core; print('unveil', unveil_core.__version__)"], "trying it")
    shutil.rmtree(temporary, ignore_errors=True)
    (folder / READY).write_text("")
    shutil.rmtree(_previous(folder), ignore_errors=True)
    tell(1, 1, "done")


def _python(folder: Path) -> str:
    return str(folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python"))


def _copied(folder: Path) -> str:
    """The interpreter of a copy of the Python that runs this. One that cannot be copied makes the environment itself."""
    program = [sys.executable, "-I", "-u", str(Path(__file__).absolute().with_name("base_python.py")), str(folder)]
    try:
        _run(0, 6, program, "copying Blender's Python")
    except RuntimeError:
        shutil.rmtree(folder, ignore_errors=True)
        return sys.executable
    return str(folder / Path(sys.executable).resolve().relative_to(Path(sys.base_prefix).resolve()))


def _install(folder: Path, wanted: str, locked: Path | None, torch_index: str, wheels: Path | None) -> None:
    """Install unveil and what it needs.

    Raises:
        LookupError: pip finds no file of a package, which is named.
        RuntimeError: something else is wrong.
    """
    python = _python(folder)
    pip = [python, "-I", "-m", "pip", "--no-input", "--disable-pip-version-check"]
    source = ["--no-index", "--find-links", str(wheels.absolute())] if wheels else []
    if wheels:  # pip's own settings may name other places
        for name in [n for n in os.environ if n.startswith("PIP_")]:
            del os.environ[name]
        os.environ["PIP_CONFIG_FILE"] = os.devnull
    try:  # only a newer pip tells how far a download is
        newer = ["--upgrade", "pip>=24.2"] if locked is None else [*STRICT, "-r", str(locked / "pip.txt")]
        _run(1, 6, [*pip, "install", *source, *newer], "updating pip")
        pip_install = [*pip, "install", "--progress-bar", "raw", *source]
    except (RuntimeError, LookupError):
        pip_install = [*pip, "install", "--progress-bar", "off", *source]
    if locked is not None:  # before torch, whose index has some of them too
        _run(2, 6, [*pip_install, *STRICT, "-r", str(locked / "core.txt")], "installing what unveil needs")
    if torch_index and not wheels:
        _run(3, 6, [*pip_install, "--index-url", torch_index, _torch(locked)], "installing torch")
    elif locked is not None and wheels and (local := _local_torch(wheels, _torch(locked))):
        _run(3, 6, [*pip_install, "--no-deps", "--only-binary", ":all:", local], "installing torch")
    elif locked is not None:
        _run(3, 6, [*pip_install, *STRICT, "-r", str(locked / "torch.txt")], "installing torch")
        if subprocess.run([python, "-I", "-c", WITH_CUDA], capture_output=True, check=False).returncode == 0:
            _run(3, 6, [*pip_install, *STRICT, "-r", str(locked / "cuda.txt")], "installing CUDA's libraries")
    if locked is not None and (locked / FOOTAGE).is_file():
        try:
            _run(4, 6, [*pip_install, *STRICT, "-r", str(locked / FOOTAGE)], "installing what reads footage")
        except (RuntimeError, LookupError) as error:
            print(f"without footage: {error}", flush=True)
    _run(4, 6, [*pip_install, *_unveil(wanted, locked, folder / "temporary")], "installing unveil")


def _local_torch(wheels: Path, torch: str) -> str:
    """The build of this torch that a folder has and the usual index does not, as ``torch==2.13.0+cpu``; empty if it has none.

    The lock has no hashes of such builds, so the version alone is held, as of a torch from an index of its own.
    """
    found = sorted(wheels.glob(f"{torch.replace('==', '-')}+*.whl"))
    return "==".join(found[0].name.split("-")[:2]) if found else ""


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


def system_program(name: str) -> str:
    """The path of a program of Windows: by its name alone, one in the working folder would be taken."""
    return os.path.join(os.environ.get("SYSTEMROOT", r"C:\Windows"), "System32", name)


def _end_commands() -> None:
    """The command that runs, and what it has started itself."""
    if os.name != "nt":
        os.killpg(0, signal.SIGTERM)  # this process heeds it, see _stop_now(); the others end
        return
    for command in _commands:
        if command.poll() is None:
            subprocess.run(
                [system_program("taskkill.exe"), "/F", "/T", "/PID", str(command.pid)], capture_output=True, check=False
            )


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
    parser.add_argument("--wheels", type=Path)
    parser.add_argument("--copy-base", action="store_true")
    given = parser.parse_args(arguments)
    _watch()
    code = 1
    try:
        make(given.folder, given.requirement, given.locks, given.torch_index, given.wheels, given.copy_base)
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

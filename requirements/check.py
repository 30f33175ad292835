"""See that the packages of this Python are those of the lock files, file by file. Needs no network.

    python requirements/check.py

Each installed package must be in a lock file, at its version, and each of its files must have the hash that was noted when it was
installed. Known holes of the versions are another question: nothing answers it offline (``pip-audit -r constraints.txt`` does,
online).
"""

from __future__ import annotations

import base64
import csv
import hashlib
import re
import sys
from collections.abc import Iterable
from importlib.metadata import Distribution, distributions
from pathlib import Path

HERE = Path(__file__).resolve().parent
OWN = frozenset({"unveil-core", "pip"})
"""Not of the lock: the project, and the pip that a new environment comes with."""


def pins(text: str) -> dict[str, set[str]]:
    """Per name, in small letters with dashes, the versions that the text of a lock file allows."""
    found: dict[str, set[str]] = {}
    for name, version in re.findall(r"^([A-Za-z0-9._-]+)==([^\s;]+)", text, flags=re.MULTILINE):
        found.setdefault(plain(name), set()).add(version)
    return found


def plain(name: str) -> str:
    """The name of a package as indices compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def problems(installed: Iterable[Distribution], locked: dict[str, set[str]]) -> list[str]:
    """What differs from the lock, one line each; a local version (``2.13.0+cpu``) is its public one."""
    found = []
    for package in installed:
        name = plain(package.metadata["Name"])
        if name in OWN:
            continue
        if package.version.split("+")[0] not in {v.split("+")[0] for v in locked.get(name, ())}:
            wanted = " or ".join(sorted(locked.get(name, ()))) or "nothing of that name"
            found.append(f"{name} {package.version}: the lock has {wanted}")
        found += [f"{name} {package.version}: {file} has changed since it was installed" for file in changed(package)]
    return found


def changed(package: Distribution) -> list[str]:
    """The files of a package that are missing or other than its RECORD says."""
    found = []
    # Read here, for ``package.files`` leaves missing files out in some versions of importlib.
    for name, noted, *_ in csv.reader((package.read_text("RECORD") or "").splitlines()):
        if not noted or name.endswith(".pyc"):  # RECORD itself; bytecode, which Python makes anew
            continue
        path, (kind, _, digest) = Path(str(package.locate_file(name))), noted.partition("=")
        if not path.is_file() or _digest(path, kind) != digest:
            found.append(name)
    return found


def _digest(path: Path, kind: str) -> str:
    with path.open("rb") as file:
        return base64.urlsafe_b64encode(hashlib.file_digest(file, kind).digest()).rstrip(b"=").decode()


def main() -> int:
    """Print what is wrong; 1 if anything is."""
    locked: dict[str, set[str]] = {}
    for path in HERE.glob("*.txt"):
        for name, versions in pins(path.read_text()).items():
            locked.setdefault(name, set()).update(versions)
    installed = list(distributions())
    found = problems(installed, locked)
    print("\n".join(found) or f"{len(installed)} packages are those of requirements/, file by file")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())

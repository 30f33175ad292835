"""Under which licences the packages are that the project asks for, and whether these fit Apache-2.0, its own.

    python requirements/licences.py

A package says its licence in its metadata: as an expression (SPDX), by classifiers, or in a few words. What is permissive fits, and
so does what asks for its own files alone (MPL-2.0). Under the GPL, or in words that are not known here, is a finding. Metadata
speaks of a package's own code: what a wheel brings along besides is looked for by the names of its libraries.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

__all__ = ["BROUGHT", "KNOWN", "brought_by", "problem_with", "reached"]

ROOT = Path(__file__).resolve().parent.parent
FITTING = frozenset(
    ("0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "HPND", "ISC", "MIT", "MIT-CMU", "MPL-2.0")
    + ("PSF-2.0", "Python-2.0", "Unlicense", "Zlib")
)
"""SPDX' names. BSD alone is any of its kinds."""
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
    "zlib/libpng License": "Zlib",
}
WORDS = {"apache 2.0": "Apache-2.0", "3-clause bsd license": "BSD-3-Clause", "bsd 3-clause": "BSD-3-Clause", "mit license": "MIT"}
"""What packages write in the place of an expression."""
KNOWN = {
    "openexr": "names none in its metadata; LICENSE.md in it is BSD-3-Clause",
    "opencolorio": "names none in its metadata; it is BSD-3-Clause (aswf-opencolorio.org)",
    "usd-core": "Tomorrow Open Source Technology License 1.0: Apache-2.0 with another clause on trade marks; not in the core",
    "bpy": "GPL-3.0-or-later: Blender itself, under which the add-on's tests run; unveil_core imports nothing of it",
}
"""Packages whose metadata does not say enough, or says what does not fit, with the reason why they are taken."""
BROUGHT = {
    "av": "x264 and x265 (GPL-2.0-or-later), by which FFmpeg encodes H.264 and H.265",
    "pycolmap": "CHOLMOD's supernodal solver (GPL-2.0-or-later), linked in: the extra solve runs it in a process of its own",
}
"""Packages whose wheels bring libraries under the GPL, besides their own code."""
UNDER_GPL = re.compile(
    r"(?:lib)?(x264|x265|xvid\w*|postproc|cholmod|umfpack|fftw3\w*|gsl|readline|rubberband|vidstab)[-.\d]*(?:-\w+)?"
    r"\.(?:so|dll|dylib)(?:\.[\d.]+)?",
    re.IGNORECASE,
)
"""Files of libraries under the GPL that wheels are known to bring."""


def plain(name: str) -> str:
    """A package's name in small letters with dashes."""
    return re.sub(r"[-_.]+", "-", name).lower()


def reached(requirements: Iterable[str]) -> dict[str, Distribution]:
    """The packages that requirements lead to on this machine, by name; those that are not installed are left out."""
    found: dict[str, Distribution] = {}
    waiting = [(Requirement(line), "") for line in requirements]
    seen = set()
    while waiting:
        wanted, extra = waiting.pop()
        name = plain(wanted.name)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": extra}):
            continue
        if (name, frozenset(wanted.extras)) in seen:
            continue
        seen.add((name, frozenset(wanted.extras)))
        try:
            found[name] = distribution(wanted.name)
        except PackageNotFoundError:
            continue
        for line in found[name].requires or ():
            waiting += [(Requirement(line), own) for own in ("", *wanted.extras)]
    return found


def problem_with(name: str, expression: str | None, words: str | None, classifiers: Iterable[str]) -> str | None:
    """Why the licence of a package does not fit, None where it does.

    Args:
        expression, words, classifiers: ``License-Expression``, ``License`` and ``Classifier`` of its metadata.
    """
    if plain(name) in KNOWN:
        return None
    told = [c.split(" :: ")[-1] for c in classifiers if c.startswith("License :: ") and c != "License :: OSI Approved"]
    if expression:
        return None if _fits(expression) else f"{name} is under {expression}"
    if told:
        strange = [c for c in told if CLASSIFIERS.get(c) not in FITTING]
        return f"{name} is under {', '.join(strange)}" if strange else None
    first = (words or "").strip().split("\n")[0].strip()
    if (WORDS.get(first.lower(), first)) in FITTING:
        return None
    return f"{name} does not say a licence that is known here: {first[:60]!r}"


def _fits(expression: str) -> bool:
    """Whether an expression lets one choose licences that fit; AND binds more than OR."""
    words = re.findall(r"[()]|[^\s()]+", expression)

    def either() -> bool:
        found = both()
        while words[:1] == ["OR"]:
            del words[0]
            found = both() or found
        return found

    def both() -> bool:
        found = one()
        while words[:1] == ["AND"]:
            del words[0]
            found = one() and found
        return found

    def one() -> bool:
        word = words.pop(0) if words else ""
        if word == "(":
            found = either()
            del words[:1]
            return found
        if words[:1] == ["WITH"]:  # exceptions permit more, never less
            del words[:2]
        return word in FITTING

    return either() and not words


def brought_by(package: Distribution) -> list[str]:
    """Libraries under the GPL among the files of a package, by name."""
    return sorted({m.group(1).lower() for file in package.files or () if (m := UNDER_GPL.fullmatch(file.name))})


def groups() -> dict[str, list[str]]:
    """What the project asks for, by extra; the core's is ""."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return {"": project["dependencies"], **project["optional-dependencies"]}


def main() -> None:
    """List the licences, and fail on what does not fit."""
    found = []
    for extra, requirements in groups().items():
        print(f"\n{extra or 'core'}")
        for name, package in sorted(reached(requirements).items()):
            data = package.metadata
            told = (data.get("License-Expression"), data.get("License"), data.get_all("Classifier") or [])
            problem = problem_with(name, *told)
            said = told[0] or ", ".join(c.split(" :: ")[-1] for c in told[2] if c.startswith("License")) or (told[1] or "")[:40]
            print(f"  {name:32} {said.splitlines()[0] if said else '':48} {KNOWN.get(name, '')}{BROUGHT.get(name, '')}")
            if problem is not None:
                found.append(problem)
            if brought_by(package) and name not in BROUGHT:
                found.append(f"{name} brings {', '.join(brought_by(package))}")
    raise SystemExit("\n".join(found))


if __name__ == "__main__":
    sys.exit(main())

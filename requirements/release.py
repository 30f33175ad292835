"""See that what is to be released agrees with itself: versions, changelog, wheel, source archive and the extension's repository.

    python requirements/release.py dist

``make dist`` ends with it. A version that the changelog calls "Unreleased" is said: it is no mistake before the release.
"""

from __future__ import annotations

import email
import hashlib
import json
import re
import sys
import tarfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

__all__ = ["changelog_version", "problems_of_dist", "problems_of_versions"]

ROOT = Path(__file__).resolve().parents[1]


def program_version(root: Path) -> str:
    """The version of ``unveil_core``."""
    found = re.search(r'^__version__ = "(.+)"$', (root / "unveil_core/__init__.py").read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None
    return found.group(1)


def changelog_version(root: Path) -> tuple[str, str]:
    """The version and the date, or "Unreleased", of the newest entry of the changelog."""
    found = re.search(r"^## \[(.+?)\] - (.+)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert found is not None
    return found.group(1), found.group(2).strip()


def problems_of_versions(root: Path) -> Iterator[str]:
    """What says another version than the program."""
    version = program_version(root)
    told, date = changelog_version(root)
    if told != version:
        yield f"CHANGELOG.md begins with {told}, unveil_core is {version}"
    if date != "Unreleased" and not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        yield f"CHANGELOG.md dates {told} as {date}: write YYYY-MM-DD or Unreleased"
    manifest = tomllib.loads((root / "blender_addon/blender_manifest.toml").read_text(encoding="utf-8"))
    if manifest["version"] != version:
        yield f"blender_manifest.toml says {manifest['version']}, unveil_core is {version}"


def problems_of_dist(dist: Path, version: str) -> Iterator[str]:
    """What is wrong with a folder that ``make dist`` filled."""
    wheels, archives = sorted(dist.glob("*.whl")), sorted(dist.glob("*.tar.gz"))
    if [p.name for p in wheels] != [f"unveil_core-{version}-py3-none-any.whl"]:
        yield f"not one wheel of {version}: {[p.name for p in wheels]}"
    for wheel in wheels:
        with zipfile.ZipFile(wheel) as packed:
            yield from _problems_of_wheel(packed, version)
    if [p.name for p in archives] != [f"unveil_core-{version}.tar.gz"]:
        yield f"not one source archive of {version}: {[p.name for p in archives]}"
    for archive in archives:
        with tarfile.open(archive) as packed_source:
            names = {n.partition("/")[2] for n in packed_source.getnames()}
        missing = {"pyproject.toml", "README.md", "LICENSE", "CHANGELOG.md", "unveil_core/__init__.py", "docs/python.md"} - names
        yield from (f"{archive.name} lacks {name}" for name in sorted(missing))
    yield from _problems_of_repository(dist / "extension", version)


def _problems_of_wheel(packed: zipfile.ZipFile, version: str) -> Iterator[str]:
    names = set(packed.namelist())
    about = f"unveil_core-{version}.dist-info"
    for name in ("unveil_core/py.typed", "unveil_core/__init__.pyi", f"{about}/licenses/LICENSE", f"{about}/entry_points.txt"):
        if name not in names:
            yield f"the wheel lacks {name}"
    strange = sorted(n for n in names if not n.startswith(("unveil_core/", f"{about}/")) or "__pycache__" in n)
    if strange:
        yield f"the wheel has {strange[0]}"
    data = email.message_from_bytes(packed.read(f"{about}/METADATA"))
    if data["Version"] != version or data["License-Expression"] != "Apache-2.0":
        yield f"the wheel says version {data['Version']} and licence {data['License-Expression']}"


def _problems_of_repository(folder: Path, version: str) -> Iterator[str]:
    """Of the folder that Blender is pointed at: its index must name the archive beside it, with its size and hash."""
    index = folder / "index.json"
    if not index.is_file():
        yield f"{index} is missing"
        return
    entries = json.loads(index.read_text(encoding="utf-8"))["data"]
    if [(e["id"], e["version"]) for e in entries] != [("unveil", version)]:
        yield f"{index} lists {[(e['id'], e['version']) for e in entries]}"
    for entry in entries:
        archive = folder / Path(entry["archive_url"]).name
        if not archive.is_file():
            yield f"{archive} is missing"
        elif entry["archive_hash"] != f"sha256:{hashlib.sha256(archive.read_bytes()).hexdigest()}":
            yield f"{index} has another hash than {archive.name}"
        else:
            with zipfile.ZipFile(archive) as packed:
                if f"core/unveil_core-{version}-py3-none-any.whl" not in packed.namelist():
                    yield f"{archive.name} lacks the wheel of {version} in core/"


def main(folder: str) -> None:
    """Print what does not agree, and fail on it."""
    found = [*problems_of_versions(ROOT), *problems_of_dist(Path(folder), program_version(ROOT))]
    if found:
        raise SystemExit("\n".join(found))
    version, date = changelog_version(ROOT)
    print(f"{folder}: {version} is whole{'; the changelog calls it unreleased' if date == 'Unreleased' else ''}")


if __name__ == "__main__":
    main(*sys.argv[1:])

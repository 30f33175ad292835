"""Points beside a camera path: locators and meshes of a matchmove, as PLY, the vertices of an OBJ, or a table of numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.base.types import Float64
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.formats.shot.described import Described
from unveil_core.drives.points import read_points

__all__ = ["read_shot_points"]

KINDS = (".ply", ".obj", ".csv", ".txt", ".xyz")
BESIDE = tuple(f"{stem}{kind}" for stem in ("points", "locators", "trackers") for kind in KINDS)
"""Files that are taken without being named, the likelier first."""
MEND = "a table has a heading with x, y and z, or lines as NAME X Y Z"


def read_shot_points(path: Path, said: Described) -> tuple[PointCloud, tuple[Path, ...], list[str]]:
    """The points of a shot, the file that has them, and what a user should know.

    Raises:
        DriveError: a file that is named is not there, or holds no points.
    """
    root = path.parent if said.source is None else said.source.parent
    if said.points is not None:
        file: Path | None = named_path(root, said.points, said.source or path, "points")
    else:
        lower = {p.name.lower(): p for p in root.iterdir() if p.is_file()}
        file = next((lower[name] for name in BESIDE if name in lower), None)
        plys = [p for name, p in sorted(lower.items()) if name.endswith((".ply", ".obj"))]
        file = plys[0] if file is None and len(plys) == 1 else file
    if file is None:
        return PointCloud(np.zeros((0, 3))), (), [f"no points lie beside {path.name} (points.ply, .obj, .csv or .txt)"]
    told: list[str] = []
    if file.suffix.lower() == ".ply":
        return read_points(file, told), (file,), told
    if file.suffix.lower() not in KINDS:
        raise DriveError("Not a file of points", path=file, mend=f"give one of {', '.join(KINDS)}")
    text = read_text(file, "export the locators again")
    found = _vertices(text, file) if file.suffix.lower() == ".obj" else _table(text, file)
    finite = np.isfinite(found).all(axis=1)
    if not finite.any():
        raise DriveError("holds no points", path=file, mend=MEND)
    return PointCloud(found[finite]), (file,), told


def _vertices(text: str, file: Path) -> Float64:
    rows = [line.split()[1:4] for line in text.splitlines() if line.startswith(("v ", "v\t"))]
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise DriveError("has a vertex that is none", path=file, mend="export it again") from error


def _table(text: str, file: Path) -> Float64:
    lines = [line.replace(",", " ").replace(";", " ").split() for line in text.splitlines()]
    rows = [words for words in lines if words and not words[0].startswith("//")]
    heading = [w.lower().lstrip("#") for w in rows[0]] if rows else []
    heading = heading[1:] if heading[:1] == [""] else heading
    if {"x", "y", "z"} <= set(heading):
        columns, rows = [heading.index(axis) for axis in "xyz"], rows[1:]
    else:
        rows = [words for words in rows if not words[0].startswith("#")]
        # A name before the coordinates; colours or the like may stand behind.
        named = bool(rows) and (not _is_number(rows[0][0]) or len(rows[0]) == 4)
        columns = [1, 2, 3] if named else [0, 1, 2]
    found = []
    for words in rows:
        try:
            found.append([float(words[c]) for c in columns])
        except (ValueError, IndexError) as error:
            raise DriveError(f"Not a point: a line with {' '.join(words)[:60]!r}", path=file, mend=MEND) from error
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True

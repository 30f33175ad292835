"""Rules of style that ruff does not know. Needs no network and imports nothing of the project.

    python lint/style.py

* A folder of the program or of the add-on has few modules: more is no longer seen at a glance.
* Inside the program lengths are metres: no parameter, field or keyword tells how long a unit is, but where a drive's own unit is
  still known, and there as ``units_per_metre``.
* The add-on's operators stand in modules named ``operators_*.py``.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MOST_MODULES = 14
"""In one folder, beside its ``__init__``."""
AT_THE_DOOR = ("drives/drive.py", "drives/importing/", "drives/scale_and_up.py", "drives/formats/", "solve/placing.py")
"""Where a drive's own unit is still known."""
NAMES = {"unit", "units", "units_per_metre", "metric"}


def crowded_folders(root: Path) -> Iterator[str]:
    """Folders with too many modules."""
    for top in ("unveil_core", "blender_addon"):
        for folder in sorted({path.parent for path in (root / top).rglob("*.py")}):
            count = sum(path.name != "__init__.py" for path in folder.glob("*.py"))
            if count > MOST_MODULES:
                yield f"{folder.relative_to(root)}: {count} modules, at most {MOST_MODULES}"


def names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Parameters, fields and keyword arguments with their lines."""
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.keyword) and node.arg is not None:
            yield node.arg, node.lineno
        elif isinstance(node, ast.ClassDef):
            for field in node.body:
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    yield field.target.id, field.lineno


def units_told(root: Path) -> Iterator[str]:
    """Names by which a unit of length is told."""
    for path in sorted((root / "unveil_core").rglob("*.py")):
        place = path.relative_to(root / "unveil_core").as_posix()
        barred = {"unit"} if place.startswith(AT_THE_DOOR) else NAMES
        for name, line in names(ast.parse(path.read_text(encoding="utf-8"))):
            if name in barred:
                yield f"unveil_core/{place}:{line}: {name}: lengths are metres"


def operators_elsewhere(root: Path) -> Iterator[str]:
    """Operators outside of ``operators_*.py``."""
    for path in sorted((root / "blender_addon").rglob("*.py")):
        found = re.search(r'^    bl_idname = "unveil\.\w+"', path.read_text(encoding="utf-8"), re.MULTILINE)
        if found and not path.name.startswith("operators_"):
            yield f"{path.relative_to(root)}: operators stand in operators_*.py"


def main() -> None:
    """Print what breaks a rule, and fail on it."""
    found = [line for rule in (crowded_folders, units_told, operators_elsewhere) for line in rule(ROOT)]
    raise SystemExit("\n".join(found) or None)


if __name__ == "__main__":
    main()

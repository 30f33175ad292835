"""Where rendered streets lie, so that each is rendered once; and whether one is there."""

from __future__ import annotations

import ast
import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from sample_scenes.generators.streets.draw import size_of

HERE = Path(__file__).resolve().parent
NOT_GENERATOR = ("__init__.py", "make_streets.py", "cache.py")
KIT = HERE.parent / "parked_street" / "build_street.py"
"""The parked street's tools, which streets are built with."""
DEFAULT = Path("~/.cache/unveil/streets")


@cache
def version() -> str:
    """Eight letters that change with the generator's code; comments, docstrings and the folder it lies in do not count."""
    digest = hashlib.sha256()
    for path in [*sorted(p for p in HERE.glob("*.py") if p.name not in NOT_GENERATOR), KIT]:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                node.body = [n for n in node.body if not (isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant))]
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                node.module = node.module.replace("sample_scenes.generators.", "sample_scenes.")
        digest.update(path.name.encode() + ast.unparse(tree).encode())
    return digest.hexdigest()[:8]


def street_folder(seed: int, cache: Path | None = None, size: str = "usual") -> Path:
    """Where a seed's drive lies or would lie."""
    width, height, frames = size_of(seed, size)
    return Path(cache or DEFAULT).expanduser() / version() / f"{width}x{height}_{frames}" / f"{seed:04d}"


def kept(folder: Path, make: Callable[[Path], object]) -> bool:
    """Make a folder unless it is there; half a folder is never there. Returns whether it had to be made.

    ``make`` fills an empty folder beside the place, which is then renamed.
    """
    if folder.is_dir():
        return False
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        make(temporary)
        temporary.chmod(0o755)
        os.rename(temporary, folder)
    except OSError:
        if not folder.is_dir():
            raise
        # Another process was faster.
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return True

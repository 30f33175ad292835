"""Digest of the code that a stage runs: after an upgrade, results of older code are stale.

The source of the module that holds the stage's function counts, and of every module of this package that it imports, directly
or through others. Other packages (torch, OpenCV) are recorded in workspace.json by version and do not count: their updates
change results by rounding only.
"""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Callable
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any

__all__ = ["code_digest", "modules_behind"]

PACKAGE = __name__.split(".")[0]
ROOT = Path(__file__).resolve().parents[1]
_FROM = re.compile(rf"^[ \t]*from ({PACKAGE}[\w.]*) import (\([^)]*\)|[^\n#]*)", re.MULTILINE)
_IMPORT = re.compile(rf"^[ \t]*import ({PACKAGE}[\w.]*)", re.MULTILINE)
_BY_NAME = re.compile(rf"""import_module\(\s*f?["']({PACKAGE}\.[\w.]*)""")
"""Imports by name end where the variable part begins: ``import_module(f"package.backends.{name}")`` means the whole package."""


def code_digest(function: Callable[..., Any]) -> str:
    """Digest of the source code that a function depends on, 32 hexadecimal digits.

    A function from outside this package (a test, a script) counts with its own module's source alone.
    """
    while isinstance(function, partial):
        function = function.func
    module = function.__module__
    if module.split(".")[0] != PACKAGE:
        path = getattr(sys.modules[module], "__file__", None)
        return _digest((Path(path),) if path else ())
    return _digest(tuple(_path(m) for m in modules_behind(module)))


@lru_cache(maxsize=64)
def modules_behind(module: str) -> tuple[str, ...]:
    """Names of the modules of this package that ``module`` imports, itself included, in order."""
    found: set[str] = set()
    ahead = [module]
    while ahead:
        name = ahead.pop()
        if name in found or not _exists(name):
            continue
        found.add(name)
        ahead.extend(name.rsplit(".", k)[0] for k in range(1, name.count(".") + 1))  # the packages it lies in
        if name != PACKAGE:  # its public names are imported when somebody asks for them, not by who lies in it
            ahead.extend(_imports(name))
    return tuple(sorted(found))


@cache
def _imports(module: str) -> set[str]:
    source = _source(_path(module)).decode("utf-8")
    wanted = set(_IMPORT.findall(source))
    for package, names in _FROM.findall(source):
        wanted.add(package)
        # A name may be a module of the package; where it is not, there is no such file.
        wanted.update(f"{package}.{part.split()[0]}" for part in names.strip("()").split(",") if part.split())
    for prefix in _BY_NAME.findall(source):
        wanted.update(_below(prefix.rstrip(".")) if prefix.endswith(".") else {prefix})
    return wanted


def _below(package: str) -> set[str]:
    folder = ROOT.parent / package.replace(".", "/")
    return {".".join(p.relative_to(ROOT.parent).with_suffix("").parts) for p in folder.rglob("*.py")}


@cache
def _path(module: str) -> Path:
    """The module's source file; the ``__init__.py`` of a package."""
    at = ROOT.parent / module.replace(".", "/")
    return at / "__init__.py" if at.is_dir() else at.with_suffix(".py")


@cache
def _source(path: Path) -> bytes:
    """A file as it was when it was first asked for: stages share most of their modules."""
    return path.read_bytes().replace(b"\r\n", b"\n")


@cache
def _exists(module: str) -> bool:
    return _path(module).is_file()


@lru_cache(maxsize=64)
def _digest(paths: tuple[Path, ...]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for path in paths:
        # What lies beside the code of a package belongs to it: a page's style sheet, say.
        beside = (
            sorted(p for p in path.parent.glob("*.*") if p.suffix in (".css", ".js", ".j2"))
            if path.stem == "__init__"
            else []
        )
        for file in (path, *beside):
            digest.update(file.name.encode() + b"\0" + _source(file) + b"\0")
    return digest.hexdigest()

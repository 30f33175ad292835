"""numba's cache looks at a kernel's own file; what it is made of from others is named, so that their changes count, too."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from unveil_core.raster.cpu import block, per_surfel

HERE = Path(block.__file__).parent
NO_CODE_OF_KERNELS = {"sources", "SHARED", "Limits"}
"""What is imported for the processor's Python alone."""


def imported(module: str) -> set[str]:
    """Files of the rasterizer that a module takes something of, and those that these do, relative to ``raster/cpu``."""
    found: set[str] = set()
    for node in ast.walk(ast.parse((HERE / module).read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("unveil_core.raster"):
            below = node.module.removeprefix("unveil_core.raster").lstrip(".").split(".")  # type: ignore[union-attr]
            names = [a.name for a in node.names if a.name not in NO_CODE_OF_KERNELS]
            if below == [""]:
                found |= {f"../{name}.py" for name in names}
            elif names:
                found.add(f"{below[1]}.py" if below[0] == "cpu" else f"../{below[0]}.py")
    beside = {name for name in found if not name.startswith("../") and name != module}
    return found.union(*(imported(name) for name in beside))


@pytest.mark.parametrize(
    ("kernel", "named"),
    [
        ("per_surfel.py", per_surfel.SHARED),
        ("ellipsoids.py", per_surfel.SHARED),
        ("forward.py", block.TILE_SOURCES),
        ("backward.py", block.TILE_SOURCES),
    ],
)
def test_each_file_that_a_kernel_is_made_of_counts(kernel: str, named: tuple[str, ...]) -> None:
    made_of = imported(kernel) - {kernel}
    assert made_of and made_of <= set(named)


def test_a_change_in_any_of_them_gives_another_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.py", "b.py"):
        (tmp_path / name).write_text("one")
    monkeypatch.setattr(block, "__file__", str(tmp_path / "block.py"))
    before = block.sources("a.py", "b.py")
    (tmp_path / "b.py").write_text("two")
    assert block.sources("a.py", "b.py") != before

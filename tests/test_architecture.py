"""The packages of unveil_core: what lies where, and who may import whom. docs/development.md shows and argues it."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib.util import find_spec

import pytest

import unveil_core
from docs.generate import COMMAND, ORDER, PACKAGE, PARTS, ROOT, generated, imports, modules, package_of

BLENDER = {
    "bpy",
    "bpy_extras",
    "bmesh",
    "mathutils",
    "gpu",
    "gpu_extras",
    "blf",
    "addon_utils",
    "bl_ext",
    "blender_addon",
}
BY_NAME = {"unveil_core", "unveil_core.pipeline.graph", "unveil_core.raster.autograd", "unveil_core.bench.rivals"}
"""Modules that import others by a computed name: the public face, the stages their work, the rasterizer its backends, a benchmark
its rivals."""
INSIDE = [i for i in imports() if i.target == PACKAGE or i.target.startswith(f"{PACKAGE}.")]


def test_only_init_and_main_lie_loose() -> None:
    assert {p.name for p in (ROOT / PACKAGE).glob("*.py")} == {"__init__.py", "__main__.py"}


def test_each_package_has_its_place_in_the_order() -> None:
    assert {package_of(m) for m in modules()} - {"", "__main__"} == set(ORDER)


def test_no_import_points_up() -> None:
    place = {name: k for k, name in enumerate(ORDER)} | {"__main__": -1}
    wrong = [
        i
        for i in INSIDE
        if package_of(i.module) and package_of(i.target) and place[package_of(i.module)] > place[package_of(i.target)]
    ]
    assert wrong == []


def test_the_public_face_is_not_used_from_below() -> None:
    assert [i for i in INSIDE if i.target == PACKAGE and i.name != "__version__"] == []


def test_the_public_face_names_what_there_is() -> None:
    assert all(getattr(unveil_core, name) is not None for name in unveil_core.__all__)


def test_each_import_finds_its_module() -> None:
    assert {i.target for i in INSIDE} <= set(modules())


def test_no_modules_import_each_other_in_a_circle() -> None:
    targets = {m: sorted({i.target for i in INSIDE if i.module == m}) for m in modules()}
    done: set[str] = set()

    def circle_from(module: str, way: tuple[str, ...]) -> tuple[str, ...]:
        if module in way:
            return (*way[way.index(module) :], module)
        for target in [] if module in done else targets[module]:
            if found := circle_from(target, (*way, module)):
                return found
        done.add(module)
        return ()

    found = [circle_from(module, ()) for module in targets]
    assert [" -> ".join(way) for way in found if way] == []


def test_nothing_imports_blender() -> None:
    assert [i for i in imports() if i.target.split(".")[0] in BLENDER] == []


def test_imports_by_a_computed_name_are_few() -> None:
    """They are not seen by the rules above."""
    using = set()
    for module, path in modules().items():
        calls = [n.func for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        names = {f.attr if isinstance(f, ast.Attribute) else getattr(f, "id", "") for f in calls}
        if names & {"import_module", "__import__"}:
            using.add(module)
    assert using == BY_NAME
    assert all(find_spec(f"unveil_core.raster.{name}.backend") for name in ("cpu", "triton"))


@pytest.mark.parametrize("page", PARTS)
def test_generated_parts_of_the_pages_are_up_to_date(page: str) -> None:
    assert (ROOT / "docs" / page).read_text(encoding="utf-8") == generated(page), f"run `{COMMAND}`"


def test_kernels_share_threads_in_one_way() -> None:
    """``base/parallel`` says why: numba's own parallel loops keep a count of threads of their own."""
    sources = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in sorted((ROOT / PACKAGE).rglob("*.py"))}
    assert [name for name, text in sources.items() if "prange" in text or "parallel=True" in text] == []


def test_threads_work_in_the_context_of_the_run_that_started_them() -> None:
    """``base/parallel`` says why. Libraries start theirs without it, and without a word of errors: scipy's are not asked for."""
    apart = {
        f"{PACKAGE}/base/parallel.py",  # its own run what was given to them with its context
        f"{PACKAGE}/app/stdin_watch.py",  # ends the process
        f"{PACKAGE}/base/networks/child.py",  # programs of their own
        f"{PACKAGE}/solve/mapping/child.py",
        f"{PACKAGE}/farm/run.py",  # Dask's: each task is a process
    }
    without = []
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            named = {k.arg: k.value for k in node.keywords}
            work = {"Thread": named.get("target"), "submit": node.args[0] if node.args else None}.get(called)
            if work is not None and not (isinstance(work, ast.Call) and getattr(work.func, "id", "") == "in_context"):
                without.append(str(path.relative_to(ROOT)))
            assert not (called.startswith("query") and "workers" in named), path
    assert set(without) <= apart


def test_kernels_are_compiled_in_one_way() -> None:
    """``base/kernels/compiled`` says why: numba's own files of two processes mix."""
    sources = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in sorted((ROOT / PACKAGE).rglob("*.py"))}
    own = [
        name for name, text in sources.items() if re.search(r"from numba import .*\bjit|from numba import .*njit", text)
    ]
    assert own == []


def test_pictures_are_decoded_in_one_place() -> None:
    """``base/pictures/decoding`` says why: what it has not looked at never reaches a decoder. Plates have theirs, ``base/plates``,
    where the header is looked at first. Movies are written, never read."""
    decoders = (
        r"\bim(?:read|decode)(?:multi|animation|count)?\b|VideoCapture|Image\.open|ImageFile|InputFile|imageio|skimage\.io|"
        r"ImageInput|torchvision|\bcv2\.dnn\b|av\.open\([^)]*[\"']r[\"']|jpeg_decode|optflow.*read|FileStorage|\bimport_module\(.cv2"
    )
    sources = [p for package in (PACKAGE, "blender_addon") for p in sorted((ROOT / package).rglob("*.py"))]
    using = {str(p.relative_to(ROOT)) for p in sources if re.search(decoders, p.read_text(encoding="utf-8"))}
    assert using == {f"{PACKAGE}/base/pictures/decoding.py", f"{PACKAGE}/base/plates/dpx.py"}


def test_nobody_waits_for_pytorch_before_the_reconstruction() -> None:
    """Two seconds of each process, which the status of a workspace, an import and a choice do not need."""
    early = ["run", "status", *(f"steps.{name}" for name in ("import_", "objects", "segment", "choose"))]
    lines = "; ".join(f"import {PACKAGE}.pipeline.{name}" for name in early)
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {lines}; print('torch' in sys.modules)"], capture_output=True
    )
    assert done.stdout.decode().strip() == "False", done.stderr.decode()

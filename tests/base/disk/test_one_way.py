"""Files of drives and workspaces are opened in one way alone: what opens others is listed here with the reason."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from docs.generate import ROOT

RAW = {
    "builtins": {"open"},
    "methods": {"open", "read_text", "read_bytes", "fromfile", "memmap", "genfromtxt", "loadtxt"},
    "functions": {
        "np.load",
        "os.open",
        "json.load",
        "cv2.imread",
        "shutil.copy",
        "shutil.copy2",
        "shutil.copyfile",
        "zipfile.ZipFile",
        "ZipFile",
        "ElementTree.parse",
        "torch.load",
        "jit.load",
    },
}
STREAMS = {"av.open", "np.fromfile", "np.load", "np.loadtxt", "zipfile.ZipFile"}
"""Also take what is open already, by one of these names."""
OPEN = {"stream", "file", "packed", "arrow", "texts"}
OURS = {"Workspace.open", "Folder.open", "gzip.open", "archive.open", "packed.open", "ipc.open_file"}
"""Are called so and open no path: parts of an archive that is open, and our own."""
ALLOWED = {
    "unveil_core/base/disk/open_safely.py": "the one way",
    "unveil_core/base/disk/new_files.py": "makes new files",
    "unveil_core/app/cli.py": "the system's null device",
    "unveil_core/base/networks/child.py": "the system's null device",
    "unveil_core/app/doctor.py": "tells the machine",
    "blender_addon/formats/splat_files/splat_facts.py": "arrays of what was read whole before",
    "unveil_core/bench/timing.py": "tells the machine",
    "unveil_core/forecast/machine.py": "tells the machine",
    "unveil_core/forecast/costs.py": "the program's own",
    "unveil_core/report/page.py": "the program's own",
    "unveil_core/checkup/page.py": "the program's own",
    "unveil_core/pipeline/source_digest.py": "the program's own",
    "unveil_core/raster/cpu/block.py": "the program's own",
    "unveil_core/base/kernels/compiled.py": "the program's own",
    "unveil_core/base/disk/lock.py": "the workspace's folder, which is locked",
    "unveil_core/evaluate/perceptual.py": "a network that the user names, looked at before",
    "unveil_core/base/output/single_files.py": "was just made",
    "unveil_core/exports/whole.py": "was just made",
    "unveil_core/exports/dataset/layout.py": "copies what was just delivered",
    "unveil_core/exports/dataset/linked_tree.py": "copies where no link can be made",
    "unveil_core/base/plates/dpx.py": "OpenImageIO opens plates itself, after they were looked at",
    "unveil_core/base/plates/plate.py": "was just made",
    "unveil_core/marking/page.py": "the program's own",
    "unveil_core/solve/page.py": "the program's own",
    "unveil_core/solve/mapping/child.py": "the system's null device, and a data base that was just made",
    "blender_addon/formats/table/run_settings.py": "the program's own",
    "unveil_core/exports/cameras/colmap.py": "writes into a folder that was just made",
    "unveil_core/exports/plates/movie.py": "writes into a folder that was just made",
    "unveil_core/report/video.py": "was just made",
    "blender_addon/formats/open_safely.py": "the one way",
    "blender_addon/formats/files.py": "makes new files",
    "blender_addon/worker/workspace_state.py": "the workspace's folder, which is locked",
    "blender_addon/worker/interpreter.py": "the program's own",
    "blender_addon/worker/base_python.py": "the program's own",
    "blender_addon/worker/environment.py": "the program's own",
}


def opened(path: Path) -> set[str]:
    """The calls in a module that open a file by its path in a way of their own."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        short = ".".join(name.split(".")[-2:])
        last = name.rsplit(".", 1)[-1]
        raw = (
            name in RAW["builtins"]
            or short in RAW["functions"]
            or ("." in name and last in RAW["methods"] and short not in OURS)
        )
        first = ast.unparse(node.args[0]) if node.args else ""
        if raw and not (short in STREAMS and first in OPEN):
            found.add(short)
    return found


MODULES = [p for place in ("unveil_core", "blender_addon") for p in sorted((ROOT / place).rglob("*.py"))]


def test_files_are_opened_in_one_way() -> None:
    found = {p.relative_to(ROOT).as_posix(): calls for p in MODULES if (calls := opened(p))}
    assert {name: calls for name, calls in found.items() if name not in ALLOWED} == {}
    assert sorted(set(ALLOWED) - set(found)) == [], "they are no exceptions any more"


@pytest.mark.parametrize(
    "line",
    [
        "open(p)",
        "p.open('rb')",
        "p.read_text()",
        "np.load(p)",
        "zipfile.ZipFile(p)",
        "numpy.fromfile(p)",
        "os.open(p, 0)",
    ],
)
def test_other_ways_are_seen(line: str, tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(line)
    assert opened(tmp_path / "a.py")

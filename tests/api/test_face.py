"""The public face: light, listed, and typed from outside."""

from __future__ import annotations

import ast
import subprocess
import sys

import unveil_core
from docs.generate import ROOT


def test_importing_it_is_light() -> None:
    heavy = {"torch", "numba", "cv2", "scipy", "onnxruntime", "numpy"}
    program = f"import sys, unveil_core; dir(unveil_core); print(sorted({heavy} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_runs_and_workspaces_do_without_pytorch() -> None:
    program = (
        "import sys, unveil_core as u; u.run, u.Workspace, u.open_drive, u.RunSettings; print('torch' in sys.modules)"
    )
    out = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "False"


def test_names_are_listed_and_type_checkers_know_them() -> None:
    assert set(unveil_core.__all__) <= set(dir(unveil_core))
    stub = ast.parse((ROOT / "unveil_core/__init__.pyi").read_text(encoding="utf-8"))
    told = {
        alias.asname: f"{node.module}.{alias.name}"
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    own = {name: f"unveil_core.{home}.{name}" for name, home in unveil_core._HOMES.items()}
    assert told == own and (ROOT / "unveil_core/py.typed").is_file()

"""Types of the public face, as a stranger's script sees them: ``mypy --strict`` knows what is right and what is wrong."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from docs.generate import ROOT

SCRIPT = """
import numpy as np
import unveil_core as unveil

workspace = unveil.run("street", "out", remove=["vehicle"], quality="draft", shadows=(135.0, 40.0), frames=slice(0, 8))
near = workspace.objects.filter(lambda o: o.cls == "car" and o.distance is not None and o.distance < 20)
settings: unveil.RunSettings = near.select()
for frame in workspace.frames("front"):
    photo = frame.photo()
    mask: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = frame.mask("removed")
    rgb, depth = workspace.scene("empty").render(frame.camera.moved(right=1.5), ("rgb", "depth"))
    one = workspace.scene("full").render(frame.camera)
    print(photo.shape, rgb.shape, one.shape, frame.distortion)
files = workspace.export("glb", "out.glb")
print(files[0].name, workspace.scene("full").surfels.means.shape)
"""
WRONG = {
    'unveil.run("street", "out", quality="best")': "best",
    'unveil.run("street", "out", qualty="draft")': "qualty",
    'unveil.Workspace.open("out").frames(3)': "frames",
    'unveil.Workspace.open("out").scene("half")': "scene",
}


def test_types_from_outside(tmp_path: Path) -> None:
    """``mypy --strict`` of a script that knows the package as it is installed; what is wrong is seen."""
    (tmp_path / "good.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text("import unveil_core as unveil\n\n" + "\n".join(WRONG) + "\n")
    (tmp_path / "mypy.ini").write_text(f"[mypy]\nmypy_path = {ROOT}\n[mypy-unveil_core.*]\nfollow_imports = silent\n")
    command = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--ignore-missing-imports",
        "--cache-dir",
        str(tmp_path / "cache"),
    ]
    for name, expected in (("good.py", 0), ("wrong.py", len(WRONG))):
        done = subprocess.run([*command, name], cwd=tmp_path, capture_output=True, text=True)
        errors = [line for line in done.stdout.splitlines() if ": error:" in line]
        assert len(errors) == expected and all(line.startswith(name) for line in errors), done.stdout + done.stderr
        if expected:
            assert all(any(word in line for line in errors) for word in WRONG.values()), done.stdout

"""The workspace of these tests with other cameras: names, lenses, rigs, without making it anew."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.exports.conftest import Street
from unveil_core.exports.job import Job
from unveil_core.workspace.workspace import Workspace

__all__ = ["BROWN", "FISHEYE", "RATIONAL", "variant"]

Entry = dict[str, Any]

BROWN = {"model": "OPENCV", "coefficients": [-0.2, 0.05, 0.001, -0.002, -0.01, 0.0, 0.0, 0.0]}
RATIONAL = {"model": "OPENCV", "coefficients": [0.3, 0.05, 0.001, -0.002, 0.01, 0.5, 0.08, 0.02]}
FISHEYE = {"model": "OPENCV_FISHEYE", "coefficients": [0.05, -0.01, 0.002, -0.0005]}


def variant(street: Street, root: Path, edit: Callable[[int, Entry], None]) -> Job:
    """A copy of the workspace whose frames ``edit`` has changed: their camera, name, or footage. Delivered frames follow the names.

    Args:
        edit: called with the number and the entry of each frame in cameras.json.
    """
    shutil.copytree(street.root, root)
    path = root / "drive/cameras.json"
    data = json.loads(path.read_text())
    shutil.move(root / "frames", root / "before")
    for number, entry in enumerate(data["frames"]):
        source = root / "before" / entry["camera"] / f"{entry['name']}.png"
        edit(number, entry)
        target = root / "frames" / entry["camera"] / f"{entry['name']}.png"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)
    path.write_text(json.dumps(data))
    shutil.rmtree(root / "before")
    return Job(Workspace.open(root))

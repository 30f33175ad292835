"""Unveil: the empty street from a drive.

The public face, loaded when first used so that the command line starts at once:

    import unveil_core as unveil
    workspace = unveil.run("drive", "workspace", remove=["vehicle"], quality="draft")

docs/python.md shows the rest.
"""

from __future__ import annotations

import os
import sys

# While Python looks for the module of `python -m unveil_core`, it has put the working folder first on the path: a torch.py beside
# a drive must not be taken for torch. The name in argv says so, and stands there no longer than that.
if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    try:
        if sys.path[:1] == [os.getcwd()]:
            del sys.path[0]
    except OSError:  # a folder that is gone: Python has not put it there
        pass

from importlib import import_module
from typing import Any

from unveil_core.base.surroundings.guarded_imports import guard_imports

guard_imports()

# On a busy machine spinning OpenMP threads double the time of a training step. It has to be set before torch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
# The most pixels of a picture, beside base/pictures/decoding.py's own check. It has to be set before cv2 is imported.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))

__version__ = "0.1.0"

_HOMES = {
    "Camera": "geometry.camera",
    "Drive": "drives.drive",
    "DriveOptions": "base.drive_options",
    "FrameView": "api.frames",
    "ObjectList": "api.objects",
    "RunSettings": "pipeline.settings",
    "Scene": "api.scenes",
    "StreetObject": "api.objects",
    "Surfels": "surfels.surfels",
    "UnveilError": "base.errors",
    "Workspace": "api.workspace",
    "open_drive": "drives",
    "render": "raster",
    "run": "api.workspace",
}
__all__ = list(_HOMES)  # __init__.pyi has them for type checkers


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"unveil_core.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*_HOMES, "__version__"]

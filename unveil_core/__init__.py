"""Unveil: the empty street from a drive.

The public face, loaded when first used so that the command line starts at once:

    import unveil_core as unveil
    workspace = unveil.run("drive", "workspace", remove=["vehicle"], quality="draft")

docs/python.md shows the rest. Importing it changes nothing of the program that does.
"""

from __future__ import annotations

from importlib import import_module

# Nothing else is imported here: `python -m unveil_core` comes by while the working folder is still on the path (see __main__).

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


def __getattr__(name: str) -> object:
    if name in _HOMES:
        return getattr(import_module(f"unveil_core.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*_HOMES, "__version__"]

"""All readers, and which of them reads a given path. A new format is a module beside this one and a line here."""

from __future__ import annotations

from pathlib import Path

from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.colmap import find_model, read_colmap
from unveil_core.drives.formats.transforms_json import read_transforms_json
from unveil_core.drives.imported import read_imported

__all__ = ["open_drive"]


def open_drive(path: str | Path) -> Drive:
    """Read a drive from a transforms.json or its folder, a COLMAP folder, or the drive/ folder of a workspace.

    Raises:
        DriveError: it is none of these, or cannot be read.
    """
    path = Path(path)
    if not path.exists():
        raise DriveError("there is no such drive", path=path, mend="check the path")
    if path.is_file():
        if path.suffix.lower() != ".json":
            raise DriveError("is no drive", path=path, mend="give a transforms.json or a folder")
        return read_transforms_json(path)
    if (path / "transforms.json").is_file():
        return read_transforms_json(path)
    if (path / "cameras.json").is_file():
        return read_imported(path)
    if find_model(path) is not None:
        return read_colmap(path)
    raise DriveError("holds no drive", path=path, mend="transforms.json or a COLMAP model in sparse/0 is looked for")

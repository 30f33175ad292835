"""Where results may be written: never in a drive, nor in a folder that holds one, whatever the verb.

What is there of the program's own may be written again (see :mod:`unveil_core.base.output.written`); this is about places in which
nothing is to be written at all, and is asked before anything is.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from unveil_core.base.errors import SettingsError
from unveil_core.base.output.written import DRIVE, EXPORTED, RECORD, record_of
from unveil_core.drives.formats.registry import drive_at
from unveil_core.pipeline.graph import STAGES
from unveil_core.workspace.workspace import Workspace, is_workspace

__all__ = ["check_file_place", "check_folder_place", "check_place", "drives_of"]

DEEPEST = 3
"""Levels of folders below an output folder in which drives are looked for: projects keep them in one or two."""
MOST_FOLDERS = 1000
"""Folders that are looked into for them, at most: a quarter of a second."""
MEND = "name a folder beside it with -o"
AROUND, MODELS = "colmap", ("sparse", "images.txt", "images.bin")
"""A COLMAP model is looked for in a folder of this name, too: one that was exported makes no drive of the folder around it, unless
that has a model of its own in one of these places."""
OF_STAGES = {Path(name).parts[0] for stage in STAGES for name in stage.outputs}
"""Folders and files of a workspace that stages write: what lies there is taken away when they run again."""


def check_place(output: Path, drives: Iterable[Path] = (), *, again: bool = False) -> None:
    """Check a folder for a workspace, or for anything else; it need not be there yet.

    Args:
        output: the folder.
        drives: of the command: the one that it reads, or that its workspace was made from.
        again: whether it may be a drive that this program wrote there.
    Raises:
        SettingsError: it is, holds, or lies in a drive, or is the home folder or one that holds it; with the folder.
    """
    target, drives = _resolved(output), list(drives)
    if target.parent == target or _holds_home(target):
        what = (
            "Not for results: the root of a disk"
            if target.parent == target
            else "Not for results: the home folder, or one that holds it"
        )
        raise SettingsError(what, path=output, mend="name a folder of its own with -o")
    if output.is_symlink() and not output.exists():
        raise SettingsError(
            "Not for results: a link to nothing", path=output, mend="remove the link, or name another folder with -o"
        )
    _check_not_within(target, output, drives, again=again)
    for drive in map(_folder_of, drives):
        if drive.is_relative_to(target):
            raise SettingsError(f"Not for results: it holds the drive {drive}", path=output, mend=MEND)
    written = is_workspace(target) or (again and _is_own_drive(target))
    if target.is_dir() and not written and (found := _drive_in(target)) is not None:
        raise SettingsError(f"Not for results: it holds the drive {found}", path=output, mend=MEND)


def check_folder_place(output: Path, drives: Iterable[Path] = (), *, again: bool = False) -> None:
    """Check a folder for results beside a workspace's own.

    Args:
        output, drives, again: see :func:`check_place`.
    Raises:
        SettingsError: see :func:`check_place`; or it is a file, a workspace, or a folder that stages write.
    """
    if output.exists() and not output.is_dir():
        raise SettingsError("Not a folder", path=output, mend="name a folder")
    target = _resolved(output)
    if is_workspace(target):
        raise SettingsError("Not for results: the workspace's own folder", path=output, mend="name another one")
    _check_not_of_stages(target, output)
    check_place(output, drives, again=again)


def check_file_place(output: Path, drives: Iterable[Path] = ()) -> None:
    """Check a place for a single file: it may lie beside a drive, or in a workspace, but not in the folders of either.

    Raises:
        SettingsError: it lies in a drive, where stages write, in a file, or directly on a disk.
    """
    folder = _resolved(output.parent)
    if folder.parent == folder:
        raise SettingsError("Not for results: the root of a disk", path=output, mend="name a file in a folder")
    above = next(p for p in (folder, *folder.parents) if p.exists())
    if not above.is_dir():
        raise SettingsError("Not a folder", path=above, mend="name a file in a folder")
    _check_not_of_stages(folder, output)
    _check_not_within(folder, output, drives)


def drives_of(workspace: Workspace) -> list[Path]:
    """The drive that a workspace was made from, where it says so."""
    recorded = workspace.state().get("drive")
    return [Path(recorded)] if isinstance(recorded, str) and Path(recorded).is_absolute() else []


def _check_not_of_stages(target: Path, output: Path) -> None:
    for root in (p for p in target.parents if is_workspace(p)):
        if target.relative_to(root).parts[0] in OF_STAGES:
            raise SettingsError("Not for results: the workspace's own folder", path=output, mend="name another one")


def _check_not_within(target: Path, output: Path, drives: Iterable[Path], *, again: bool = False) -> None:
    named = {folder for folder in map(_folder_of, drives) if folder.parent != folder}
    for folder in (target, *target.parents):
        if folder in named or (_is_drive(folder) and not (again and folder == target and _is_own_drive(folder))):
            what = (
                "Not for results: a drive"
                if folder == target and output.name
                else f"Not for results: it lies in the drive {folder}"
            )
            raise SettingsError(what, path=output, mend=MEND)


def _is_drive(folder: Path) -> bool:
    """Whether a folder is somebody's drive, or a workspace's: not what this program rendered or exported in such a layout."""
    kind = drive_at(folder)
    if kind is None:
        return False
    if _is_own_drive(folder):
        return True
    if record_of(folder / RECORD) is not None or record_of(folder / EXPORTED) is not None:
        return False
    made = record_of(folder / AROUND / EXPORTED) is not None
    return not (kind.name == "COLMAP" and made and not any((folder / name).exists() for name in MODELS))


def _is_own_drive(folder: Path) -> bool:
    """Whether this program made the folder as a drive, of footage or of a shot."""
    return (record_of(folder / RECORD) or {}).get(DRIVE) is True


def _drive_in(folder: Path) -> Path | None:
    """A drive below a folder; None where there is none near. Not looked into are
    links, and folders of this program's own, which may hold copies of drives."""
    waiting, left = deque([(folder, 0)]), MOST_FOLDERS
    while waiting:
        place, depth = waiting.popleft()
        with suppress(OSError), os.scandir(place) as entries:
            for name in sorted(e.name for e in entries if e.is_dir(follow_symlinks=False) and e.name[0] != "."):
                below, left = place / name, left - 1
                if left < 0:
                    return None
                if is_workspace(below) or any(record_of(below / name) is not None for name in (RECORD, EXPORTED)):
                    continue
                if _is_drive(below):
                    return below
                if depth + 1 < DEEPEST:
                    waiting.append((below, depth + 1))
    return None


def _resolved(path: Path) -> Path:
    """Without links; of what cannot be followed, as it is named."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path.absolute()


def _folder_of(drive: Path) -> Path:
    """A drive's folder: of a file, as of a transforms.json, the one that it lies in."""
    found = _resolved(drive)
    return found.parent if found.is_file() else found


def _holds_home(folder: Path) -> bool:
    with suppress(RuntimeError, OSError):  # there is none
        return _resolved(Path.home()).is_relative_to(folder)
    return False

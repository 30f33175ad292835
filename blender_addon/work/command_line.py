# SPDX-License-Identifier: GPL-3.0-or-later
"""``blender --background [FILE.blend] --command unveil VERB ARGUMENTS [--save OUT.blend]``

Every verb and option of ``unveil``, with its output and its exit codes (0 done, 1 failed, 2 bad input or usage, 130
cancelled). With ``--save``, what ``run`` and ``import`` have made is loaded into the scene, which is then saved; with
``--save-cameras FILE.abc``, ``.usd`` or ``.fbx``, its cameras are written by Blender's own exporters. A file that is there
already is written over only if this command saved it and nobody changed it since, or with ``--replace``. The verb ``shot``
makes a drive of a camera that Blender reads, see :mod:`shot_command`.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from ..formats.drive_files import read_drive
from ..formats.files import one_line, shown
from ..formats.object_files import recorded_drive
from ..scene import blocks, camera_files, drive_scene
from ..scene.shot.camera import ShotError
from ..worker.jobs import WINDOWS, unveil_command, worker_environment
from ..worker.receipts import is_somebodys, note_saved
from ..worker.session import interrupts
from .loading import load
from .preferences import unveil_interpreter
from .shot_command import make_drive

__all__ = ["main"]

LOADED = ("run", "import")
"""Verbs whose results ``--save`` loads."""
_handle: Any = None


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> Any:
        raise ValueError(message)


def main(arguments: list[str]) -> int:
    """Run the command; returns the exit code."""
    if arguments[:1] == ["shot"]:
        try:
            print(make_drive(arguments[1:]))
        except ShotError as error:
            return _refuse(str(error))
        return 0
    parser = _Parser(add_help=False, allow_abbrev=False)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--save-cameras", type=Path)
    folders = _Parser(add_help=False)
    folders.add_argument("-o", "--output", type=Path)
    try:
        given, rest = parser.parse_known_args(arguments)
        workspace = folders.parse_known_args(rest)[0].output
    except ValueError as error:
        return _refuse(str(error))
    save, cameras = (path and path.absolute() for path in (given.save, given.save_cameras))
    wanted = save or cameras
    if wanted and (rest[:1] == [] or rest[0] not in LOADED or workspace is None):
        name = "--save" if save else "--save-cameras"
        return _refuse(f"{name} goes with the verbs run and import, and -o WORKSPACE")
    if cameras and cameras.suffix.lower() not in camera_files.KINDS:
        return _refuse(f"{cameras}: Not a file of cameras (use {', '.join(camera_files.KINDS)})")
    for path in (*([save] if save else ()), *(camera_files.files_of(cameras) if cameras else ())):
        if "--replace" not in rest and _is_somebodys(workspace.absolute(), path):
            return _refuse(f"{path}: is there already, and was not saved by this command (move it, or add --replace)")
    found = unveil_interpreter(bpy.context)
    if found is None or not found.ok:
        return _refuse(found.problem if found else "no Python with unveil was found (set UNVEIL_PYTHON to one)", 1)
    code = _run(unveil_command(found.python, rest))
    if code == 0 and wanted:
        return _load_and_save(workspace.absolute(), save, cameras)
    return code


def _run(command: list[str]) -> int:
    """The command's exit code; what it says goes where this process's output goes."""
    sys.stdout.flush()
    try:
        # The pipe is the worker's standard input: it ends when this process ends, however that comes.
        process = subprocess.Popen(command, env=worker_environment(), stdin=subprocess.PIPE)
    except OSError as error:
        return _refuse(f"{command[0]}: cannot be started: {error.strerror}", 1)
    interrupt = signal.CTRL_C_EVENT if WINDOWS else signal.SIGINT  # type: ignore[attr-defined]
    with process, interrupts(lambda: process.send_signal(interrupt)):
        code = process.wait()
    if code < 0:
        return _refuse(f"the worker was ended by signal {-code} (run the same command again to go on)", 1)
    return code


def _load_and_save(workspace: Path, save: Path | None, cameras: Path | None = None) -> int:
    context = bpy.context
    if not bpy.data.filepath:  # no file was named: the new file's cube and lamp would stand in the street
        bpy.data.batch_remove(list(bpy.data.objects))
    try:
        source = recorded_drive(workspace)
        context.scene.unveil.drive, context.scene.unveil.workspace = str(Path(source).absolute()), str(workspace)
        load(context, workspace)
    except (OSError, ValueError) as error:
        return _refuse(one_line(error, workspace), 1)
    for path, write in ((cameras, partial(_write_cameras, workspace)), (save, _save)):
        if path is None:
            continue
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)
            for made in (path,) if path == save else camera_files.files_of(path):
                note_saved(workspace, made)
        except (OSError, RuntimeError) as error:
            return _refuse(f"{path}: cannot be saved: {one_line(error, path)}", 1)
        print(path)
    return 0


def _is_somebodys(workspace: Path, path: Path) -> bool:
    """Whether a place is not to be written: the file that is open was named to be worked in."""
    is_open = bool(bpy.data.filepath) and os.path.realpath(bpy.data.filepath) == os.path.realpath(path)
    return not is_open and is_somebodys(workspace, path)


def _save(path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), check_existing=False)


def _write_cameras(workspace: Path, path: Path) -> None:
    drive = read_drive(workspace, drive_scene.metre_of(bpy.context.scene))
    collection = blocks.drive_collection(bpy.context.scene, str(drive.workspace.resolve()))
    assert collection is not None  # it was loaded
    camera_files.write_cameras(bpy.context, collection, drive, path)


def _refuse(problem: str, code: int = 2) -> int:
    print(f"unveil: {'error' if code == 2 else 'failed'}: {shown(problem)}", file=sys.stderr)
    return code


def register() -> None:
    global _handle
    _handle = bpy.utils.register_cli_command("unveil", main)


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handle)

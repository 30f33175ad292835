"""Readers of the add-on, which know nothing of the program: text and binary files of a workspace, and the lines of a job."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from blender_addon.formats.drive_files import read_drive
from blender_addon.formats.files import one_line
from blender_addon.formats.gaussians import gaussians_of
from blender_addon.formats.ply_file import read_ply
from blender_addon.formats.sequences import REGION_COLORS, with_palette
from blender_addon.worker import workspace_state
from blender_addon.worker.job_state import JobState
from tests.fuzz.reader import Opened, Reader, Wrong
from tests.fuzz.readers_binary import mesh_file, points_file, surfels_file
from tests.fuzz.readers_workspace_text import READERS as OF_WORKSPACES
from tests.fuzz.readers_workspace_text import state_of_a_run, written
from unveil_core.base.files import write_image_atomic

__all__ = ["READERS"]

REFUSED = (OSError, ValueError)
"""What the add-on's readers may raise; operators show it as one line."""
EVENTS = (
    {
        "t": 1.5,
        "stage": "mesh",
        "done": 3,
        "total": 9,
        "message": "fusing",
        "level": "info",
        "loss": 0.5,
        "left_s": 60.0,
    },
    {"t": 2.5, "stage": "mesh", "done": 9, "total": 9, "message": "done", "level": "info", "seconds": 3},
    {"t": 3.5, "stage": "report", "message": "no room", "level": "error", "traceback": "a\nb"},
)


def _line(error: Exception) -> str:
    return one_line(error, "the workspace")


def _drive(folder: Path) -> Opened:
    prepare = next(r.prepare for r in OF_WORKSPACES if r.name == "cameras.json")
    path = prepare(folder).files[0]

    def read(_: Path) -> None:
        drive = read_drive(folder)
        for name, frames in drive.tracks.items():
            for frame in frames:
                lens = frame.lens
                if not np.isfinite([lens.focal_mm, lens.shift_x, lens.shift_y, *lens.aspect]).all():
                    raise Wrong("a lens that is not finite is taken")
                if not np.isfinite(frame.camera_to_scene).all():
                    raise Wrong("a pose that is not finite is taken")
                if any(".." in p.parts or not p.is_relative_to(folder) for p in (frame.image, frame.footage)):
                    raise Wrong("a file outside the workspace is taken")
                if "/" in name or "/" in frame.name or ".." in (name, frame.name):
                    raise Wrong("a name that is no file's is taken")
        if not np.isfinite(drive.to_drive(np.ones((2, 3)))).all():
            raise Wrong("a way to the drive that is none is taken")
        if not np.isfinite(drive.from_drive(np.ones((2, 3)))).all():
            raise Wrong("a way from the drive that is none is taken")

    return Opened((path,), read)


def _state(folder: Path) -> Opened:
    path = written(folder / "workspace.json", state_of_a_run())
    chosen = written(folder / "selection.json", {"removed": ["car"], "instances": [3]})
    log = folder / "events.jsonl"
    log.write_text("".join(json.dumps({**e, "stage": "remove"}) + "\n" for e in EVENTS))

    def read(_: Path) -> None:
        found = workspace_state.read(folder, {"remove": ["car"], "instances": [], "seed": 1})
        for stage in found.stages.values():
            if not isinstance(stage.message, str) or not isinstance(stage.state, str):
                raise Wrong("a state that is no text is shown")
            if stage.seconds is not None and not (
                isinstance(stage.seconds, int | float) and math.isfinite(stage.seconds)
            ):
                raise Wrong("a time that is no finite number is shown")

    return Opened((path, chosen, log), read)


def _events(folder: Path) -> Opened:
    folder.mkdir(parents=True)
    path = folder / "output.txt"
    path.write_text("unveil 1\n" + "".join(json.dumps(e) + "\n" for e in EVENTS) + "unveil: error: no room\n")

    def read(file: Path) -> None:
        job = JobState(planned=("mesh", "report"))
        for line in file.read_bytes().decode("utf-8", "replace").splitlines(keepends=True):
            job.read(line)
            left = job.seconds_left()
            if not 0 <= job.fraction <= 1 or (left is not None and not 0 <= left < math.inf):
                raise Wrong("a progress that is none is shown")
        job.end(2)

    return Opened((path,), read)


def _ply(folder: Path) -> Opened:
    files = (points_file(folder), surfels_file(folder), mesh_file(folder))

    def read(file: Path) -> None:
        found = read_ply(file)
        if not np.isfinite(found.positions).all():
            raise Wrong("a vertex that is not finite is taken")
        if len(found.triangles) and not 0 <= found.triangles.min() <= found.triangles.max() < len(found.vertices):
            raise Wrong("a triangle of a vertex that is not there is taken")
        _ = found.colors
        if file == files[1]:
            gaussians = gaussians_of(found, 1.0, np.arange(len(found.vertices)))
            if not all(np.isfinite(v).all() for v in vars(gaussians).values()):
                raise Wrong("a Gaussian that is not finite is taken")

    return Opened(files, read)


def _palette(folder: Path) -> Opened:
    path = folder / "regions.png"
    write_image_atomic(path, np.arange(48, dtype=np.uint8).reshape(6, 8) % 4)
    return Opened((path,), lambda p: with_palette(p.read_bytes(), REGION_COLORS))


READERS = (
    Reader("add-on: cameras.json", "text", _drive, REFUSED, _line),
    Reader("add-on: states of stages", "text", _state, REFUSED, _line),
    Reader("add-on: lines of a job", "text", _events, REFUSED, _line),
    Reader("add-on: PLY", "binary", _ply, REFUSED, _line),
    Reader("add-on: pictures of regions", "binary", _palette, REFUSED, _line),
)

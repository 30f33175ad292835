"""The drive on disk, its facts and its page."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.output.written import GENERATOR
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.solve.drive_files import write_drive
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import FootageFrame, Reel
from unveil_core.solve.mapping.model import FISHEYES, Model
from unveil_core.solve.mapping.turning import told_of_focal
from unveil_core.solve.page import solve_page
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.stages.fill import Found
from unveil_core.solve.stages.look import Looked
from unveil_core.solve.stages.mapping import known_focal, lens_of

__all__ = ["RECORD", "finish"]

RECORD = "solve.json"
"""What a solve found, in the drive's folder: the program's mark on it, too."""


def finish(
    model: Model,
    found: Found,
    reels: Sequence[Reel],
    looked: Looked,
    output: Path,
    settings: SolveSettings,
    events: Events,
    made_from: str,
    seconds: float,
) -> dict[str, Any]:
    frames = [f for r in reels for f in r.frames]
    labels = _kept(looked.labels, output, "semantics")
    masks = _kept(looked.masks, output, "masks")
    write_drive(output, found.model, reels, found.points, sure_of_metres=found.placed.known, labels=labels, masks=masks)
    for reel in reels:
        _tell_of_focal(model, reel, settings, events)
    placed_frames = set(found.model.names)
    errors = found.model.frame_errors()
    way = float(np.linalg.norm(np.diff(found.model.centres, axis=0), axis=1).sum()) if len(reels) == 1 else None
    facts: dict[str, Any] = {
        "generator": GENERATOR,
        "state": "done",
        "made_from": made_from,
        "footage": [r.source for r in reels],
        "frames": len(frames),
        "placed": sum(f.file in placed_frames for f in frames),
        "solved": int(np.isfinite(errors).sum()),
        "standing": looked.facts["standing"],
        "blurred": looked.facts["blurred"],
        "error_px": round(float(np.sqrt(np.nanmean(errors**2))), 3),
        "points": len(found.points.positions),
        "lens": {r.camera: _lens_facts(found.model, r, settings) for r in reels if lens_of(found.model, r) is not None},
        "scale": found.placed.told,
        "scale_known": found.placed.known,
        "up": found.placed.up_source,
        "camera_height_m": None if found.placed.height_m is None else round(found.placed.height_m, 3),
        "way_m": None if way is None else round(way, 2),
        "seconds": round(seconds, 1),
        "notices": events.notices,
    }
    level = "notice" if found.placed.known else "warning"
    events.notice("write", f"scale: {found.placed.told}", level)
    page = solve_page(found.model, reels, found.points, facts, output / "images")
    write_bytes_atomic(output / "solve.html", page.encode("utf-8", "replace"))
    write_json_atomic(output / RECORD, facts)
    events.end("write")
    return facts


def _tell_of_focal(model: Model, reel: Reel, settings: SolveSettings, events: Events) -> None:
    """Say it where a focal length is not known, and the pictures hardly tell it."""
    number = lens_of(model, reel)
    if number is None or known_focal(reel, settings)[0] is not None:
        return
    own = {f.file for f in reel.frames}
    pictures = [int(i) for i in np.unique(model.seen_by) if model.names[i] in own]
    if (line := told_of_focal(model, pictures, model.lenses[number].focal_px)) is not None:
        events.notice("map", line, "warning")


def _lens_facts(model: Model, reel: Reel, settings: SolveSettings) -> dict[str, Any]:
    number = lens_of(model, reel)
    assert number is not None
    lens = model.lenses[number]
    focal, source = known_focal(reel, settings)
    return {
        "model": lens.model,
        "focal_px": round(lens.focal_px, 2),
        "focal_known_by": source if focal is not None else "",
        "field_of_view_deg": round(float(np.degrees(2 * np.arctan(lens.width / 2 / lens.pinhole[0]))), 1)
        if lens.model not in FISHEYES
        else None,
        "parameters": [round(p, 6) for p in lens.parameters],
    }


def _kept(pictures: dict[FootageFrame, Path], output: Path, folder: str) -> dict[FootageFrame, str]:
    """Copies of pictures of frames in the drive, by frame, relative to it."""
    found = {}
    for frame, source in pictures.items():
        target = (output / folder / frame.file).with_suffix(".png")
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.resolve() != target.resolve():
            read_label_image(source)  # whatever is no picture is told here, with its name
            shutil.copyfile(source, target)
        found[frame] = target.relative_to(output).as_posix()
    return found

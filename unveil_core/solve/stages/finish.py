"""The drive on disk, its facts and its page."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.files import write_bytes_atomic, write_json_atomic
from unveil_core.base.output.copies import copied
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.output.written import GENERATOR, files_in
from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.drives.checks.solved import SOLVED
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

__all__ = ["PAGE", "RECORD", "finish"]

RECORD, PAGE = SOLVED, "solve.html"
"""What a solve found, in the drive's folder, for programs and for people."""
PICTURES = ("semantics", "masks")
"""Folders of what came with the frames: who mends a picture there keeps it."""


def finish(
    model: Model,
    found: Found,
    reels: Sequence[Reel],
    looked: Looked,
    images: Path,
    own: OwnFolder,
    settings: SolveSettings,
    events: Events,
    made_from: dict[str, Any],
    seconds: float,
    rights: int,
) -> dict[str, Any]:
    """Write all but the frames among the new files, and put these and the frames in their places.

    Args:
        images: where the frames are; made_from: what tells later of what the drive was solved; rights: of the footage.
    Returns:
        what ``solve.json`` holds.
    Raises:
        SettingsError: a file that somebody changed would be replaced.
    """
    frames = [f for r in reels for f in r.frames]
    for left in own.new.iterdir():  # by an attempt that was ended here
        if left != images:
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    mended = {n for n in own.changed() if n.split("/")[0] in PICTURES}
    labels = _kept(looked.labels, own, PICTURES[0], mended)
    masks = _kept(looked.masks, own, PICTURES[1], mended)
    if mended:
        events.notice(
            "write", f"{len(mended)} pictures of labels or masks were changed since, and stay: {min(mended)} the first"
        )
    write_drive(
        own.new, found.model, reels, found.points, sure_of_metres=found.placed.known, labels=labels, masks=masks
    )
    for reel in reels:
        _tell_of_focal(model, reel, settings, events)
    placed_frames = set(found.model.names)
    errors = found.model.frame_errors()
    way = float(np.linalg.norm(np.diff(found.model.centres, axis=0), axis=1).sum()) if len(reels) == 1 else None
    facts: dict[str, Any] = {
        "generator": GENERATOR,
        "state": "done",
        **made_from,
        "footage": [Path(r.source).name for r in reels],
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
    page = solve_page(found.model, reels, found.points, facts, images)
    write_bytes_atomic(own.new / PAGE, page.encode("utf-8", "replace"))
    write_json_atomic(own.new / RECORD, facts)
    stay = {f"{images.name}/{f.file}" for f in frames} | {*labels.values(), *masks.values(), *files_in(own.new)}
    own.exchange(drop=set(own.written) - stay, rights=rights)
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


def _kept(pictures: dict[FootageFrame, Path], own: OwnFolder, folder: str, mended: set[str]) -> dict[FootageFrame, str]:
    """Copies of pictures of frames among the new files, but for mended ones; their names in the drive, by frame."""
    found = {}
    for frame, source in pictures.items():
        name = Path(folder, frame.file).with_suffix(".png").as_posix()
        if name not in mended:
            read_label_image(source)  # whatever is no picture is told here, with its name
            copied(source, own.new / name)
        found[frame] = name
    return found

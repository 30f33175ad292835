"""Frames out of clips and folders, into the drive's images/."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import Reel, read_reel, write_reel
from unveil_core.solve.footage.kinds import camera_names, files_of, is_clip
from unveil_core.solve.footage.photographs import take_photographs
from unveil_core.solve.footage.video import decode_clip
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.steps import Steps, facts_of_files

__all__ = ["IMAGES", "decode"]

IMAGES = "images"


def decode(
    inputs: Sequence[Path], own: OwnFolder, settings: SolveSettings, steps: Steps, events: Events
) -> tuple[list[Reel], Path]:
    """The frames of footage, and the folder that they are in: the drive's, or that of new files.

    Raises:
        DriveError: footage that cannot be read. SettingsError: frames that somebody changed would be replaced.
    """
    names = camera_names(list(inputs))
    files = [p for path in inputs for p in files_of(path)]
    made_from = [facts_of_files(files), names, settings.frames, settings.every]
    places = [steps.folder / f"reel_{name}.json" for name in names]
    if steps.begin("decode", made_from) is not None:
        reels = [replace(read_reel(p), source=str(path)) for p, path in zip(places, inputs, strict=True)]
        for images in (own.new / IMAGES, own.root / IMAGES):
            if all((images / f.file).is_file() for r in reels for f in r.frames):
                events.end("decode", "up to date")
                return _told(reels, events), images
    own.check(n for n in own.changed() if n.startswith(f"{IMAGES}/"))
    if not steps.going_on("decode"):
        own.begin_anew()  # frames of other footage would be taken for this one's
    images = own.new / IMAGES
    progress = events.begin("decode")
    reels = []
    for path, name, place in zip(inputs, names, places, strict=True):
        take = decode_clip if is_clip(path) else take_photographs
        folder = "" if len(inputs) == 1 else name
        reel = take(path, images, name, settings.frames, settings.every, folder, progress)
        write_reel(replace(reel, source=path.name), place)
        reels.append(reel)
    steps.done("decode", {"frames": sum(len(r.frames) for r in reels)}, places)
    events.end("decode")
    return _told(reels, events), images


def _told(reels: list[Reel], events: Events) -> list[Reel]:
    for line in (n for r in reels for n in r.notices):
        events.notice("decode", line, "warning")
    return reels

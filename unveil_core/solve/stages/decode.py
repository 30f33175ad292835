"""Frames out of clips and folders, into the drive's images/."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import Reel, read_reel, write_reel
from unveil_core.solve.footage.kinds import camera_names, is_clip, pictures_in
from unveil_core.solve.footage.photographs import take_photographs
from unveil_core.solve.footage.video import decode_clip
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.steps import Steps, facts_of_files

__all__ = ["decode"]


def decode(inputs: Sequence[Path], images: Path, settings: SolveSettings, steps: Steps, events: Events) -> list[Reel]:
    names = camera_names(list(inputs))
    files = [p for path in inputs for p in ([path] if path.is_file() else pictures_in(path))]
    made_from = [facts_of_files(files), names, settings.frames, settings.every]
    places = [steps.folder / f"reel_{name}.json" for name in names]
    if steps.begin("decode", made_from) is not None and all(p.is_file() for p in places):
        reels = [read_reel(p) for p in places]
        if all((images / f.file).is_file() for r in reels for f in r.frames):
            events.end("decode", "up to date")
            return _told(reels, events)
    if not steps.going_on("decode") and images.is_dir():
        shutil.rmtree(images)  # frames of other footage would be taken for this one's
    progress = events.begin("decode")
    reels = []
    for path, name, place in zip(inputs, names, places, strict=True):
        take = decode_clip if is_clip(path) else take_photographs
        folder = "" if len(inputs) == 1 else name
        reel = take(path, images, name, settings.frames, settings.every, folder, progress)
        write_reel(reel, place)
        reels.append(reel)
    steps.done("decode", {"frames": sum(len(r.frames) for r in reels)})
    events.end("decode")
    return _told(reels, events)


def _told(reels: list[Reel], events: Events) -> list[Reel]:
    for line in (n for r in reels for n in r.notices):
        events.notice("decode", line, "warning")
    return reels

"""What is seen of the frames before they are solved: which are, where they are trusted, and whether it can work."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_own_json, write_atomic, write_json_atomic
from unveil_core.base.types import Mask
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import FootageFrame, Reel, own_names
from unveil_core.solve.looks.choice import chosen_frames
from unveil_core.solve.looks.hidden import bonnet_of, by_frame, labelled, not_street, write_feature_masks
from unveil_core.solve.looks.motion import motion_of
from unveil_core.solve.looks.pairs import frame_pairs, loops_of
from unveil_core.solve.looks.refusals import check_can_work
from unveil_core.solve.looks.thumbs import take_thumbs
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.steps import Steps, facts_of_files

__all__ = ["Looked", "look"]


@dataclass(frozen=True, eq=False)
class Looked:
    """Attributes:
    chosen: files of the frames that are solved, by camera; pairs: that are matched.
    labels, masks: pictures of frames; hidden: pixels of a frame that are no part of the scene, None = none.
    facts: standing and blurred frames, bonnet, loops, mean grey of the darkest camera.
    """

    chosen: list[list[str]]
    pairs: list[tuple[str, str]]
    labels: dict[FootageFrame, Path]
    masks: dict[FootageFrame, Path]
    hidden: Callable[[FootageFrame], Mask | None]
    bonnet: bool
    facts: dict[str, Any]


def look(reels: Sequence[Reel], images: Path, settings: SolveSettings, steps: Steps, events: Events) -> Looked:
    frames = [f for r in reels for f in r.frames]
    labels = {} if settings.labels is None else by_frame(settings.labels, frames, "labels")
    masks = {} if settings.masks is None else by_frame(settings.masks, frames, "masks")
    bonnets_file = steps.folder / "bonnets.npz"
    facts = steps.begin("look", None)
    if facts is None:
        progress = events.begin("look")
        chosen, loops, bonnets, standing, blurred, notices, grey = [], [], {}, 0, 0, [], 255.0
        for reel in reels:
            thumbs = take_thumbs(images, reel.frames, progress)
            if len(reel.frames) < 2:
                raise DriveError("Too few frames: 1", path=reel.source, mend="give more of the clip")
            motion = motion_of(thumbs, progress)
            bonnet = bonnet_of(motion)
            choice = chosen_frames(motion, thumbs.sharpness)
            notices += check_can_work(reel.source, thumbs, motion, choice, None if bonnet is None else ~bonnet)
            files = [reel.frames[i].file for i in choice.frames]
            loops += [(files[a], files[b]) for a, b in loops_of(thumbs, choice.frames)]
            chosen.append(files)
            standing, blurred = standing + choice.standing, blurred + choice.blurred
            grey = min(grey, float(np.median(thumbs.brightness)))
            if bonnet is not None:
                bonnets[reel.camera] = bonnet
        write_atomic(bonnets_file, lambda stream: np.savez(stream, **bonnets))  # type: ignore[arg-type]
        facts = steps.done(
            "look",
            {
                "chosen": chosen,
                "loops": loops,
                "standing": standing,
                "blurred": blurred,
                "bonnet": sorted(bonnets),
                "grey": round(grey, 1),
                "notices": notices,
            },
            [bonnets_file],
        )
        events.end("look")
    else:
        events.end("look", "up to date")
    for line in facts["notices"]:
        events.notice("look", line, "warning")
    if settings.segmenter is not None:
        labels = labelled(
            settings.segmenter, images, frames, _labels_of(settings.segmenter, steps), events.progress("label")
        )
    with open_file(bonnets_file) as file, np.load(file) as held:
        found = {k: held[k] for k in held.files}
    masks_folder = steps.folder / "masks"
    shutil.rmtree(masks_folder, ignore_errors=True)
    sizes = {r.camera: r.size for r in reels}
    called = own_names(reels)
    for reel, names in zip(reels, facts["chosen"], strict=True):
        wanted = set(names)
        some = {f: called[f.file] for f in reel.frames if f.file in wanted}
        write_feature_masks(some, reel.size, masks_folder, labels, masks, found.get(reel.camera))
    if facts["standing"]:
        events.notice("look", f"the camera stands in {facts['standing']} frames: they are placed by their neighbours")
    return Looked(
        facts["chosen"],
        _pairs(facts["chosen"], [(a, b) for a, b in facts["loops"]]),
        labels,
        masks,
        lambda f: not_street(f, sizes[f.camera], labels.get(f), found.get(f.camera)),
        bool(found),
        facts,
    )


def _labels_of(segmenter: Path, steps: Steps) -> Path:
    """The folder of the labels that a network found in these frames: empty where another one wrote it, or it is of other frames."""
    folder, mark = steps.folder / "labels", steps.folder / "labels.json"
    by = {"made_from": steps.chain, "network": facts_of_files([segmenter])}
    try:
        same = read_own_json(mark) == by
    except (OSError, ValueError):
        same = False
    if not same:
        shutil.rmtree(folder, ignore_errors=True)
        write_json_atomic(mark, by)
    return folder


def _pairs(chosen: list[list[str]], loops: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Neighbours of each camera, loops, and of several cameras frames at the same share of the way, and those beside."""
    found = [(names[a], names[b]) for names in chosen for a, b in frame_pairs(len(names))]
    for k, first in enumerate(chosen):
        for second in chosen[k + 1 :]:
            for a, name in enumerate(first):
                b = round(a * (len(second) - 1) / max(1, len(first) - 1))
                found += [(name, second[c]) for c in range(max(0, b - 2), min(len(second), b + 3))]
    return list(dict.fromkeys(found + loops))

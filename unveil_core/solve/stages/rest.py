"""All other frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.files import write_atomic
from unveil_core.base.pictures.decoding import read_image
from unveil_core.solve.events import Events
from unveil_core.solve.footage.frames import Reel
from unveil_core.solve.mapping.model import Model
from unveil_core.solve.mapping.rest import placed_rest
from unveil_core.solve.stages.mapping import lens_of
from unveil_core.solve.steps import Steps

__all__ = ["place_rest"]


def place_rest(model: Model, reels: Sequence[Reel], images: Path, steps: Steps, events: Events) -> Model:
    place = steps.folder / "every.npz"
    before = steps.begin("rest", None)
    if before is not None:
        events.end("rest", "up to date")
        return _read_every(model, place)
    progress = events.begin("rest")
    lens = {r.camera: number for r in reels for number in [lens_of(model, r)] if number is not None}
    owner = {f.file: r.camera for r in reels for f in r.frames}
    times = {f.file: f.time_s for r in reels for f in r.frames if f.time_s is not None}

    def grey(name: str) -> NDArray[np.uint8]:
        return np.asarray(cv2.cvtColor(read_image(images / name), cv2.COLOR_RGB2GRAY), np.uint8)

    every, errors, between = placed_rest(
        model, [[f.file for f in r.frames] for r in reels], lambda n: lens[owner[n]], grey, times, progress
    )
    arrays = {"names": np.array(every.names), "lens": every.lens, "poses": every.poses}
    write_atomic(place, lambda stream: np.savez(stream, **arrays))  # type: ignore[arg-type]
    known = [e for e in errors.values() if np.isfinite(e)]
    facts = {"added": len(errors), "between": list(between), "px": float(np.median(known)) if known else None}
    steps.done("rest", {**facts, "errors": {n: round(e, 3) for n, e in errors.items() if np.isfinite(e)}}, [place])
    events.end("rest")
    if between:
        events.notice(
            "rest", f"{len(between)} frames show too little: they are placed between their neighbours", "warning"
        )
    return every


def _read_every(model: Model, place: Path) -> Model:
    with open_file(place) as file, np.load(file) as held:
        known = set(model.names)
        more = [(str(n), int(k), p) for n, k, p in zip(held["names"], held["lens"], held["poses"], strict=True)]
    more = [m for m in more if m[0] not in known]
    return model.with_pictures([m[0] for m in more], [m[1] for m in more], [m[2] for m in more])

"""``unveil mask``: objects of a few clicks, as mattes of all frames that a run takes."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from unveil_core.app.console import reporting_for, say
from unveil_core.app.given_settings import settings_of
from unveil_core.base.errors import SettingsError

if TYPE_CHECKING:  # its module loads NumPy
    from unveil_core.marking.asked.said import SaidObject

__all__ = ["run_mask"]


def run_mask(arguments: argparse.Namespace) -> int:
    """Outline what was clicked, write mattes and a page, say how a run takes them."""
    from unveil_core.marking.asked.record import MARKED
    from unveil_core.marking.mark import mark
    from unveil_core.marking.network import Networks
    from unveil_core.pipeline.output_place import check_folder_place, drives_of
    from unveil_core.workspace.workspace import Workspace, is_workspace

    given = (arguments.prompt_encoder, arguments.prompt_decoder)
    if (given[0] is None) != (given[1] is None):
        missing = "--prompt-encoder" if given[0] is None else "--prompt-decoder"
        raise SettingsError("One network of two is given", mend=f"add {missing} FILE.onnx")
    source = arguments.source
    check_folder_place(arguments.output, drives_of(Workspace.open(source)) if is_workspace(source) else [source])
    told: list[str] = []
    with reporting_for(arguments) as reporter:

        def event(message: str, level: str, done: int = 0, total: int = 0) -> dict[str, object]:
            return {
                "t": round(time.time(), 3),
                "stage": "mask",
                "done": done,
                "total": total,
                "message": message,
                "level": level,
            }

        def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
            reporter({**event(message, "info", done, total), **metrics})

        def notice(line: str) -> None:
            told.append(line)
            reporter(event(line, "warning"))

        found = mark(
            source,
            arguments.output,
            said_objects(arguments.said),
            settings=settings_of(arguments),
            moving=arguments.moving,
            networks=None if given[0] is None else Networks(given[0], given[1]),
            progress=progress,
            notice=notice,
        )
    marked, page = arguments.output / MARKED, arguments.output / "index.html"
    if arguments.json:
        objects = [{"name": m.name, "id": m.id, "frames": m.frames, "mattes": str(m.folder)} for m in found]
        say(json.dumps({"mask": {"marked": str(marked), "page": str(page), "objects": objects, "notices": told}}))
    else:
        for it in found:
            say(f"{it.name:<22} in {it.frames} frames: {it.folder}")
        say(f"{'look at':<22} {page}")
        ids = ",".join(str(m.id) for m in found)
        say(f"{'remove by':<22} unveil run … --marked {marked} --instances {ids}")
    return 0


def said_objects(words: Sequence[tuple[str, str]]) -> list[SaidObject]:
    """What the options say, by object.

    Raises:
        SettingsError: an option that says none, or a name of which nothing is said.
    """
    from unveil_core.marking.asked.said import SaidObject, clicked, drawn, of_file, of_folder

    found = [SaidObject(None)]
    for word, value in words:
        if word == "object":
            if not value.strip():
                raise SettingsError("An object without a name", mend="add --object NAME")
            found.append(SaidObject(value.strip()))
        elif word in ("inside", "outside"):
            found[-1].said.append(clicked(value, word))
        elif word == "stroke" and value.lower().endswith(".json"):
            of = found[-1].name
            for thing in of_file(Path(value)):
                found.insert(-1, SaidObject(thing.name or of, thing.said))
        elif word == "mattes":
            found[-1].said.append(of_folder(value))
        else:
            found[-1].said.append(drawn(value, word))
    empty = next((o.name for o in found if o.name is not None and not o.said), None)
    if empty is not None and not any(o.said for o in found if o.name == empty):
        raise SettingsError(f"No click, stroke or matte for {empty!r}", mend="add --click FRAME:X,Y after --object")
    return [o for o in found if o.said]

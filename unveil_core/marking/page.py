"""What was outlined, to look at: a contact sheet of each object, and a page of them all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base import wording
from unveil_core.base.evenly import evenly
from unveil_core.base.files import write_bytes_atomic, write_image_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.output.written import GENERATOR
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Drive
from unveil_core.marking.asked.prompts import Prompt, Prompts
from unveil_core.marking.asked.record import Recorded, key_of

__all__ = ["PAGE", "Shown", "contact_sheet", "sheet_name", "write_page"]

PAGE = "index.html"
MOST_CELLS = 24
"""Frames on a sheet at most, evenly from those that show the object, the clicked ones among them."""
COLUMNS, CELL_PX = 4, 480
TINT, INSIDE, OUTSIDE = (255, 40, 160), (60, 220, 90), (255, 60, 40)
"""Colours of an object, of clicks on it, and of clicks beside it."""
SHARE = 0.45
"""Of the colour over the photograph."""


@dataclass(frozen=True, eq=False)
class Shown:
    """An object that was outlined: what was said of it, and its pixels (H, W) per frame."""

    thing: Recorded
    prompts: Prompts
    masks: Sequence[Mask]


def sheet_name(thing: Recorded) -> str:
    """The file of an object's contact sheet in the folder."""
    return f"sheets/{thing.folder}.jpg"


def contact_sheet(shown: Shown, drive: Drive, image: Callable[[int], NDArray[np.uint8]]) -> Picture:
    """(H, W, 3) the frames that show an object, with its pixels tinted, and what was clicked."""
    visible = [v for v, mask in enumerate(shown.masks) if mask.any()]
    said = sorted(shown.prompts.frames)
    some = {visible[i] for i in evenly(len(visible), max(MOST_CELLS - len(said), 1))}
    cells = [
        _cell(image(v), shown.masks[v], shown.prompts.frames.get(v), f"{key_of(drive.frames[v])}")
        for v in sorted(some | set(said))[:MOST_CELLS]
    ]
    height = max(c.shape[0] for c in cells)
    width = min(COLUMNS, len(cells)) * CELL_PX
    rows = -(-len(cells) // COLUMNS)
    sheet = np.full((rows * height, width, 3), 24, np.uint8)
    for k, cell in enumerate(cells):
        y, x = k // COLUMNS * height, k % COLUMNS * CELL_PX
        sheet[y : y + cell.shape[0], x : x + CELL_PX] = cell
    return sheet


def _cell(photograph: NDArray[np.uint8], mask: Mask, prompt: Prompt | None, name: str) -> Picture:
    factor = CELL_PX / photograph.shape[1]
    size = (CELL_PX, max(1, round(photograph.shape[0] * factor)))
    cell = cv2.resize(photograph, size, interpolation=cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC)
    own = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    cell[own > 0] = ((1 - SHARE) * cell[own > 0] + SHARE * np.array(TINT)).astype(np.uint8)
    outline, _ = cv2.findContours(own, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(cell, outline, -1, TINT, 1, cv2.LINE_AA)
    if prompt is not None:
        for places, color in ((prompt.inside, INSIDE), (prompt.outside, OUTSIDE)):
            for x, y in places * factor:
                cv2.circle(cell, (round(x), round(y)), 5, (255, 255, 255), -1, cv2.LINE_AA)
                cv2.circle(cell, (round(x), round(y)), 4, color, -1, cv2.LINE_AA)
        cv2.rectangle(cell, (0, 0), (size[0] - 1, size[1] - 1), INSIDE, 2)
    text = name.encode("ascii", "replace").decode()
    cv2.putText(cell, text, (7, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(cell, text, (7, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(cell, np.uint8)


def write_page(
    own: OwnFolder,
    things: Sequence[Recorded],
    shown: Sequence[Shown],
    drive: Drive,
    image: Callable[[int], NDArray[np.uint8]],
) -> None:
    """Write the contact sheets of the objects that were outlined now, and the page of all."""
    for it in shown:
        write_image_atomic(own.new / sheet_name(it.thing), contact_sheet(it, drive, image))
    style = files("unveil_core.report").joinpath("page.css").read_text(encoding="utf-8")
    parts = [
        f'<section><h2>{_text(t.name)} <small>{t.id}</small></h2><figure class="card"><img src="{escape(sheet_name(t))}" '
        f'alt="{_text(t.name)} in the frames that show it"><figcaption>mattes/{escape(t.folder)}/ · clicked in '
        f"{_text(', '.join(t.frames) or 'painted mattes')}</figcaption></figure></section>"
        for t in things
        if any((place / sheet_name(t)).is_file() for place in (own.new, own.root))
    ]
    page = _PAGE.format(generator=escape(GENERATOR), style=style, parts="\n".join(parts))
    write_bytes_atomic(own.new / PAGE, page.encode())


def _text(told: str) -> str:
    """A text of a person or a stranger as a page shows it."""
    return escape(wording.shown(told, longest=None))


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="generator" content="{generator}">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src 'self' data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<title>Objects · Unveil mask</title>
<style>{style} figure img {{ width: 100% }}</style></head><body><main>
<header><div><p class="brand">Unveil mask</p><h1>What will be removed</h1></div></header>
<p class="lead">Too little, or too much? Call <code>unveil mask</code> again with the same folder and more <code>--click</code> or
<code>--not</code>; or paint over a matte in any program, and call it again: the other frames follow.</p>
{parts}
</main></body></html>
"""

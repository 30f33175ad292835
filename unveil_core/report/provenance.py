"""Provenance and certainty on the page: a picture of each, their legends, and the figures in a line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_label_image
from unveil_core.base.types import Mask, Picture
from unveil_core.drives.drive import Frame
from unveil_core.evaluate.delivered import read_delivered
from unveil_core.evaluate.provenance import ORIGINS
from unveil_core.inpaint.origin import CONTINUED, INVENTED, ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.provenance.certainty import CERTAIN, CERTAIN_RIGHT, ORIGINAL_LEVEL
from unveil_core.report.pictures import fitted
from unveil_core.report.wording import decibels, percent
from unveil_core.workspace.files import frame_file

__all__ = [
    "ORIGIN_COLORS",
    "ORIGIN_NAMES",
    "certainty_cards",
    "css_color",
    "draw_provenance",
    "mode_legend",
    "origin_shares",
]

ORIGIN_COLORS: dict[int, tuple[int, int, int]] = {
    RELIT: (240, 205, 60),
    SEEN_ELSEWHERE: (48, 176, 130),
    CONTINUED: (86, 140, 245),
    INVENTED: (226, 70, 60),
}
"""sRGB."""
ORIGIN_NAMES: dict[int, str] = {
    RELIT: "relit: a shadow taken away",
    SEEN_ELSEWHERE: "seen by another frame",
    CONTINUED: "continued from what was seen beside it",
    INVENTED: "invented",
}
RAMP = {0.0: (196, 60, 78), 0.5: (246, 214, 110), 0.9: (170, 212, 230)}
"""sRGB of expectations; told apart also by people who see no difference between red and green."""
SURE = (24, 96, 196)
"""sRGB of what is called certain."""
SHARE = 0.7
"""So much of the colours lies over the clean frame."""
DARK = 0.55
"""Brightness of what is the photograph's."""


def draw_provenance(root: Path, frame: Frame, size: tuple[int, int]) -> tuple[Picture, Picture] | None:
    """The delivered frame, coloured by where its pixels come from, and by how sure they are.

    Args:
        root: the workspace; size: width and height of the pictures.
    Returns:
        (height, width, 3) each, or None where the workspace does not tell.
    """
    paths = [frame_file(root / name, frame) for name in ("provenance", "certainty")]
    if not all(p.is_file() for p in paths):
        return None
    delivered = fitted(read_delivered(root, frame), size)
    origin = fitted(read_label_image(paths[0]), size, labels=True)
    level = cv2.resize(read_label_image(paths[1]), size, interpolation=cv2.INTER_NEAREST)
    table = np.zeros((256, 3), dtype=np.float64)
    for kind, color in ORIGIN_COLORS.items():
        table[kind] = color
    changed = origin != ORIGINAL
    return _over(delivered, table[origin], changed), _over(delivered, _ramp()[level], changed)


def _over(picture: Picture, colors: NDArray[np.float64], where: Mask) -> Picture:
    """Colours (H, W, 3) over a picture, where they are; the picture is darker elsewhere."""
    grey = picture.mean(axis=2, keepdims=True)
    shown = np.where(where[..., None], SHARE * colors + (1 - SHARE) * grey, DARK * picture)
    return np.clip(np.round(shown), 0, 255).astype(np.uint8)


def _ramp() -> NDArray[np.float64]:
    """(256, 3) colours of the levels of certainty."""
    at = np.arange(256) / (ORIGINAL_LEVEL - 1)
    colors = np.stack([np.interp(at, list(RAMP), ends) for ends in zip(*RAMP.values(), strict=True)], axis=1)
    colors[CERTAIN:] = SURE
    return colors


def mode_legend(mode: str) -> list[tuple[str, str]]:
    """Colours, as CSS has them, and words of a view of the viewer; none where it needs no legend."""
    if mode == "provenance":
        entries = {ORIGIN_NAMES[k]: ORIGIN_COLORS[k] for k in ORIGIN_COLORS}
    elif mode == "certainty":
        entries = {f"expected to be right: {share:.0%}".replace("%", " %"): color for share, color in RAMP.items()}
        entries["certain"] = SURE
    else:
        return []
    return [(css_color(color), words) for words, color in entries.items()]


def css_color(color: tuple[int, int, int]) -> str:
    """A colour as CSS has it."""
    return f"rgb{color}"


def origin_shares(metrics: dict[str, Any]) -> list[dict[str, Any]]:
    """Of what was changed: each origin's colour, words, share of one, and figures in words; empty where it is not known."""
    origins = metrics.get("provenance", {}).get("origins", {})
    found = []
    for kind, name in ORIGINS.items():
        if name in origins and origins[name]["share"] > 0:
            words = percent(origins[name]["share"])
            if "psnr" in origins[name]:
                words += f", {decibels(origins[name]['psnr'])}"
            share = f"{100 * origins[name]['share']:.2f}"
            found.append(
                {"color": css_color(ORIGIN_COLORS[kind]), "name": ORIGIN_NAMES[kind], "share": share, "words": words}
            )
    return found


def certainty_cards(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """A card with the share that is called certain and, with truth, how much of that is right; none without certainty."""
    found = metrics.get("certainty", {})
    if found.get("certain") is None:
        return []
    said = f"{CERTAIN} of {ORIGINAL_LEVEL} and more: {percent(CERTAIN_RIGHT)} right on real drives"
    text = f"of what was changed counts as certain ({said})"
    if found.get("certain_right") is not None:
        text += f"; {percent(found['certain_right'])} of that is right"
    return [(percent(found["certain"]), text)]

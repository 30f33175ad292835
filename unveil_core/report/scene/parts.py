"""The scene's parts of the page, as the template draws them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from unveil_core.base.types import Float64
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.report.provenance import ORIGIN_COLORS, ORIGIN_NAMES, css_color
from unveil_core.report.scene.gathered import MapPictures, ScenePictures
from unveil_core.report.scene.top_view import Map
from unveil_core.semantics.instances import Box

__all__ = ["box_of", "inert_json", "map_part", "scene_part"]

LEGIBLE_PX_PER_M = 7.0
"""The map is not drawn smaller, but scrolled: a car is then 30 pixels long, and its number can be read."""
WIDEST_PX = 6_000
"""Beyond, a map becomes smaller all the same."""
BARS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500)
BAR_SHARE = 0.12
"""Of the map's width, that the bar of its scale has about."""
LABEL_M = 1.4
"""Height of an object's number, metres on the ground."""


def inert_json(value: Any) -> Markup:
    """JSON for a script element that is data: nothing in it ends the element."""
    return Markup(json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"))


def scene_part(scene: ScenePictures | None) -> dict[str, Any] | None:
    """The scene to turn, and the flight."""
    if scene is None:
        return None
    shown, whole = scene.viewer["shown"]
    return {
        "words": f"Shown are {shown} of the drive's {whole} m, where most was removed. " if shown < whole else "",
        "data": inert_json(scene.viewer),
        "legend": _legend(scene.viewer["kinds"]),
        "flight": scene.flight,
        "no_flight": scene.no_flight,
    }


def map_part(scene: ScenePictures | None, objects: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """The street from above.

    Args:
        objects: entries of instances.json in the order of the page.
    """
    if scene is None:
        return None
    drawn: MapPictures = scene.map
    place = drawn.map
    width, height = place.size
    legible = min(LEGIBLE_PX_PER_M * width / place.pixels_per_m, WIDEST_PX)
    boxes = [_outline(place, entry, k) for k, entry in enumerate(objects) if entry.get("removed")]
    return {
        "width": width,
        "height": height,
        "legible": round(legible),
        "picture": drawn.picture,
        "origins": drawn.origins,
        "way": _points(drawn.way),
        "start": [f"{v:.1f}" for v in drawn.way[0]],
        "arrow": _points(_arrow(drawn.way, place.pixels_per_m)),
        "stroke": f"{0.18 * place.pixels_per_m:.2f}",
        "dot": f"{0.5 * place.pixels_per_m:.2f}",
        "label": f"{LABEL_M * place.pixels_per_m:.1f}",
        "boxes": [box for box in boxes if box],
        "legend": _legend(drawn.kinds),
        "bar": _bar(place),
    }


def _legend(kinds: Sequence[int]) -> list[tuple[str, str]]:
    return [(css_color(ORIGIN_COLORS[k]), ORIGIN_NAMES[k]) for k in kinds]


def _points(pixels: Float64) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)


def _arrow(way: Float64, pixels_per_m: float) -> Float64:
    """(3, 2) a triangle at the end of the way (S, 2), in its direction; that of the picture's x where there is none."""
    ahead = way[-1] - way[max(0, len(way) - 6)]
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 0 else np.array([1.0, 0.0])
    aside = np.array([-ahead[1], ahead[0]])
    shape = np.array([[1.4, 0.0], [0.0, 0.6], [0.0, -0.6]]) * pixels_per_m
    found: Float64 = way[-1] + shape @ np.stack([ahead, aside])
    return found


def box_of(entry: dict[str, Any]) -> Box | None:
    """The box of an entry of instances.json; None where it has none, or one that is none."""
    try:
        return Box.from_json(entry["box"])
    except (LookupError, TypeError, ValueError):
        return None


def _outline(place: Map, entry: dict[str, Any], number: int) -> dict[str, Any] | None:
    """An object's box from above; None where it has none, or none that can be drawn."""
    box = box_of(entry)
    if box is None:
        return None
    corners = place.to_pixels(box.corners(up_frame(UP))[[0, 2, 6, 4]])
    x, y = corners.mean(axis=0)
    words = f"{entry.get('class', 'object')} {entry.get('id', '')}"
    return {
        "points": _points(corners),
        "x": f"{x:.1f}",
        "y": f"{y:.1f}",
        "id": str(entry.get("id", "")),
        "words": words,
        "number": number,
    }


def _bar(place: Map) -> dict[str, str]:
    """The bar of the scale, in the lower left corner."""
    metres = min(BARS_M, key=lambda m: abs(m * place.pixels_per_m - BAR_SHARE * place.size[0]))
    unit = place.pixels_per_m
    left, y = 1.0 * unit, place.size[1] - 1.0 * unit
    return {
        "x": f"{left:.1f}",
        "end": f"{left + metres * unit:.1f}",
        "y": f"{y:.1f}",
        "words_y": f"{y - 0.5 * unit:.1f}",
        "words": f"{metres} m",
    }

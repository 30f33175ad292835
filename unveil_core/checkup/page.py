"""The page of a check: one HTML file that needs nothing but itself, in the style of the report."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from unveil_core.base.output.written import GENERATOR
from unveil_core.base.types import Float64
from unveil_core.checkup.examined import Examined
from unveil_core.checkup.way import WayPicture
from unveil_core.report.pictures import jpeg_uri

__all__ = ["check_page"]

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
"""What a browser lets the page do: show pictures that are in it."""
QUALITY = 80
"""Of JPEG."""


def check_page(found: Examined) -> str:
    """The page as text."""
    style = files("unveil_core.report").joinpath("page.css").read_text(encoding="utf-8")
    own = files("unveil_core.checkup").joinpath("check.css").read_text(encoding="utf-8")
    template = files("unveil_core.checkup").joinpath("check.html.j2").read_text(encoding="utf-8")
    made = Environment(autoescape=True, undefined=StrictUndefined).from_string(template)
    return made.render(
        policy=POLICY,
        generator=GENERATOR,
        style=Markup(style + own),
        name=found.name,
        facts=found.facts,
        findings=found.findings,
        assumed=found.assumed,
        told=found.told,
        map=_map(found.way),
        points=None
        if found.points is None
        else {**vars(found.points), "picture": jpeg_uri(found.points.picture, QUALITY)},
        labels=[{**vars(p), "picture": jpeg_uri(p.picture, QUALITY)} for p in found.labels],
    )


def _map(way: WayPicture) -> dict[str, Any]:
    height, width = way.ground.shape[:2]
    start = next((line[2][0] for line in way.lines), None)
    return {
        "width": width,
        "height": height,
        "picture": jpeg_uri(way.ground, QUALITY),
        "lines": [{"name": name, "color": f"rgb{color}", "points": _points(path)} for name, color, path in way.lines],
        "start": None if start is None else [f"{v:.1f}" for v in start],
        "ticks": [[f"{v:.1f}" for v in tick.ravel()] for tick in way.ticks],
        "boxes": [_points(box) for box in way.boxes],
        "bar": {"length": f"{way.bar_m * way.pixels_per_m:.1f}", "words": f"{way.bar_m:g} m"},
    }


def _points(pixels: Float64) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
